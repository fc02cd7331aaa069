/** Reads the annotated GLB that `POST /detect?format=glb` answers with: the mesh as triangles, and the result. */

import type { DetectResult } from "./result";

/** Corners of triangles one after the other, nine numbers each, input frame. */
export interface AnnotatedMesh {
  corners: Float64Array;
  /** Red, green and blue of every corner in linear light, if the mesh has colours. */
  colors: Float32Array | null;
  /** Where every corner is in its picture, two numbers each, from the upper left; with pictures only. */
  places: Float32Array | null;
  pictures: LaidPicture[];
  result: DetectResult;
}

/** A picture on the triangles whose corners are the `count` from `start` on. */
export interface LaidPicture {
  content: Blob;
  start: number;
  count: number;
}

interface Primitive {
  attributes: { POSITION: number; COLOR_0?: number; TEXCOORD_0?: number };
  indices?: number;
  material?: number;
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
  meshes: { primitives: Primitive[] }[];
  materials?: { pbrMetallicRoughness?: { baseColorTexture?: { index: number } } }[];
  textures?: { source?: number; extensions?: Record<string, { source: number }> }[];
  images?: { bufferView: number; mimeType: string }[];
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
  const { primitives } = document.meshes[node.mesh!];
  const pictures = picturesOf(document, binary, primitives);
  return {
    corners: cornersOf(document, binary, node),
    colors: attributeOf(document, binary, primitives, ({ COLOR_0 }) => COLOR_0, 4, 3, 65535),
    places:
      pictures.length > 0
        ? attributeOf(document, binary, primitives, ({ TEXCOORD_0 }) => TEXCOORD_0, 2, 2, 1)
        : null,
    pictures,
    result,
  };
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

/** How many corners of triangles a primitive has. */
const cornersIn = (document: Document, { indices, attributes }: Primitive): number =>
  document.accessors[indices ?? attributes.POSITION].count;

/** The first `kept` of the `width` numbers that every corner has, divided; or null where a part has none. */
function attributeOf(
  document: Document,
  binary: ArrayBuffer,
  primitives: Primitive[],
  which: (attributes: Primitive["attributes"]) => number | undefined,
  width: number,
  kept: number,
  divisor: number,
): Float32Array | null {
  const total = primitives.reduce((sum, primitive) => sum + cornersIn(document, primitive), 0);
  const found = new Float32Array(kept * total);
  let at = 0;
  for (const primitive of primitives) {
    const index = which(primitive.attributes);
    if (index === undefined) return null;
    const values = accessor(document, binary, index);
    const indices = primitive.indices === undefined ? null : accessor(document, binary, primitive.indices);
    const count = cornersIn(document, primitive);
    for (let i = 0; i < count; i++) {
      const from = width * (indices ? indices[i] : i);
      for (let k = 0; k < kept; k++) found[at++] = values[from + k] / divisor;
    }
  }
  return found;
}

function picturesOf(document: Document, binary: ArrayBuffer, primitives: Primitive[]): LaidPicture[] {
  const pictures: LaidPicture[] = [];
  let start = 0;
  for (const primitive of primitives) {
    const count = cornersIn(document, primitive);
    const used = document.materials?.[primitive.material ?? -1]?.pbrMetallicRoughness?.baseColorTexture;
    const texture = used && document.textures?.[used.index];
    const source = texture?.source ?? Object.values(texture?.extensions ?? {})[0]?.source;
    const image = document.images?.[source ?? -1];
    if (image) {
      const { byteOffset = 0, byteLength } = document.bufferViews[image.bufferView];
      const content = new Blob([binary.slice(byteOffset, byteOffset + byteLength)], { type: image.mimeType });
      pictures.push({ content, start, count });
    }
    start += count;
  }
  return pictures;
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
  const items = count * ({ VEC2: 2, VEC3: 3, VEC4: 4 }[type] ?? 1);
  if (view.byteStride && view.byteStride !== 12) throw new Error("The GLB interleaves its vertices.");
  if (componentType === 5126) return new Float32Array(binary, start, items);
  if (componentType === 5125) return new Uint32Array(binary, start, items);
  if (componentType === 5123) return new Uint16Array(binary, start, items);
  throw new Error("The GLB has numbers of a kind that is not expected.");
}
