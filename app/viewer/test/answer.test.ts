import assert from "node:assert/strict";
import { test } from "node:test";
import { readAnnotated } from "../src/glb";
import { itemsOf, reflection, rotation, transformToUnit } from "../src/items";
import { levelWords, patchWords } from "../src/levels";
import type { DetectResult, Level, Vector } from "../src/result";
import { across, dot, length } from "../src/vector";

const RESULT = {
  planes: [
    {
      normal: [1, 0, 0],
      offset: -30,
      point: [30, 5, 7],
      matrix: [
        [-1, 0, 0, 60],
        [0, 1, 0, 0],
        [0, 0, 1, 0],
        [0, 0, 0, 1],
      ],
      symmetry_error: 1e-12,
      rms_distance: 1e-5,
      exact: true,
      continuous: false,
    },
  ],
  axes: [
    {
      direction: [0, 0, 1],
      point: [30, 5, 7],
      order: null,
      continuous: true,
      matrix: null,
      symmetry_error: 0,
      rms_distance: 0,
      exact: true,
    },
  ],
  frame: { coordinates: "input", units: null, center: [30, 5, 7], scale: 4 },
  similar: [{ kind: "axis", direction: [1, 0, 0], point: [30, 5, 9], symmetry_error: 1 }],
  rejected: [{ kind: "plane", normal: [0, 1, 0], offset: -9, symmetry_error: 4, reason: "not_symmetric" }],
} as unknown as DetectResult;

const apply = (transform: number[], p: Vector): number[] =>
  [0, 1, 2].map(
    (i) =>
      transform[4 * i] * p[0] +
      transform[4 * i + 1] * p[1] +
      transform[4 * i + 2] * p[2] +
      transform[4 * i + 3],
  );

const near = (a: number[], b: number[]): void =>
  a.forEach((value, i) => assert.ok(Math.abs(value - b[i]) < 1e-12, `${a} ${b}`));

/** A GLB as the service writes it: nodes, and a binary chunk with two triangles. */
function glb(nodes: object[]): ArrayBuffer {
  const document = {
    nodes,
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }],
    accessors: [
      { bufferView: 0, componentType: 5126, count: 4, type: "VEC3" },
      { bufferView: 1, componentType: 5125, count: 6, type: "SCALAR" },
    ],
    bufferViews: [
      { byteOffset: 0, byteLength: 48 },
      { byteOffset: 48, byteLength: 24 },
    ],
  };
  const text = JSON.stringify(document);
  const json = new TextEncoder().encode(text + " ".repeat((4 - (text.length % 4)) % 4));
  const binary = new ArrayBuffer(72);
  new Float32Array(binary, 0, 12).set([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0]);
  new Uint32Array(binary, 48, 6).set([0, 1, 2, 0, 2, 3]);
  const head = (length: number, kind: number) => new Uint8Array(new Uint32Array([length, kind]).buffer);
  const parts = [
    new Uint8Array(new Uint32Array([0x46546c67, 2, 0]).buffer),
    head(json.length, 0x4e4f534a),
    json,
    head(72, 0x4e4942),
    new Uint8Array(binary),
  ];
  const whole = new Uint8Array(parts.reduce((total, part) => total + part.length, 0));
  parts.reduce((at, part) => (whole.set(part, at), at + part.length), 0);
  return whole.buffer;
}

test("the mesh of an answer stands where its node moves it", () => {
  const matrix = [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 1e6, 20, 30, 1];
  const { corners, result } = readAnnotated(
    glb([{ name: "plane 0" }, { name: "mesh", mesh: 0, matrix, extras: { result: RESULT } }]),
  );
  assert.deepEqual(result, RESULT);
  assert.deepEqual([...corners.subarray(6, 9)], [1000002, 22, 30]);
  assert.equal(corners.length, 18);
});

test("an answer that is something else is refused", () => {
  assert.throws(() => readAnnotated(new ArrayBuffer(3)), /no GLB/);
  assert.throws(() => readAnnotated(glb([{ name: "mesh", mesh: 0 }])), /no result/);
  assert.throws(() => readAnnotated(glb([{ name: "other" }])), /no mesh/);
  const turned = [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  assert.throws(
    () => readAnnotated(glb([{ name: "mesh", mesh: 0, matrix: turned, extras: { result: RESULT } }])),
    /turns/,
  );
});

test("items lie in the unit frame", () => {
  const [plane, axis, similar, rejected] = itemsOf(RESULT);
  near(plane.point, [0, 0, 0]);
  near(apply(plane.transform, [0.25, 0.1, 0.2]), [-0.25, 0.1, 0.2]);
  assert.equal(axis.order, null);
  near(apply(axis.transform, [0, 0, 0.3]), [0, 0, 0.3]);
  assert.deepEqual([rejected.id, rejected.reason, rejected.rms], ["rejected 0", "not_symmetric", 8]);
  near(rejected.point, [0, 1, 0]);
  assert.deepEqual(
    [similar.id, similar.kind, similar.reason, similar.rms],
    ["similar 0", "axis", "similar", 4],
  );
  near(similar.point, [0, 0, 0.5]);
});

test("levels and what breaks them are told in words", () => {
  const patch = { center: [1, 2, 3] as Vector, size: 2, max_distance: 0.5, present: true };
  const level: Level = {
    point_group: "C4v",
    planes: 4,
    axes: 1,
    rms_distance: 0.25,
    next_rms_distance: null,
    missing: 0,
    exact: true,
    chosen: true,
    confidence: 1,
    evidence: "measured",
    breaks: [patch],
  };
  const metric = { ...RESULT, frame: { ...RESULT.frame, units: "millimeter" } };
  assert.equal(levelWords(level, metric), "rms 0.25 mm, exact, chosen");
  assert.equal(levelWords({ ...level, exact: null, chosen: false }, RESULT), "rms 0.25");
  assert.equal(patchWords(patch, metric), "without counterpart at (1, 2, 3), off by 0.5 mm");
  assert.equal(patchWords({ ...patch, present: false }, RESULT), "missing at (1, 2, 3), off by 0.5");
});

test("transforms keep their plane or axis, and mirror or turn the rest", () => {
  const normal: Vector = [0.6, 0, 0.8];
  const point: Vector = [0.1, 0.2, 0.3];
  near(apply(reflection(normal, point), point), point);
  const beyond = point.map((value, k) => value + 0.5 * normal[k]) as Vector;
  near(
    apply(reflection(normal, point), beyond),
    point.map((value, k) => value - 0.5 * normal[k]),
  );
  near(apply(rotation([0, 0, 1], [1, 0, 0], Math.PI / 2), [2, 0, 5]), [1, 1, 5]);
  const matrix = RESULT.planes[0].matrix;
  near(transformToUnit(matrix, [30, 5, 7], 4), [-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]);
});

test("the directions across a normal are a frame with it, also where it points upwards", () => {
  for (const normal of [
    [0, 1, 0],
    [0.6, 0.8, 0],
    [0, 0, -1],
  ] as Vector[]) {
    const [right, above] = across(normal, [0, 1, 0]);
    for (const value of [dot(right, above), dot(right, normal), dot(above, normal)])
      assert.ok(Math.abs(value) < 1e-12);
    assert.ok(Math.abs(length(right) - 1) < 1e-12 && Math.abs(length(above) - 1) < 1e-12);
  }
});
