import assert from "node:assert/strict";
import { test } from "node:test";
import type { Item } from "../src/items";
import { kindOf, mainAxis } from "../src/kinds";
import { readLink } from "../src/link";
import { roundedUp } from "../src/summary";
import type { Vector } from "../src/result";

test("a link names an example and options, and falls back where it does not", () => {
  const read = readLink("#example=vase.ply&mode=paper&max_error=0.001");
  const plain = { level: "auto", tolerance: null };
  assert.deepEqual(
    [read?.example.file, read?.options],
    ["vase.ply", { mode: "paper", maxError: 1e-3, ...plain }],
  );
  assert.deepEqual(readLink("#example=vase.ply&mode=x&max_error=-1")?.options, {
    mode: "full",
    maxError: 4e-4,
    ...plain,
  });
  assert.deepEqual(readLink("#example=vase.ply&level=exact&tolerance=0.5")?.options, {
    mode: "full",
    maxError: 4e-4,
    level: "exact",
    tolerance: 0.5,
  });
  assert.equal(readLink("#example=vase.ply&tolerance=Infinity")?.options.tolerance, null);
  assert.equal(readLink("#example=../secret"), null);
  assert.equal(readLink(""), null);
});

test("planes and axes are told apart by how they lie to the main axis", () => {
  const item = (kind: "plane" | "axis", direction: Vector, order: number | null): Item =>
    ({ kind, direction, order, continuous: false }) as Item;
  const main = item("axis", [0, 0, 1], 4);
  const items = [item("axis", [1, 0, 0], 2), main];
  assert.equal(mainAxis(items), main);
  assert.equal(kindOf(item("plane", [0, 0, -1], null), main), "Across the main axis");
  assert.equal(kindOf(item("plane", [1, 0, 0], null), main), "Through the main axis");
  assert.equal(kindOf(item("plane", [Math.SQRT1_2, 0, Math.SQRT1_2], null), main), "Diagonal");
  assert.equal(kindOf(items[0], main), "2-fold, across the main axis");
});

test("a threshold is rounded upwards", () => {
  assert.deepEqual(
    [5.2e-4, 5.21e-4, 9.99e-3, 1].map((x) => Number(roundedUp(x).toPrecision(3))),
    [5.2e-4, 5.3e-4, 0.01, 1],
  );
});
