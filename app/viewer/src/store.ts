/** All that the page shows, in one object, and who is told when it changes. */

import type { Item } from "./items";
import type { Problem } from "./problems";
import type { Options } from "./api";
import type { DetectResult, LevelName, Mode } from "./result";

/** What a request is about right now. */
export type Phase =
  | { kind: "idle" }
  | { kind: "uploading"; share: number }
  | { kind: "computing" }
  | { kind: "starting" }
  | { kind: "failed"; problem: Problem };

export type View = "mesh" | "mirror" | "heat";
export type Up = "y" | "z";

/** Triangles for display, nine numbers each, unit frame; a normal a corner. */
export interface Surface {
  corners: Float32Array;
  normals: Float32Array;
  /** Red, green and blue of every corner in linear light, if the mesh has colours of its own. */
  colors: Float32Array | null;
  /** Two numbers a corner from the upper left of its picture, and which corners have which; if it has some. */
  places: Float32Array | null;
  pictures: { image: ImageBitmap; start: number; count: number }[];
}

/** One of several files that were opened together. */
export interface Entry {
  file: File;
  result: DetectResult | null;
  problem: Problem | null;
}

export interface State {
  phase: Phase;
  file: File | null;
  mode: Mode;
  maxError: number;
  /** Which of the groups that hold is asked for: one by its tolerance in the file's units, or else by name. */
  level: LevelName;
  tolerance: number | null;
  /** The files that were opened together, if they are several. */
  batch: Entry[];
  /** The answer that is shown, and the options it was asked with; it stays while the next is on its way. */
  result: DetectResult | null;
  answered: Options | null;
  items: Item[];
  surface: Surface | null;
  selected: string | null;
  hovered: string | null;
  hidden: ReadonlySet<string>;
  view: View;
  up: Up;
  /** Largest distance of the heat map, unit frame; null while it is measured. */
  heatLargest: number | null;
  /** How the picture is drawn. */
  flat: boolean;
  wire: boolean;
  grid: boolean;
  ruler: boolean;
  theme: "light" | "dark";
}

export type Listener = (state: State, before: State) => void;

export interface Store {
  get(): State;
  set(change: Partial<State>): void;
  subscribe(listener: Listener): void;
}

export function createStore(initial: State): Store {
  let state = initial;
  const listeners: Listener[] = [];
  return {
    get: () => state,
    set(change) {
      const before = state;
      state = { ...state, ...change };
      for (const listener of listeners) listener(state, before);
    },
    subscribe(listener) {
      listeners.push(listener);
      listener(state, state);
    },
  };
}

/** Results, without what was turned down. */
export const accepted = (state: State): Item[] => state.items.filter((item) => item.reason === null);

/** Whether a request is under way. */
export const isBusy = ({ phase }: State): boolean => phase.kind !== "idle" && phase.kind !== "failed";

export const itemById = (state: State, id: string | null): Item | null =>
  state.items.find((item) => item.id === id) ?? null;

/** What mirror preview and heat map are about: what is selected, else the best result. */
export const subject = (state: State): Item | null =>
  itemById(state, state.selected) ?? accepted(state)[0] ?? null;
