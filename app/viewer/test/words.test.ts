import assert from "node:assert/strict";
import { test } from "node:test";
import { errorColor, errorShare, heatColor } from "../src/colors";
import { bytes, coordinate, milliseconds, shellWord, short, unitSign } from "../src/format";
import { describeGroup } from "../src/pointgroup";
import { problemFrom, problemWords } from "../src/problems";

test("numbers are short", () => {
  assert.deepEqual(
    [0, 4e-4, 7.704e-35, 0.037123, 12.3456, 1234, 1.2e7].map((x) => short(x)),
    ["0", "4e-4", "7.7e-35", "0.037", "12", "1230", "1.2e7"],
  );
  assert.equal(coordinate(-3e-17, 1), "0");
  assert.equal(coordinate(-0.123456789, 1), "-0.123457");
  assert.deepEqual(
    [bytes(12), bytes(67108864), milliseconds(3.21), milliseconds(2500)],
    ["12 bytes", "67.1 MB", "3.2 ms", "2.5 s"],
  );
  assert.deepEqual([unitSign("millimeter"), unitSign(null)], ["mm", ""]);
});

test("words for the shell are quoted where they need it", () => {
  assert.equal(shellWord("file=@chair.obj"), "file=@chair.obj");
  assert.equal(shellWord("it's $HOME.stl"), `'it'\\''s $HOME.stl'`);
});

test("every point group has words and the right number of operations", () => {
  const operations: Record<string, number> = {
    C1: 1,
    Cs: 2,
    Ci: 2,
    C5: 5,
    C2v: 4,
    C3h: 6,
    D3: 6,
    D4d: 16,
    D6h: 24,
    S6: 6,
    Td: 24,
    Oh: 48,
    I: 60,
    Ih: 120,
    Kh: Infinity,
  };
  for (const [symbol, expected] of Object.entries(operations)) {
    const { letter, index, text, operations: told } = describeGroup(symbol);
    assert.equal(told, expected, symbol);
    assert.equal(letter + index, symbol);
    assert.match(text, /^[A-Z].*\.$/);
  }
  assert.equal(describeGroup("Cinfv").index, "∞v");
  assert.match(describeGroup("X9").text, /X9/);
});

test("an answer that is no problem document is one of its own", () => {
  const problem = problemFrom(422, '{"type":"/problems/empty-mesh","detail":"No faces.","request_id":"abc"}');
  assert.deepEqual(problem, { slug: "empty-mesh", detail: "No faces.", status: 422, requestId: "abc" });
  assert.equal(problemFrom(502, "<html>").slug, "not-understood");
  assert.equal(problemWords({ ...problem, slug: "of-the-future", status: 503 }).again, true);
});

test("colours follow the error and the distance", () => {
  assert.equal(errorShare(0, 4e-4), 0);
  assert.equal(errorShare(4e-4, 4e-4), 1);
  assert.equal(errorShare(1, 4e-4), 1);
  assert.ok(errorShare(1e-6, 4e-4) > 0.3 && errorShare(1e-6, 4e-4) < 0.7);
  assert.equal(errorColor(1e-30, 4e-4), "#2578d6");
  const [red, , blue] = heatColor(0);
  assert.ok(blue > red && heatColor(1)[0] > heatColor(1)[2]);
});
