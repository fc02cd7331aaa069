/** The groups that hold, each with the tolerance it needs, and where the chosen one does not hold. */

import { h } from "./dom";
import { short, unitSign, vector } from "./format";
import type { DetectResult, Level, LevelName, Patch } from "./result";

export type ChooseLevel = (level: LevelName, tolerance: number | null) => void;

/** Nothing where the answer has no levels, as in paper mode. */
export function levels(result: DetectResult, choose: ChooseLevel, isChosen: boolean): HTMLElement | null {
  const all = result.levels ?? [];
  if (all.length === 0) return null;
  const breaks = all.flatMap((level) => (level.chosen ? level.breaks : []));
  return h(
    "section",
    { class: "facts levels", "aria-label": "Levels" },
    h(
      "h3",
      {},
      "Levels",
      isChosen &&
        h("button", { type: "button", class: "link", onclick: () => choose("auto", null) }, "choose for me"),
    ),
    h(
      "ul",
      { class: "ladder" },
      ...all.map((level) =>
        h(
          "li",
          {},
          h(
            "button",
            {
              type: "button",
              class: "level",
              "aria-pressed": String(level.chosen),
              title: `Answer with ${level.point_group}`,
              onclick: () => !level.chosen && choose(...wantedFor(level, result)),
            },
            h("span", { class: "name" }, level.point_group),
            h("span", { class: "note" }, levelWords(level, result)),
          ),
        ),
      ),
    ),
    breaks.length > 0 && h("p", { class: "muted small" }, "Where the chosen one does not hold:"),
    breaks.length > 0 &&
      h("ul", { class: "small" }, ...breaks.map((patch) => h("li", {}, patchWords(patch, result)))),
  );
}

/** How to ask for a level: the exact one by its name, others by a tolerance that they hold within and the next does not. */
export function wantedFor(level: Level, { frame }: DetectResult): [LevelName, number | null] {
  if (level.exact) return ["exact", null];
  const { rms_distance: least, next_rms_distance: next } = level;
  const margin = Math.max(0.01 * least, 1e-7 * frame.scale);
  const tolerance =
    next !== null && next > least ? Math.min(least + margin, (least + next) / 2) : least + margin;
  return ["auto", Number(tolerance.toPrecision(6))];
}

const lengthOf = (value: number, { frame }: DetectResult): string =>
  `${short(value)} ${unitSign(frame.units)}`.trimEnd();

/** What a level needs, whether it is exact, and whether the results are its elements. */
export function levelWords(level: Level, result: DetectResult): string {
  const words = [
    `rms ${lengthOf(level.rms_distance, result)}`,
    level.exact && "exact",
    level.evidence === "predicted" && `predicted, ${Math.round(100 * level.confidence)} % sure`,
    level.chosen && "chosen",
  ];
  return words.filter(Boolean).join(", ");
}

/** Where the surface breaks a symmetry, and by how much. */
export function patchWords(patch: Patch, result: DetectResult): string {
  const at = vector(patch.center, result.frame.scale);
  return `${patch.present ? "without counterpart" : "missing"} at ${at}, off by ${lengthOf(patch.max_distance, result)}`;
}
