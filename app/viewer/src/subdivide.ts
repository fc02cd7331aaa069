/** Cuts large triangles into smaller ones, so that a colour for every vertex shows what happens between corners. */

export interface Lattice {
  positions: Float32Array;
  normals: Float32Array;
  indices: Uint32Array;
}

/** Edges are cut down to this length, unit frame, unless that makes too many triangles. */
const FINEST = 1 / 72;

/** The triangles (nine numbers each, with a normal a corner) cut into at most about `most` of equal coloured corners. */
export function subdivided(corners: Float32Array, normals: Float32Array, most: number): Lattice {
  const cuts = cutsFor(corners, most);
  let [vertices, triangles] = [0, 0];
  for (const k of cuts) {
    vertices += ((k + 1) * (k + 2)) / 2;
    triangles += k * k;
  }
  const result = {
    positions: new Float32Array(3 * vertices),
    normals: new Float32Array(3 * vertices),
    indices: new Uint32Array(3 * triangles),
  };
  let [vertex, index] = [0, 0];
  cuts.forEach((k, face) => {
    const base = vertex;
    for (let row = 0; row <= k; row++) {
      for (let column = 0; column <= k - row; column++) {
        blend(corners, 9 * face, column / k, row / k, result.positions, 3 * vertex);
        blend(normals, 9 * face, column / k, row / k, result.normals, 3 * vertex);
        vertex++;
      }
    }
    for (let row = 0, start = base; row < k; start += k - row + 1, row++) {
      const above = start + k - row + 1;
      for (let column = 0; column < k - row; column++) {
        result.indices.set([start + column, start + column + 1, above + column], index);
        index += 3;
        if (column === k - row - 1) continue;
        result.indices.set([start + column + 1, above + column + 1, above + column], index);
        index += 3;
      }
    }
  });
  return result;
}

/** Into how many parts the edges of each triangle are cut. */
function cutsFor(corners: Float32Array, most: number): Uint16Array {
  const longest = new Float32Array(corners.length / 9).map((_, face) => longestEdge(corners, 9 * face));
  const cuts = new Uint16Array(longest.length);
  for (let size = FINEST; ; size *= 1.3) {
    let total = 0;
    longest.forEach((edge, face) => {
      cuts[face] = Math.max(1, Math.ceil(edge / size));
      total += cuts[face] ** 2;
    });
    if (total <= most || total === longest.length) return cuts;
  }
}

function longestEdge(c: Float32Array, at: number): number {
  const edge = (i: number, j: number) =>
    Math.hypot(c[at + i] - c[at + j], c[at + i + 1] - c[at + j + 1], c[at + i + 2] - c[at + j + 2]);
  return Math.max(edge(0, 3), edge(3, 6), edge(6, 0));
}

function blend(
  values: Float32Array,
  at: number,
  s: number,
  t: number,
  target: Float32Array,
  to: number,
): void {
  for (let k = 0; k < 3; k++) {
    target[to + k] = (1 - s - t) * values[at + k] + s * values[at + 3 + k] + t * values[at + 6 + k];
  }
}
