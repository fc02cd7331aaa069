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
const CHUNK = 8_000;

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
  for (let from = 0; from < count; from += CHUNK) {
    for (let at = from; at < Math.min(count, from + CHUNK); at++) {
      const [x, y, z] = [positions[3 * at], positions[3 * at + 1], positions[3 * at + 2]];
      const squared = tree.squaredDistance(
        a * x + b * y + c * z + d,
        e * x + f * y + g * z + h,
        i * x + j * y + k * z + l,
      );
      distances[at] = Math.sqrt(squared);
      largest = Math.max(largest, distances[at]);
    }
    answer({ kind: "progress", job, done: Math.min(1, (from + CHUNK) / count) });
    await pause();
    if (job !== latest) return;
  }
  answer({ kind: "distances", job, distances, largest }, [distances.buffer]);
}
