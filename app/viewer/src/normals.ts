/** Normals for display: smooth across gentle edges, sharp across the others. */

const CREASE = Math.cos((32 * Math.PI) / 180);
/** Above this many faces edges are too small to be seen, and time counts. */
const MOST_FACES = 400_000;

/** One normal a corner, for triangles given as nine numbers each. */
export function cornerNormals(corners: Float32Array): Float32Array {
  const faces = corners.length / 9;
  const flat = faceNormals(corners);
  const normals = new Float32Array(corners.length);
  if (faces > MOST_FACES) {
    for (let i = 0; i < corners.length; i++) normals[i] = flat.unit[3 * Math.floor(i / 9) + (i % 3)];
    return normals;
  }
  const { next, first } = cornersByPlace(corners);
  for (let corner = 0; corner < 3 * faces; corner++) {
    const own = 3 * Math.floor(corner / 3);
    let [x, y, z] = [0, 0, 0];
    for (let other = first[corner]; other >= 0; other = next[other]) {
      const face = 3 * Math.floor(other / 3);
      const cosine =
        flat.unit[own] * flat.unit[face] +
        flat.unit[own + 1] * flat.unit[face + 1] +
        flat.unit[own + 2] * flat.unit[face + 2];
      if (cosine < CREASE) continue;
      x += flat.weighted[face];
      y += flat.weighted[face + 1];
      z += flat.weighted[face + 2];
    }
    const size = Math.hypot(x, y, z);
    const scale = size > 0 ? 1 / size : 0;
    normals[3 * corner] = size > 0 ? x * scale : flat.unit[own];
    normals[3 * corner + 1] = size > 0 ? y * scale : flat.unit[own + 1];
    normals[3 * corner + 2] = size > 0 ? z * scale : flat.unit[own + 2];
  }
  return normals;
}

/** Of every face the unit normal, and the normal as long as twice its area. */
function faceNormals(corners: Float32Array): { unit: Float32Array; weighted: Float32Array } {
  const unit = new Float32Array(corners.length / 3);
  const weighted = new Float32Array(corners.length / 3);
  for (let at = 0, to = 0; at < corners.length; at += 9, to += 3) {
    const [ux, uy, uz] = [
      corners[at + 3] - corners[at],
      corners[at + 4] - corners[at + 1],
      corners[at + 5] - corners[at + 2],
    ];
    const [vx, vy, vz] = [
      corners[at + 6] - corners[at],
      corners[at + 7] - corners[at + 1],
      corners[at + 8] - corners[at + 2],
    ];
    const [x, y, z] = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
    const size = Math.hypot(x, y, z) || 1;
    weighted.set([x, y, z], to);
    unit.set([x / size, y / size, z / size], to);
  }
  return { unit, weighted };
}

/** Corners at the same place as linked lists: `first[corner]` starts the list of its place, `next` goes on. */
function cornersByPlace(corners: Float32Array): { first: Int32Array; next: Int32Array } {
  const count = corners.length / 3;
  const bits = new Uint32Array(corners.buffer, corners.byteOffset, corners.length);
  const mask = 2 ** Math.ceil(Math.log2(2 * count + 2)) - 1;
  const table = new Int32Array(mask + 1).fill(-1);
  const head = new Int32Array(count);
  const last = new Int32Array(count);
  const next = new Int32Array(count).fill(-1);
  for (let corner = 0; corner < count; corner++) {
    const at = 3 * corner;
    let slot =
      (Math.imul(bits[at], 0x9e3779b1) ^
        Math.imul(bits[at + 1], 0x85ebca6b) ^
        Math.imul(bits[at + 2], 0xc2b2ae35)) >>>
      0;
    slot = (slot ^ (slot >>> 15)) & mask;
    for (;;) {
      const found = table[slot];
      if (found < 0) {
        table[slot] = head[corner] = last[corner] = corner;
        break;
      }
      const other = 3 * found;
      // Compared as numbers: 0 and -0 are one place, though they may start two lists, which costs a crease at most.
      if (
        corners[other] === corners[at] &&
        corners[other + 1] === corners[at + 1] &&
        corners[other + 2] === corners[at + 2]
      ) {
        head[corner] = found;
        next[last[found]] = corner;
        last[found] = corner;
        break;
      }
      slot = (slot + 1) & mask;
    }
  }
  return { first: head, next };
}
