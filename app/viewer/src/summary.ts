/** The head of the panel: the point group in words, and the mesh as the service read it. */

import { h } from "./dom";
import { count, milliseconds, plural, short, unitSign } from "./format";
import { describeGroup } from "./pointgroup";
import type { DetectResult } from "./result";

export function summary(result: DetectResult): HTMLElement {
  const group = describeGroup(result.point_group);
  const operations = Number.isFinite(group.operations)
    ? plural(group.operations, "operation")
    : group.operations === Infinity
      ? "infinitely many operations"
      : "";
  return h(
    "section",
    { class: "summary", "aria-labelledby": "group-title" },
    h("div", { class: "symbol", "aria-hidden": "true" }, group.letter, h("sub", {}, group.index)),
    h(
      "div",
      {},
      h("h2", { id: "group-title" }, `Point group ${result.point_group}`),
      h("p", {}, group.text),
      operations && h("p", { class: "muted small" }, operations),
    ),
  );
}

export function facts(result: DetectResult): HTMLElement {
  const { mesh, frame } = result;
  const size = mesh.bounds[1].map((high, k) => short(high - mesh.bounds[0][k], 3)).join(" × ");
  const rows: [string, string][] = [
    ["Faces", count(mesh.faces)],
    ["Vertices", count(mesh.vertices)],
    ["Size", `${size} ${unitSign(frame.units)}`],
    ["Surface", mesh.watertight ? "watertight" : "open"],
    ["Computed in", milliseconds(result.timings_ms.total)],
    ["Weights", `${result.model.name} ${result.model.version}`],
  ];
  return h(
    "section",
    { class: "facts" },
    h("h3", {}, "Mesh"),
    h("dl", {}, ...rows.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value)))),
  );
}

/** What the service warns of, or nothing. */
export function warnings(result: DetectResult): HTMLElement | null {
  if (result.warnings.length === 0) return null;
  return h("ul", { class: "warnings" }, ...result.warnings.map((text) => h("li", {}, text)));
}

/** Where nothing was found: the best of what was turned down, and the least threshold it needs. */
export function nearest(result: DetectResult): HTMLElement | null {
  if (result.planes.length + result.axes.length > 0) return null;
  const turnedDown = (result.rejected ?? []).filter(({ reason }) => reason === "not_symmetric");
  if (turnedDown.length === 0) return null;
  const best = turnedDown.reduce((a, b) => (b.symmetry_error < a.symmetry_error ? b : a));
  const error = best.symmetry_error;
  const words = `The best candidate is ${best.kind === "plane" ? "a plane" : "an axis"} with an error of ${short(error)}, which needs a largest error of at least ${short(roundedUp(error))}.`;
  return h("p", { class: "nearest small" }, words);
}

/** A number of two digits that is not smaller. */
export function roundedUp(value: number): number {
  if (value <= 0) return value;
  const step = 10 ** (Math.floor(Math.log10(value)) - 1);
  return Math.min(1, Number((Math.ceil((value / step) * (1 - 1e-12)) * step).toPrecision(2)));
}
