/** The groups that hold, each with the tolerance it needs, and where the chosen one does not hold. */

import { h } from "./dom";
import { short, unitSign, vector } from "./format";
import type { DetectResult, Level, Patch } from "./result";

/** Nothing where the answer has no levels, as in paper mode. */
export function levels(result: DetectResult): HTMLElement | null {
  const all = result.levels ?? [];
  if (all.length === 0) return null;
  const breaks = all.flatMap((level) => (level.chosen ? level.breaks : []));
  return h(
    "section",
    { class: "facts levels", "aria-label": "Levels" },
    h("h3", {}, "Levels"),
    h(
      "dl",
      {},
      ...all.map((level) =>
        h("div", {}, h("dt", {}, level.point_group), h("dd", {}, levelWords(level, result))),
      ),
    ),
    breaks.length > 0 && h("p", { class: "muted small" }, "Where the chosen one does not hold:"),
    breaks.length > 0 &&
      h("ul", { class: "small" }, ...breaks.map((patch) => h("li", {}, patchWords(patch, result)))),
  );
}

const lengthOf = (value: number, { frame }: DetectResult): string =>
  `${short(value)} ${unitSign(frame.units)}`.trimEnd();

/** What a level needs, whether it is exact, and whether the results are its elements. */
export function levelWords(level: Level, result: DetectResult): string {
  const words = [
    `rms ${lengthOf(level.rms_distance, result)}`,
    level.exact && "exact",
    level.chosen && "chosen",
  ];
  return words.filter(Boolean).join(", ");
}

/** Where the surface breaks a symmetry, and by how much. */
export function patchWords(patch: Patch, result: DetectResult): string {
  const at = vector(patch.center, result.frame.scale);
  return `${patch.present ? "without counterpart" : "missing"} at ${at}, off by ${lengthOf(patch.max_distance, result)}`;
}
