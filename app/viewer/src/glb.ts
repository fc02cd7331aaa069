/** Reads the annotated GLB that `POST /detect?format=glb` answers with: the mesh as triangles, and the result. */

import type { DetectResult } from "./result";

/** Corners of triangles one after the other, nine numbers each, input frame. */
export interface AnnotatedMesh {
  corners: Float64Array;
  /** Red, green and blue of every corner in linear light, if the mesh has colours. */
  colors: Float32Array | null;
  result: DetectResult;
}

interface Node {
  name?: string;
  mesh?: number;
  children?: number[];
  /** Column after column. */
  matrix?: number[];
  extras?: { result?: DetectResult };
}

interface Document {
  nodes: Node[];
  meshes: {
    primitives: { attributes: { POSITION: number; COLOR_0?: number }; indices?: number; mode?: number }[];
  }[];
  accessors: {
    bufferView: number;
    byteOffset?: number;
    componentType: number;
    count: number;
    type: string;
  }[];
  bufferViews: { byteOffset?: number; byteLength: number; byteStride?: number }[];
}

/** The name of the node that holds the mesh itself; planes and axes are its neighbours. */
const MESH = "mesh";

const JSON_CHUNK = 0x4e4f534a;
const BINARY_CHUNK = 0x004e4942;

/** Throws an Error if the bytes are not what the service writes. */
export function readAnnotated(bytes: ArrayBuffer): AnnotatedMesh {
  const [document, binary] = chunks(bytes);
  const node = document.nodes.find((candidate) => candidate.name === MESH && candidate.mesh !== undefined);
  if (!node) throw new Error("The GLB holds no mesh.");
  const result = node.extras?.result;
  if (!result) throw new Error("The GLB holds no result.");
  return { corners: cornersOf(document, binary, node), colors: colorsOf(document, binary, node), result };
}

function chunks(bytes: ArrayBuffer): [Document, ArrayBuffer] {
  const view = new DataView(bytes);
  if (view.byteLength < 20 || view.getUint32(0, true) !== 0x46546c67) throw new Error("This is no GLB.");
  let document: Document | null = null;
  let binary = new ArrayBuffer(0);
  for (let at = 12; at + 8 <= view.byteLength;) {
    const length = view.getUint32(at, true);
    const kind = view.getUint32(at + 4, true);
    const content = bytes.slice(at + 8, at + 8 + length);
    if (kind === JSON_CHUNK) document = JSON.parse(new TextDecoder().decode(content)) as Document;
    if (kind === BINARY_CHUNK) binary = content;
    at += 8 + length;
  }
  if (!document) throw new Error("The GLB has no JSON.");
  return [document, binary];
}

function cornersOf(document: Document, binary: ArrayBuffer, node: Node): Float64Array {
  const place = placement(node);
  const parts = document.meshes[node.mesh!].primitives.map((primitive) => {
    const points = accessor(document, binary, primitive.attributes.POSITION);
    const indices = primitive.indices === undefined ? null : accessor(document, binary, primitive.indices);
    const count = indices ? indices.length : points.length / 3;
    const corners = new Float64Array(3 * count);
    for (let i = 0; i < count; i++) {
      const from = 3 * (indices ? indices[i] : i);
      place(points[from], points[from + 1], points[from + 2], corners, 3 * i);
    }
    return corners;
  });
  if (parts.length === 1) return parts[0];
  const all = new Float64Array(parts.reduce((total, part) => total + part.length, 0));
  parts.reduce((at, part) => (all.set(part, at), at + part.length), 0);
  return all;
}

/** The service writes colours as four numbers of 16 bits a vertex, or none. */
function colorsOf(document: Document, binary: ArrayBuffer, node: Node): Float32Array | null {
  const { primitives } = document.meshes[node.mesh!];
  if (primitives.length !== 1 || primitives[0].attributes.COLOR_0 === undefined) return null;
  const values = accessor(document, binary, primitives[0].attributes.COLOR_0);
  const indices =
    primitives[0].indices === undefined ? null : accessor(document, binary, primitives[0].indices);
  const count = indices ? indices.length : values.length / 4;
  const colors = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) {
    const from = 4 * (indices ? indices[i] : i);
    for (let channel = 0; channel < 3; channel++) colors[3 * i + channel] = values[from + channel] / 65535;
  }
  return colors;
}

/** The service moves and scales the mesh at most, to keep the digits of coordinates far from the origin. */
function placement(node: Node) {
  const [sx, a, b, , c, sy, d, , e, f, sz, , tx, ty, tz] = node.matrix ?? [
    1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0,
  ];
  if (a || b || c || d || e || f) throw new Error("The GLB turns its mesh, which is not expected.");
  return (x: number, y: number, z: number, target: Float64Array, at: number): void => {
    target[at] = x * sx + tx;
    target[at + 1] = y * sy + ty;
    target[at + 2] = z * sz + tz;
  };
}

function accessor(
  document: Document,
  binary: ArrayBuffer,
  index: number,
): Float32Array | Uint32Array | Uint16Array {
  const { bufferView, byteOffset = 0, componentType, count, type } = document.accessors[index];
  const view = document.bufferViews[bufferView];
  const start = (view.byteOffset ?? 0) + byteOffset;
  const items = count * ({ VEC3: 3, VEC4: 4 }[type] ?? 1);
  if (view.byteStride && view.byteStride !== 12) throw new Error("The GLB interleaves its vertices.");
  if (componentType === 5126) return new Float32Array(binary, start, items);
  if (componentType === 5125) return new Uint32Array(binary, start, items);
  if (componentType === 5123) return new Uint16Array(binary, start, items);
  throw new Error("The GLB has numbers of a kind that is not expected.");
}
