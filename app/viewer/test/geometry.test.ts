import assert from "node:assert/strict";
import { test } from "node:test";
import { TriangleTree, triangleDistance } from "../src/bvh";
import { cornerNormals } from "../src/normals";
import { fullerSide, section } from "../src/section";
import { subdivided } from "../src/subdivide";
import { cube, noise, soup } from "./support";

const area = (corners: ArrayLike<number>): number => {
  let total = 0;
  for (let at = 0; at < corners.length; at += 9) {
    const edge = (i: number) => [0, 1, 2].map((k) => corners[at + i + k] - corners[at + k]);
    const [u, v] = [edge(3), edge(6)];
    total += Math.hypot(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]) / 2;
  }
  return total;
};

test("the tree finds the nearest of many triangles", () => {
  const corners = soup(500);
  const tree = new TriangleTree(corners);
  const next = noise(7);
  for (let i = 0; i < 200; i++) {
    const [x, y, z] = [3 * next() - 1, 3 * next() - 1, 3 * next() - 1];
    let nearest = Infinity;
    for (let at = 0; at < corners.length; at += 9)
      nearest = Math.min(nearest, triangleDistance(corners, at, x, y, z));
    assert.equal(tree.squaredDistance(x, y, z), nearest);
  }
});

test("distances to a cube are those of a cube", () => {
  const tree = new TriangleTree(cube());
  const cases: [number, number, number, number][] = [
    [3, 0.2, -0.7, 2],
    [3, 3, 0, Math.hypot(2, 2)],
    [2, 2, 2, Math.sqrt(3)],
    [0.1, 0, 0, 0.9],
    [1, 0.3, 0.3, 0],
  ];
  for (const [x, y, z, expected] of cases) {
    assert.ok(Math.abs(Math.sqrt(tree.squaredDistance(x, y, z)) - expected) < 1e-6);
  }
});

test("triangles that are a line or a point have a distance", () => {
  const line = new Float32Array([0, 0, 0, 1, 0, 0, 2, 0, 0]);
  assert.equal(triangleDistance(line, 0, 1.5, 2, 0), 4);
  assert.equal(triangleDistance(new Float32Array(9), 0, 0, 0, 3), 9);
  assert.equal(new TriangleTree(new Float32Array(9 * 50)).squaredDistance(1, 0, 0), 1);
});

test("cutting into small triangles keeps the surface and obeys the limit", () => {
  const corners = cube();
  for (const most of [100, 5000]) {
    const { positions, indices } = subdivided(corners, cornerNormals(corners), most);
    assert.ok(indices.length / 3 <= most && indices.length / 3 > most / 4);
    const cut = Array.from(indices).flatMap((i) => [...positions.subarray(3 * i, 3 * i + 3)]);
    assert.ok(Math.abs(area(cut) - 24) < 1e-3);
  }
});

test("a mesh with more triangles than the limit stays as it is", () => {
  const corners = soup(300);
  const { positions, indices } = subdivided(corners, corners, 10);
  assert.equal(indices.length, 900);
  assert.deepEqual(
    [...positions.subarray(0, 9)],
    [corners.subarray(0, 3), corners.subarray(3, 6), corners.subarray(6, 9)].flatMap((c) => [...c]),
  );
});

test("normals are sharp at a cube's edges", () => {
  const corners = cube();
  const normals = cornerNormals(corners);
  for (let at = 0; at < corners.length; at += 3) {
    const normal = [...normals.subarray(at, at + 3)].map(Math.abs).sort();
    assert.deepEqual(normal, [0, 0, 1]);
  }
});

test("normals are smooth across a gentle edge", () => {
  const bend = 0.1;
  const roof = new Float32Array([0, 0, 0, 0, 1, 0, -1, 0, -bend, 0, 0, 0, 1, 0, -bend, 0, 1, 0]);
  const normals = cornerNormals(roof);
  assert.ok(Math.abs(normals[0]) < 1e-6 && Math.abs(Math.abs(normals[2]) - 1) < 1e-6);
});

test("a plane cuts a cube in a square, through its corners too", () => {
  const length = (segments: Float32Array): number => {
    let total = 0;
    for (let at = 0; at < segments.length; at += 6) {
      total += Math.hypot(
        segments[at] - segments[at + 3],
        segments[at + 1] - segments[at + 4],
        segments[at + 2] - segments[at + 5],
      );
    }
    return total;
  };
  const square = section(cube(), [0, 0, 1], [0, 0, 0.25]);
  assert.ok(Math.abs(length(square) - 8) < 1e-6);
  for (let at = 2; at < square.length; at += 3) assert.ok(Math.abs(square[at] - 0.25) < 1e-6);
  const diagonal = section(cube(), [Math.SQRT1_2, Math.SQRT1_2, 0], [0, 0, 0]);
  // Twice 2 along z, where two faces meet and both give the edge, and twice the diagonal of a square.
  assert.ok(length(diagonal) >= 4 + 4 * Math.SQRT2 - 1e-5);
  assert.equal(section(cube(), [0, 0, 1], [0, 0, 5]).length, 0);
});

test("the fuller side is the one with more surface", () => {
  assert.equal(fullerSide(cube(), [1, 0, 0], [0.5, 0, 0]), -1);
  assert.equal(fullerSide(cube(), [1, 0, 0], [-0.5, 0, 0]), 1);
  assert.equal(fullerSide(cube(), [-1, 0, 0], [-0.5, 0, 0]), -1);
});
