/** Lengths in the picture: a grid on the ground with round numbers, and a ruler from the origin to what is chosen. */

import {
  BufferGeometry,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Vector3,
} from "three";
import { byId, h } from "./dom";
import { coordinate, unitSign } from "./format";
import { sourceOf } from "./list";
import type { DetectResult, Vector } from "./result";
import type { Stage } from "./stage";
import { itemById, type State, type Store, type Up } from "./store";
import { across, add, dot, scaled, subtract } from "./vector";

/** So many lines there are about across a shape. */
const LINES = 10;
const COLORS: Record<State["theme"], { grid: string; ruler: string }> = {
  light: { grid: "#a9b2be", ruler: "#1b222c" },
  dark: { grid: "#3c4655", ruler: "#e7ebf0" },
};

/** The largest of 1, 2, 5, 10, 20 and so on that is not larger. */
export function roundStep(length: number): number {
  const power = 10 ** Math.floor(Math.log10(length) + 1e-9);
  const digit = [5, 2, 1].find((candidate) => candidate * power <= length * (1 + 1e-9)) ?? 1;
  return Number((digit * power).toPrecision(1));
}

/** The distance between the lines of the grid, in the file's units. */
export const gridStep = (result: DetectResult): number => roundStep(result.frame.scale / LINES);

/** Ends of lines in the unit frame, six numbers each: round coordinates of the file, on the ground under the mesh. */
export function gridLines(result: DetectResult, up: Up): number[] {
  const { center, scale } = result.frame;
  const [low, high] = result.mesh.bounds;
  const height = up === "y" ? 1 : 2;
  const step = gridStep(result);
  const sides = [0, 1, 2].filter((axis) => axis !== height);
  const from = (axis: number): number => Math.floor(low[axis] / step - 1) * step;
  const to = (axis: number): number => Math.ceil(high[axis] / step + 1) * step;
  const lines: number[] = [];
  for (const [along, over] of [sides, [...sides].reverse()]) {
    const count = Math.round((to(over) - from(over)) / step);
    for (let k = 0; k <= count; k++) {
      for (const end of [from(along), to(along)]) {
        const point: Vector = [0, 0, 0];
        point[height] = low[height];
        point[over] = from(over) + k * step;
        point[along] = end;
        lines.push(...scaled(subtract(point, center), 1 / scale));
      }
    }
  }
  return lines;
}

/** From the file's origin to the nearest point of a plane or axis, in the file's coordinates. */
export function rulerEnds(
  source: { normal: Vector; offset: number } | { direction: Vector; point: Vector },
): [Vector, Vector] {
  if ("normal" in source) return [[0, 0, 0], scaled(source.normal, -source.offset)];
  const { direction, point } = source;
  return [[0, 0, 0], subtract(point, scaled(direction, dot(direction, point)))];
}

const lines = (): LineSegments<BufferGeometry, LineBasicMaterial> =>
  new LineSegments(new BufferGeometry(), new LineBasicMaterial({ transparent: true }));

export function attachMeasure(store: Store, stage: Stage): void {
  const [grid, ruler] = [lines(), lines()];
  const group = new Group();
  group.add(grid, ruler);
  ruler.material.depthTest = false;
  ruler.renderOrder = 3;
  stage.scene.add(group);
  const label = h("span", { class: "ruler-label", hidden: true });
  byId("picture").append(label);
  let middle = new Vector3();
  stage.onFrame(place);

  store.subscribe((state, before) => {
    const { result, surface, up, theme } = state;
    const shown = result !== null && surface !== null;
    grid.visible = shown && state.grid;
    grid.material.color.set(COLORS[theme].grid);
    ruler.material.color.set(COLORS[theme].ruler);
    if (grid.visible && (state.grid !== before.grid || result !== before.result || up !== before.up))
      fill(grid, gridLines(result!, up));
    const item = itemById(state, state.selected);
    const source = item && sourceOf(item, state);
    ruler.visible = shown && state.ruler && Boolean(source);
    label.hidden = !ruler.visible;
    if (ruler.visible && source) showRuler(result!, rulerEnds(source as Parameters<typeof rulerEnds>[0]));
    stage.canvas.dataset.grid = grid.visible ? String(gridStep(result!)) : "";
    stage.render();
  });

  /** A line with a tick at every step of the grid, and its length. */
  function showRuler(result: DetectResult, [origin, foot]: [Vector, Vector]): void {
    const { center, scale, units } = result.frame;
    const toUnit = (point: Vector): Vector => scaled(subtract(point, center), 1 / scale);
    const length = Math.hypot(...subtract(foot, origin));
    const ends = [toUnit(origin), toUnit(foot)];
    const segments = [...ends[0], ...ends[1]];
    const step = gridStep(result);
    if (length > 0 && length < 1000 * step) {
      const along = scaled(subtract(foot, origin), 1 / length);
      const [side] = across(along, [0, 1, 0]);
      const tick = scaled(side, 0.1 * step);
      for (let at = 0; at <= length + 1e-9 * step; at += step) {
        const point = add(origin, scaled(along, at));
        segments.push(...toUnit(subtract(point, tick)), ...toUnit(add(point, tick)));
      }
    }
    fill(ruler, segments);
    middle = new Vector3(...scaled(add(ends[0], ends[1]), 0.5));
    label.textContent = `${coordinate(length, scale)} ${unitSign(units)} from the origin`.replace("  ", " ");
  }

  function place(): void {
    if (label.hidden) return;
    const [x, y] = stage.pixelOf(middle);
    const inside = (value: number, size: number): number =>
      Math.min(Math.max(value, 70), Math.max(size - 70, 70));
    label.style.left = `${inside(x, stage.canvas.clientWidth)}px`;
    label.style.top = `${inside(y, stage.canvas.clientHeight)}px`;
  }
}

function fill(target: LineSegments, positions: number[]): void {
  target.geometry.dispose();
  target.geometry = new BufferGeometry();
  target.geometry.setAttribute("position", new Float32BufferAttribute(positions, 3));
}
