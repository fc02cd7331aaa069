/** What to take away: the result in several formats, a picture, and meshes made with it. */

import {
  completeQuery,
  curlLine,
  detectQuery,
  endpoint,
  meshQuery,
  sectorQuery,
  send,
  type Options,
} from "./api";
import { download, h } from "./dom";
import { isExample } from "./examples";
import { plural, shellWord, short } from "./format";
import { formats } from "./formats";
import { linkTo } from "./link";
import { sourceOf } from "./list";
import { ProblemError, noAnswer } from "./problems";
import { itemById, type State, type Store } from "./store";
import type { Vector } from "./result";
import type { Say } from "./status";
import { withCompanions } from "./together";

export interface Exports {
  element: HTMLElement;
  update(state: State): void;
}

/** The part of the header `PRSNet-Completion` that is told here. */
interface Completion {
  faces_added: number;
  area_added: number;
  seam_distance: number;
}

/** The parts of the headers `PRSNet-Half` and `PRSNet-Sector` that are told here. */
interface Cut {
  order?: number;
  angle?: number;
  capped: boolean;
  calculix: string;
  freecad: string;
}

export function exports(
  store: Store,
  say: Say,
  open: (file: File) => void,
  picturePng: () => Promise<Blob>,
): Exports {
  const format = h(
    "select",
    { id: "complete-format", "aria-label": "Format of the completed mesh" },
    ...formats().written.map((name) => h("option", { value: name }, name.toUpperCase())),
  );
  const symmetrize = h("input", { type: "checkbox", id: "symmetrize" });
  const capped = h("input", { type: "checkbox", id: "capped" });
  let lines: Cut | null = null;
  const across = h("span", { class: "muted small" });
  const around = h("span", { class: "muted small" });
  const outcome = h("p", { class: "small outcome", hidden: true });
  const button = (text: string, task: () => Promise<void>) =>
    h("button", { type: "button", class: "button", onclick: (event: Event) => guarded(event, task) }, text);

  async function guarded(event: Event, task: () => Promise<void>): Promise<void> {
    const source = event.currentTarget as HTMLButtonElement;
    source.disabled = true;
    try {
      await task();
    } catch (error) {
      const problem =
        error instanceof ProblemError
          ? error.problem
          : { ...noAnswer, slug: "not-understood", detail: String(error) };
      store.set({ phase: { kind: "failed", problem } });
    } finally {
      source.disabled = false;
    }
  }

  async function copy(text: string, what: string): Promise<void> {
    await navigator.clipboard.writeText(text);
    say(`${what} copied.`, true);
  }

  /** The result in one of the service's formats, as a file. */
  async function saved(format: string, ending: string, what: string): Promise<void> {
    const { file, options } = asked(store.get());
    const url = endpoint("detect", { ...detectQuery(options), format });
    const { content } = await send(url, file, new AbortController().signal);
    download(content, `${stem(file.name)}-symmetries.${ending}`);
    say(`${what} downloaded.`, true);
  }

  /** A mesh that the service makes of this one, as a file. */
  async function made(path: string, query: Record<string, string>, word: string) {
    const { file } = asked(store.get());
    const answer = await send(endpoint(path, query), file, new AbortController().signal);
    download(answer.content, `${stem(file.name)}-${word}.${format.value}`);
    return answer;
  }

  async function aligned(): Promise<void> {
    await made("align", meshQuery(asked(store.get()).options, format.value, null), "aligned");
    say("Aligned copy downloaded.", true);
  }

  async function half(): Promise<void> {
    const state = store.get();
    const query = meshQuery(asked(state).options, format.value, chosenPlane(state));
    const closed = capped.checked ? { capped: "true" } : {};
    const answer = await made("halve", { ...query, ...closed }, "half");
    tell(JSON.parse(answer.header("PRSNet-Half") ?? "null") as Cut | null, "Half");
  }

  async function sector(): Promise<void> {
    const state = store.get();
    const query = sectorQuery(asked(state).options, format.value, chosenAxis(state));
    const answer = await made("sector", { ...query, capped: String(capped.checked) }, "sector");
    tell(JSON.parse(answer.header("PRSNet-Sector") ?? "null") as Cut | null, "Sector");
  }

  /** What was cut, and the lines for simulation programs that go with it. */
  function tell(cut: Cut | null, word: string): void {
    const part = cut?.order ? `: one of ${cut.order}, ${short(cut.angle ?? 360 / cut.order)}°` : "";
    const open = capped.checked && cut && !cut.capped ? " It is open: its outline is not closed." : "";
    outcome.textContent = `${word} downloaded${part}.${open}`;
    outcome.hidden = false;
    lines = cut;
    forPrograms.hidden = cut === null;
    say(outcome.textContent);
  }

  async function snapshot(): Promise<void> {
    const picture = await picturePng();
    download(picture, `${stem(asked(store.get()).file.name)}.png`);
    say("Picture downloaded.", true);
  }

  /** The completed mesh as a file. */
  async function completed(): Promise<File> {
    const state = store.get();
    const { file, options } = asked(state);
    const query = completeQuery(options, format.value, symmetrize.checked, chosenPlane(state));
    const answer = await send(endpoint("complete", query), file, new AbortController().signal);
    const done = JSON.parse(answer.header("PRSNet-Completion") ?? "{}") as Partial<Completion>;
    outcome.textContent = describe(done, symmetrize.checked);
    outcome.hidden = false;
    say(outcome.textContent);
    return new File([answer.content], `${stem(file.name)}-completed.${format.value}`);
  }

  const forPrograms = h(
    "div",
    { class: "buttons", hidden: true },
    button("Copy for CalculiX", () => copy(lines!.calculix, "Lines for CalculiX")),
    button("Copy for FreeCAD", () => copy(lines!.freecad, "Lines for FreeCAD")),
  );
  const sectorButton = button("Sector", sector);
  const link = button("Copy link", () => {
    const { file, options } = asked(store.get());
    return copy(linkTo(file.name, options), "Link");
  });
  const element = h(
    "section",
    { class: "exports" },
    h("h3", {}, "Take away"),
    h(
      "div",
      { class: "buttons" },
      button("Copy JSON", () => copy(JSON.stringify(store.get().result, null, 2), "JSON")),
      button("Copy curl line", () => {
        const { file, options } = asked(store.get());
        const names = withCompanions(file).map((part) => part.name);
        return copy(curlLine(names, options, shellWord), "curl line");
      }),
      link,
      button("Annotated GLB", () => saved("glb", "glb", "Annotated GLB")),
      button("CSV", () => saved("csv", "csv", "CSV")),
      button("BOP", () => saved("bop", "json", "BOP entry")),
      button("Picture", snapshot),
    ),
    h("h4", {}, "Make a mesh of it"),
    h(
      "p",
      { class: "muted small" },
      "The completed mesh keeps what is there and mirrors the rest from the other side, the half is cut, at ",
      across,
      ". The sector is one of n equal parts around ",
      around,
      ". The aligned copy has the plane on YZ and the main axis on Z.",
    ),
    h(
      "div",
      { class: "buttons" },
      format,
      button("Completed mesh", async () => {
        const file = await completed();
        download(file, file.name);
      }),
      button("Half", half),
      sectorButton,
      button("Aligned copy", aligned),
      button("Open completed", async () => open(await completed())),
    ),
    h("label", { class: "check small" }, symmetrize, "also average both halves of the completed mesh"),
    h("label", { class: "check small" }, capped, "close the cuts of half and sector"),
    outcome,
    forPrograms,
  );
  return {
    element,
    update(state) {
      link.hidden = !isExample(state.file);
      const item = itemById(state, state.selected);
      const axis = chosenAxis(state);
      sectorButton.hidden = !state.result?.axes.some(({ order }) => order !== null);
      around.textContent = axis && item ? item.name.toLowerCase() : "the main axis";
      across.textContent =
        item?.kind === "plane"
          ? item.reason
            ? "the chosen candidate"
            : item.name.toLowerCase()
          : "the best plane";
    },
  };
}

/** File and options that the result on the page is the answer to. */
function asked(state: State): { file: File; options: Options } {
  return { file: state.file!, options: state.answered! };
}

function chosenPlane(state: State) {
  const item = itemById(state, state.selected);
  const source = item?.kind === "plane" ? sourceOf(item, state) : null;
  return source && "normal" in source ? source : null;
}

/** The chosen axis, if rotations about it are counted. */
function chosenAxis(state: State): { direction: Vector; point: Vector; order: number } | null {
  const item = itemById(state, state.selected);
  const source = item?.kind === "axis" && !item.reason ? sourceOf(item, state) : null;
  if (!source || !("order" in source) || !source.order) return null;
  return { direction: source.direction, point: source.point, order: source.order };
}

function describe(done: Partial<Completion>, symmetrized: boolean): string {
  const { faces_added: faces = 0, area_added: area = 0 } = done;
  const averaged = symmetrized ? " Both halves are averaged." : "";
  if (faces === 0) return `Nothing was missing.${averaged}`;
  return `${plural(faces, "face")} added, ${short(100 * area)} % more surface.${averaged}`;
}

const stem = (name: string): string => name.replace(/\.[^.]*$/, "");
