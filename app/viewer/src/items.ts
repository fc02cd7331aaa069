/**
 * The results as things to list and to draw: each has an id and lies in the unit frame, which the scene shows
 * (unit = (input - center) / scale, as the answer's `frame` says).
 */

import type { DetectResult, Evidence, Matrix, Reason, RejectedResult, SimilarResult, Vector } from "./result";
import { dot, scaled, subtract } from "./vector";

export type ItemKind = "plane" | "axis";

export interface Item {
  id: string;
  kind: ItemKind;
  /** What lists and messages call it. */
  name: string;
  /** The plane's normal, or the axis' direction. */
  direction: Vector;
  /** A point on it, unit frame. */
  point: Vector;
  /** Of an axis; null where every angle is a symmetry, or where none was told. */
  order: number | null;
  continuous: boolean;
  exact: boolean;
  evidence: Evidence;
  error: number;
  /** Input units. */
  rms: number;
  /** Why it is not among the results; null for a result. */
  reason: Reason | "similar" | null;
  /** The reflection or rotation in the unit frame: 12 numbers, three rows. */
  transform: number[];
}

/** Of a continuous axis every angle is a symmetry: this one (the golden angle) avoids all small orders. */
export const CONTINUOUS_ANGLE = Math.PI * (3 - Math.sqrt(5));

/** All results, planes first, then what is similar, then what was turned down. */
export function itemsOf(result: DetectResult): Item[] {
  const { center, scale } = result.frame;
  const toUnit = (point: Vector): Vector => scaled(subtract(point, center), 1 / scale);
  const items: Item[] = [];
  result.planes.forEach((plane, index) => {
    items.push({
      ...common(plane),
      id: `plane ${index}`,
      kind: "plane",
      name: `Plane ${index + 1}`,
      direction: plane.normal,
      point: toUnit(plane.point),
      order: null,
      transform: transformToUnit(plane.matrix, center, scale),
    });
  });
  result.axes.forEach((axis, index) => {
    const point = toUnit(axis.point);
    items.push({
      ...common(axis),
      id: `axis ${index}`,
      kind: "axis",
      name: `Axis ${index + 1}`,
      direction: axis.direction,
      point,
      order: axis.order,
      transform: axis.matrix
        ? transformToUnit(axis.matrix, center, scale)
        : rotation(axis.direction, point, CONTINUOUS_ANGLE),
    });
  });
  const others = (entries: (SimilarResult | RejectedResult)[], id: string) =>
    entries.forEach((entry, index) => {
      const isPlane = entry.kind === "plane";
      const direction = isPlane ? entry.normal : entry.direction;
      const point = toUnit(isPlane ? onPlane(entry.normal, entry.offset, center) : entry.point);
      items.push({
        id: `${id} ${index}`,
        kind: entry.kind,
        name: `Candidate ${index + 1}`,
        direction,
        point,
        order: null,
        continuous: false,
        exact: false,
        evidence: "measured",
        error: entry.symmetry_error,
        rms: Math.sqrt(entry.symmetry_error) * scale,
        reason: "reason" in entry ? entry.reason : "similar",
        transform: isPlane ? reflection(direction, point) : rotation(direction, point, CONTINUOUS_ANGLE),
      });
    });
  others(result.similar ?? [], "similar");
  others(result.rejected ?? [], "rejected");
  return items;
}

function common(entry: {
  symmetry_error: number;
  rms_distance: number;
  exact: boolean;
  evidence: Evidence;
  continuous: boolean;
}) {
  return {
    error: entry.symmetry_error,
    rms: entry.rms_distance,
    exact: entry.exact,
    evidence: entry.evidence,
    continuous: entry.continuous,
    reason: null,
  };
}

function onPlane(normal: Vector, offset: number, near: Vector): Vector {
  return subtract(near, scaled(normal, dot(normal, near) + offset));
}

/** A transform of input coordinates as one of unit coordinates. */
export function transformToUnit(matrix: Matrix, center: Vector, scale: number): number[] {
  return matrix.slice(0, 3).flatMap((row, index) => {
    const linear: Vector = [row[0], row[1], row[2]];
    return [...linear, (dot(linear, center) + row[3] - center[index]) / scale];
  });
}

/** The reflection in the plane through `point`. */
export function reflection(normal: Vector, point: Vector): number[] {
  const twice = 2 * dot(normal, point);
  return [0, 1, 2].flatMap((i) => [
    ...[0, 1, 2].map((j) => (i === j ? 1 : 0) - 2 * normal[i] * normal[j]),
    twice * normal[i],
  ]);
}

/** The rotation by `angle` about the axis through `point` (Rodrigues). */
export function rotation(axis: Vector, point: Vector, angle: number): number[] {
  const [x, y, z] = axis;
  const skew = [0, -z, y, z, 0, -x, -y, x, 0];
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return [0, 1, 2].flatMap((i) => {
    const row: Vector = [0, 1, 2].map(
      (j) => (i === j ? cos : 0) + sin * skew[3 * i + j] + (1 - cos) * axis[i] * axis[j],
    ) as Vector;
    return [...row, point[i] - dot(row, point)];
  });
}
