/** Exact distances from points to triangles, through a tree of boxes. */

const LEAF = 6;

/** A tree over triangles given as nine numbers each. */
export class TriangleTree {
  /** Six numbers a node: smallest and largest corner. */
  private readonly boxes: Float32Array;
  /** The first triangle of a leaf, or the second child of an inner node; the first child is the next node. */
  private readonly start: Int32Array;
  /** How many triangles a leaf holds; 0 for an inner node. */
  private readonly size: Int32Array;
  private readonly order: Uint32Array;
  private readonly stack = new Int32Array(128);
  private nodes = 0;

  constructor(private readonly corners: Float32Array) {
    const faces = corners.length / 9;
    const most = Math.max(1, 2 * Math.ceil(faces / Math.ceil(LEAF / 2)));
    this.boxes = new Float32Array(6 * most);
    this.start = new Int32Array(most);
    this.size = new Int32Array(most);
    this.order = new Uint32Array(faces).map((_, index) => index);
    const centres = new Float32Array(3 * faces);
    for (let face = 0; face < faces; face++) {
      for (let k = 0; k < 3; k++) {
        const at = 9 * face + k;
        centres[3 * face + k] = (corners[at] + corners[at + 3] + corners[at + 6]) / 3;
      }
    }
    this.build(centres, 0, faces);
  }

  private build(centres: Float32Array, from: number, to: number): void {
    const node = this.nodes++;
    this.bound(node, from, to);
    if (to - from <= LEAF) {
      this.start[node] = from;
      this.size[node] = to - from;
      return;
    }
    const middle = (from + to) >> 1;
    this.split(centres, from, to, middle, this.longest(node));
    this.build(centres, from, middle);
    this.start[node] = this.nodes;
    this.build(centres, middle, to);
  }

  private bound(node: number, from: number, to: number): void {
    for (let k = 0; k < 3; k++) {
      let [low, high] = [Infinity, -Infinity];
      for (let i = from; i < to; i++) {
        for (let at = 9 * this.order[i] + k, corner = 0; corner < 3; corner++, at += 3) {
          low = Math.min(low, this.corners[at]);
          high = Math.max(high, this.corners[at]);
        }
      }
      this.boxes[6 * node + k] = low;
      this.boxes[6 * node + 3 + k] = high;
    }
  }

  private longest(node: number): number {
    const at = 6 * node;
    const extent = [0, 1, 2].map((k) => this.boxes[at + 3 + k] - this.boxes[at + k]);
    return extent.indexOf(Math.max(...extent));
  }

  /** Reorders triangles so that the `middle`-th by its centre stands in its place, the smaller before it. */
  private split(centres: Float32Array, from: number, to: number, middle: number, axis: number): void {
    const { order } = this;
    let [low, high] = [from, to - 1];
    while (low < high) {
      const pivot = centres[3 * order[(low + high) >> 1] + axis];
      let [i, j] = [low, high];
      while (i <= j) {
        while (centres[3 * order[i] + axis] < pivot) i++;
        while (centres[3 * order[j] + axis] > pivot) j--;
        if (i <= j) {
          const swapped = order[i];
          order[i++] = order[j];
          order[j--] = swapped;
        }
      }
      if (middle <= j) high = j;
      else if (middle >= i) low = i;
      else return;
    }
  }

  /** The squared distance to the nearest triangle. */
  squaredDistance(x: number, y: number, z: number): number {
    const { stack, start, size } = this;
    let best = Infinity;
    let depth = 0;
    stack[depth++] = 0;
    while (depth > 0) {
      const node = stack[--depth];
      if (this.boxDistance(node, x, y, z) >= best) continue;
      if (size[node] > 0) {
        for (let i = start[node]; i < start[node] + size[node]; i++) {
          best = Math.min(best, triangleDistance(this.corners, 9 * this.order[i], x, y, z));
        }
        continue;
      }
      const [left, right] = [node + 1, start[node]];
      const leftFirst = this.boxDistance(left, x, y, z) < this.boxDistance(right, x, y, z);
      stack[depth++] = leftFirst ? right : left;
      stack[depth++] = leftFirst ? left : right;
    }
    return best;
  }

  private boxDistance(node: number, x: number, y: number, z: number): number {
    const { boxes } = this;
    const at = 6 * node;
    const dx = Math.max(boxes[at] - x, 0, x - boxes[at + 3]);
    const dy = Math.max(boxes[at + 1] - y, 0, y - boxes[at + 4]);
    const dz = Math.max(boxes[at + 2] - z, 0, z - boxes[at + 5]);
    return dx * dx + dy * dy + dz * dz;
  }
}

/** Squared distance to one triangle: to its plane above the inside, else to the nearest edge. */
export function triangleDistance(c: Float32Array, at: number, x: number, y: number, z: number): number {
  const [ax, ay, az] = [c[at], c[at + 1], c[at + 2]];
  const [bx, by, bz] = [c[at + 3], c[at + 4], c[at + 5]];
  const [cx, cy, cz] = [c[at + 6], c[at + 7], c[at + 8]];
  const [ux, uy, uz] = [bx - ax, by - ay, bz - az];
  const [vx, vy, vz] = [cx - ax, cy - ay, cz - az];
  const [px, py, pz] = [x - ax, y - ay, z - az];
  const uu = ux * ux + uy * uy + uz * uz;
  const uv = ux * vx + uy * vy + uz * vz;
  const vv = vx * vx + vy * vy + vz * vz;
  const area = uu * vv - uv * uv;
  if (area > 1e-14 * uu * vv) {
    const pu = px * ux + py * uy + pz * uz;
    const pv = px * vx + py * vy + pz * vz;
    const s = (vv * pu - uv * pv) / area;
    const t = (uu * pv - uv * pu) / area;
    if (s >= 0 && t >= 0 && s + t <= 1) {
      const [dx, dy, dz] = [px - s * ux - t * vx, py - s * uy - t * vy, pz - s * uz - t * vz];
      return dx * dx + dy * dy + dz * dz;
    }
  }
  return Math.min(
    segmentDistance(px, py, pz, ux, uy, uz),
    segmentDistance(px, py, pz, vx, vy, vz),
    segmentDistance(x - bx, y - by, z - bz, cx - bx, cy - by, cz - bz),
  );
}

/** Squared distance of p to the segment from the origin to u. */
function segmentDistance(px: number, py: number, pz: number, ux: number, uy: number, uz: number): number {
  const uu = ux * ux + uy * uy + uz * uz;
  const t = uu > 0 ? Math.min(1, Math.max(0, (px * ux + py * uy + pz * uz) / uu)) : 0;
  const [dx, dy, dz] = [px - t * ux, py - t * uy, pz - t * uz];
  return dx * dx + dy * dy + dz * dz;
}
