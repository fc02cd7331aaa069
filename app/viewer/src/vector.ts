/** Three numbers and what one does with them. */

import type { Vector } from "./result";

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scaled = (a: Vector, by: number): Vector => [a[0] * by, a[1] * by, a[2] * by];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a: Vector): number => Math.hypot(a[0], a[1], a[2]);
export const unit = (a: Vector): Vector => scaled(a, 1 / (length(a) || 1));

export const cross = (a: Vector, b: Vector): Vector => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

/** Two unit vectors that span the plane across `normal`; the second is as near to `up` as it can be. */
export function across(normal: Vector, up: Vector): [Vector, Vector] {
  let second = subtract(up, scaled(normal, dot(up, normal)));
  if (length(second) < 0.05) {
    const smallest = normal.map(Math.abs).indexOf(Math.min(...normal.map(Math.abs)));
    const helper: Vector = [0, 0, 0];
    helper[smallest] = 1;
    second = subtract(helper, scaled(normal, dot(helper, normal)));
  }
  second = unit(second);
  return [cross(second, normal), second];
}
