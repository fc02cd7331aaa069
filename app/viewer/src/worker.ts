/** Measures, away from the page's own thread, how far the moved surface is from the surface. Unit frame. */

import { TriangleTree } from "./bvh";
import { subdivided, type Lattice } from "./subdivide";

export type Request =
  | { kind: "mesh"; corners: Float32Array<ArrayBuffer>; normals: Float32Array<ArrayBuffer> }
  | { kind: "measure"; job: number; transform: number[] };

export type Answer =
  | { kind: "lattice"; lattice: Lattice }
  | { kind: "progress"; job: number; done: number }
  | { kind: "distances"; job: number; distances: Float32Array<ArrayBuffer>; largest: number };

const MOST_TRIANGLES = 120_000;
/** Vertices between two looks at what has come in; a multiple of three. */
const CHUNK = 9_000;

let corners = new Float32Array();
let tree: TriangleTree | null = null;
let lattice: Lattice | null = null;
let normals = new Float32Array();
let latest = 0;

const answer = (message: Answer, transfer: Transferable[] = []): void =>
  self.postMessage(message, { transfer });
const pause = (): Promise<void> => new Promise((resolve) => setTimeout(resolve));

self.onmessage = (event: MessageEvent<Request>): void => {
  const message = event.data;
  if (message.kind === "mesh") {
    ({ corners, normals } = message);
    tree = lattice = null;
    return;
  }
  latest = message.job;
  void measure(message.job, message.transform);
};

/** Stops when another job has come in: between chunks the worker listens. */
async function measure(job: number, transform: number[]): Promise<void> {
  tree ??= new TriangleTree(corners);
  if (!lattice) {
    lattice = subdivided(corners, normals, MOST_TRIANGLES);
    answer({ kind: "lattice", lattice });
  }
  const { positions } = lattice;
  const count = positions.length / 3;
  const distances = new Float32Array(count);
  const [a, b, c, d, e, f, g, h, i, j, k, l] = transform;
  let largest = 0;
  // Of so many triangles none is cut, and each has three vertices of its own: its centre stands for all three.
  const together = corners.length / 9 > MOST_TRIANGLES ? 3 : 1;
  for (let from = 0; from < count; from += CHUNK) {
    for (let at = from; at < Math.min(count, from + CHUNK); at += together) {
      const [x, y, z] = centre(positions, at, together);
      const squared = tree.squaredDistance(
        a * x + b * y + c * z + d,
        e * x + f * y + g * z + h,
        i * x + j * y + k * z + l,
      );
      distances.fill(Math.sqrt(squared), at, at + together);
      largest = Math.max(largest, distances[at]);
    }
    answer({ kind: "progress", job, done: Math.min(1, (from + CHUNK) / count) });
    await pause();
    if (job !== latest) return;
  }
  answer({ kind: "distances", job, distances, largest }, [distances.buffer]);
}

/** The middle of `number` points from the one at `first` on. */
function centre(positions: Float32Array, first: number, number: number): [number, number, number] {
  let [x, y, z] = [0, 0, 0];
  for (let at = 3 * first; at < 3 * (first + number); at += 3) {
    x += positions[at] / number;
    y += positions[at + 1] / number;
    z += positions[at + 2] / number;
  }
  return [x, y, z];
}
