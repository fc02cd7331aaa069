/** Where a plane cuts the surface. */

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
