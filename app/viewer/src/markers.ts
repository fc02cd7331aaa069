/** All planes and axes of the scene: which are shown, how strongly, and which one is under the pointer. */

import { Group, Mesh, type Material, type Object3D } from "three";
import { AxisView } from "./axisview";
import { errorColor } from "./colors";
import type { Item } from "./items";
import { PlaneView } from "./planeview";
import type { Vector } from "./result";
import { subject, type State } from "./store";

export type Emphasis = "normal" | "strong" | "faint";

export interface Marker {
  readonly object: Object3D;
  /** What the pointer has to meet. */
  readonly target: Object3D;
  /** `crowd`: how many of its kind are shown; each is the fainter or thinner for it. */
  paint(color: string, emphasis: Emphasis, crowd: number): void;
}

/** The colour of what was turned down. */
const REJECTED = "#8a93a0";

export class Markers {
  readonly group = new Group();
  private readonly markers = new Map<string, Marker>();
  private corners: Float32Array = new Float32Array();
  private up: Vector = [0, 1, 0];

  /** Forget all; the next `update` draws anew. */
  clear(corners: Float32Array, up: Vector): void {
    this.corners = corners;
    this.up = up;
    for (const { object } of this.markers.values()) {
      this.group.remove(object);
      object.traverse(dispose);
    }
    this.markers.clear();
  }

  update(state: State): void {
    const strong = state.hovered ?? state.selected;
    const visible = state.items.filter((item) => isShown(item, state));
    const planes = visible.filter((item) => item.kind === "plane").length;
    const crowd = { plane: Math.max(1, planes), axis: Math.max(1, visible.length - planes) };
    for (const item of state.items) {
      const shown = isShown(item, state);
      if (shown && !this.markers.has(item.id)) this.add(item);
      const marker = this.markers.get(item.id);
      if (!marker) continue;
      marker.object.visible = shown;
      const color = item.reason
        ? REJECTED
        : errorColor(item.error, state.answered?.maxError ?? state.maxError);
      const emphasis =
        item.id !== strong ? (strong ? "faint" : "normal") : state.view === "mesh" ? "strong" : "normal";
      marker.paint(color, emphasis, crowd[item.kind]);
    }
  }

  /** The ids of what can be seen. */
  shown(): string[] {
    return [...this.markers].filter(([, { object }]) => object.visible).map(([id]) => id);
  }

  /** The targets of the pointer that can be seen. */
  targets(): Object3D[] {
    return [...this.markers.values()].filter(({ object }) => object.visible).map(({ target }) => target);
  }

  /** The id of the item whose target this is. */
  idOf(target: Object3D | null): string | null {
    for (const [id, marker] of this.markers) if (marker.target === target) return id;
    return null;
  }

  /** Made when first shown: dozens of candidates would cost time for nothing. */
  private add(item: Item): void {
    const marker =
      item.kind === "plane" ? new PlaneView(item, this.corners, this.up) : new AxisView(item, this.corners);
    this.markers.set(item.id, marker);
    this.group.add(marker.object);
  }
}

/** Results unless switched off; what was turned down only while it is looked at; in previews, their subject alone. */
function isShown(item: Item, state: State): boolean {
  if (item.id === state.hovered) return true;
  if (state.view !== "mesh") return item.id === subject(state)?.id && !state.hidden.has(item.id);
  if (item.reason) return item.id === state.selected;
  return !state.hidden.has(item.id);
}

function dispose(object: Object3D): void {
  if (!(object instanceof Mesh)) return;
  (object.geometry as { dispose(): void }).dispose();
  (object.material as Material).dispose();
}
