/** Meshes for the tests. */

/** The corners of a cube of edge 2 around the origin, nine numbers a triangle. */
export function cube(): Float32Array {
  const corners: number[] = [];
  for (let axis = 0; axis < 3; axis++) {
    for (const side of [-1, 1]) {
      const point = (u: number, v: number): number[] => {
        const p = [0, 0, 0];
        p[axis] = side;
        p[(axis + 1) % 3] = u;
        p[(axis + 2) % 3] = v;
        return p;
      };
      corners.push(...point(-1, -1), ...point(1, -1), ...point(1, 1));
      corners.push(...point(-1, -1), ...point(1, 1), ...point(-1, 1));
    }
  }
  return new Float32Array(corners);
}

/** The same numbers every time, between 0 and 1. */
export function noise(seed: number): () => number {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

/** Triangles anywhere in the unit cube. */
export function soup(count: number, seed = 1): Float32Array {
  const next = noise(seed);
  return new Float32Array(9 * count).map(() => next());
}
