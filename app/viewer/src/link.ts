/** A link that brings back an example with the options it was asked with: all is in the part after the #. */

import type { Options } from "./api";
import { EXAMPLES, type Example } from "./examples";

export function linkTo(name: string, { mode, maxError, level, tolerance }: Options): string {
  const url = new URL(document.baseURI);
  const words = new URLSearchParams({ example: name });
  if (mode !== "full") words.set("mode", mode);
  if (maxError !== 4e-4) words.set("max_error", String(maxError));
  if (level !== "auto") words.set("level", level);
  if (tolerance !== null) words.set("tolerance", String(tolerance));
  url.hash = words.toString();
  return url.href;
}

/** The example and the options that a link names; null where it names none, and defaults for what is no option. */
export function readLink(hash: string): { example: Example; options: Options } | null {
  const words = new URLSearchParams(hash.replace(/^#/, ""));
  const example = EXAMPLES.find(({ file }) => file === words.get("example"));
  if (!example) return null;
  const error = Number(words.get("max_error"));
  const tolerance = Number(words.get("tolerance"));
  return {
    example,
    options: {
      mode: words.get("mode") === "paper" ? "paper" : "full",
      maxError: error > 0 && error <= 1 ? error : 4e-4,
      level: words.get("level") === "exact" ? "exact" : "auto",
      tolerance: tolerance > 0 && Number.isFinite(tolerance) ? tolerance : null,
    },
  };
}
