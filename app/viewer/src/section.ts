/** Where a plane cuts the surface, and on which side of it there is more. */

import type { Vector } from "./result";
import { dot } from "./vector";

const ON_PLANE = 1e-6;

/** Segments, six numbers each, in which the plane through `point` meets the triangles (nine numbers each). */
export function section(corners: Float32Array, normal: Vector, point: Vector): Float32Array {
  const offset = dot(normal, point);
  const [nx, ny, nz] = normal;
  const segments: number[] = [];
  const height = [0, 0, 0];
  for (let at = 0; at < corners.length; at += 9) {
    for (let k = 0; k < 3; k++) {
      const i = at + 3 * k;
      const value = nx * corners[i] + ny * corners[i + 1] + nz * corners[i + 2] - offset;
      height[k] = Math.abs(value) < ON_PLANE ? 0 : value;
    }
    if (height[0] > 0 && height[1] > 0 && height[2] > 0) continue;
    if (height[0] < 0 && height[1] < 0 && height[2] < 0) continue;
    // A face that lies in the plane has no one line in it; its neighbours show its outline.
    if (height[0] === 0 && height[1] === 0 && height[2] === 0) continue;
    const ends: number[] = [];
    for (let k = 0; k < 3; k++) {
      const next = (k + 1) % 3;
      const [i, j] = [at + 3 * k, at + 3 * next];
      if (height[k] === 0) {
        ends.push(corners[i], corners[i + 1], corners[i + 2]);
      } else if (height[k] * height[next] < 0) {
        const t = height[k] / (height[k] - height[next]);
        for (let c = 0; c < 3; c++) ends.push(corners[i + c] + t * (corners[j + c] - corners[i + c]));
      }
    }
    if (ends.length === 6) segments.push(...ends);
  }
  return new Float32Array(segments);
}

/** On which side of a plane there is more surface, each triangle counted where its centre is: where a part is missing, the other half is the one to mirror. */
export function fullerSide(corners: ArrayLike<number>, normal: Vector, point: Vector): 1 | -1 {
  const offset = dot(normal, point);
  const [nx, ny, nz] = normal;
  let balance = 0;
  for (let at = 0; at < corners.length; at += 9) {
    const [ux, uy, uz] = [0, 1, 2].map((k) => corners[at + 3 + k] - corners[at + k]);
    const [vx, vy, vz] = [0, 1, 2].map((k) => corners[at + 6 + k] - corners[at + k]);
    const area = Math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx);
    const [x, y, z] = [0, 1, 2].map((k) => (corners[at + k] + corners[at + 3 + k] + corners[at + 6 + k]) / 3);
    balance += area * Math.sign(nx * x + ny * y + nz * z - offset);
  }
  return balance < 0 ? -1 : 1;
}
