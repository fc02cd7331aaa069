import assert from "node:assert/strict";
import { test } from "node:test";
import { csvOf, outcome } from "../src/batch";
import { itemsOf } from "../src/items";
import { levelWords, wantedFor } from "../src/levels";
import { note } from "../src/list";
import { gridLines, gridStep, roundStep, rulerEnds } from "../src/measure";
import type { DetectResult, Evidence, Level } from "../src/result";
import type { Entry } from "../src/store";

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
      evidence: "measured",
      continuous: false,
    },
  ],
  axes: [],
  point_group: "Cs",
  frame: { coordinates: "input", units: "millimeter", center: [30, 5, 7], scale: 80 },
  mesh: {
    filename: "a.stl",
    bounds: [
      [0.5, -4, 3],
      [59.5, 14, 11],
    ],
  },
} as unknown as DetectResult;

test("steps of a grid are round", () => {
  const lengths = [1, 1.99, 2, 4.9, 5, 9.99, 0.0321, 1.7e9];
  assert.deepEqual(lengths.map(roundStep), [1, 1, 2, 2, 5, 5, 0.02, 1e9]);
});

test("the grid lies under the mesh, at round coordinates, and reaches beyond it", () => {
  assert.equal(gridStep(RESULT), 5);
  for (const [up, height] of [
    ["y", 1],
    ["z", 2],
  ] as const) {
    const lines = gridLines(RESULT, up);
    assert.ok(lines.length > 0 && lines.length % 6 === 0);
    const [low, high] = RESULT.mesh.bounds;
    const reach = [0, 1, 2].map(() => [Infinity, -Infinity]);
    lines.forEach((value, at) => {
      const axis = at % 3;
      const input = value * RESULT.frame.scale + RESULT.frame.center[axis];
      reach[axis] = [Math.min(reach[axis][0], input), Math.max(reach[axis][1], input)];
      if (axis === height) assert.ok(Math.abs(input - low[height]) < 1e-9);
      else assert.ok(Math.abs(input / 5 - Math.round(input / 5)) < 1e-9);
    });
    for (const axis of [0, 1, 2]) {
      if (axis !== height) assert.ok(reach[axis][0] < low[axis] && reach[axis][1] > high[axis]);
    }
  }
});

test("the ruler ends at the point of a plane or axis that is nearest to the origin", () => {
  assert.deepEqual(rulerEnds({ normal: [0, 0.6, 0.8], offset: -10 })[1], [0, 6, 8]);
  assert.deepEqual(rulerEnds({ direction: [0, 0, 1], point: [3, 4, 99] })[1], [3, 4, 0]);
});

test("a level is asked for so that it is the largest that holds", () => {
  const level = (rms: number, next: number | null, exact: boolean | null): Level =>
    ({ rms_distance: rms, next_rms_distance: next, exact, point_group: "C2" }) as Level;
  assert.deepEqual(wantedFor(level(0, 1, true), RESULT), ["exact", null]);
  for (const [rms, next] of [
    [0.5, 0.8],
    [0.5, 0.501],
    [0, 0.3],
    [0.5, null],
  ] as const) {
    const [name, tolerance] = wantedFor(level(rms, next, null), RESULT);
    assert.equal(name, "auto");
    assert.ok(tolerance! > rms && tolerance! < (next ?? Infinity));
  }
  assert.equal(levelWords({ ...level(0.5, null, false), chosen: false }, RESULT), "rms 0.5 mm");
});

test("what is predicted is told from what is measured", () => {
  const level = { rms_distance: 0.5, exact: false, chosen: true, confidence: 0.634 };
  const words = (evidence: Evidence): string => levelWords({ ...level, evidence } as Level, RESULT);
  assert.equal(words("predicted"), "rms 0.5 mm, predicted, 63 % sure, chosen");
  assert.equal(words("measured"), "rms 0.5 mm, chosen");
  const noted = (evidence: Evidence, exact: boolean): string =>
    note(itemsOf({ ...RESULT, planes: [{ ...RESULT.planes[0], evidence, exact }] })[0]);
  assert.equal(noted("predicted", false), "predicted, not measured");
  assert.equal(noted("measured", false), "approximate");
  assert.equal(noted("measured", true), "exact");
});

test("the CSV of several files has a row a plane, and one for what has none", () => {
  const file = (name: string): File => ({ name }) as File;
  const entries: Entry[] = [
    { file: file("a.stl"), result: RESULT, problem: null },
    { file: file('b, "c".stl'), result: { ...RESULT, planes: [], point_group: "C1" }, problem: null },
    {
      file: file("d.stl"),
      result: null,
      problem: { slug: "empty-mesh", detail: "", status: 422, requestId: null },
    },
  ];
  const lines = csvOf(entries).split("\r\n");
  assert.equal(lines.length, 5);
  assert.equal(lines[1], "a.stl,Cs,plane,0,1,0,0,-30,30,5,7,,no,yes,1e-12,0.00001,measured");
  assert.match(lines[2], /^"b, ""c"".stl",C1,none,/);
  assert.match(lines[3], /^d\.stl,,empty-mesh,/);
  const width = lines[0].split(",").length;
  assert.ok([lines[1], lines[3]].every((line) => line.split(",").length === width));
  assert.equal(outcome(entries[0]), "Cs: 1 plane, 0 axes");
});
