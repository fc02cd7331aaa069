/** A link that brings back an example with the options it was asked with: all is in the part after the #. */

import type { Options } from "./api";
import { EXAMPLES, type Example } from "./examples";

export function linkTo(name: string, { mode, maxError }: Options): string {
  const url = new URL(document.baseURI);
  const words = new URLSearchParams({ example: name });
  if (mode !== "full") words.set("mode", mode);
  if (maxError !== 4e-4) words.set("max_error", String(maxError));
  url.hash = words.toString();
  return url.href;
}

/** The example and the options that a link names; null where it names none, and defaults for what is no option. */
export function readLink(hash: string): { example: Example; options: Options } | null {
  const words = new URLSearchParams(hash.replace(/^#/, ""));
  const example = EXAMPLES.find(({ file }) => file === words.get("example"));
  if (!example) return null;
  const error = Number(words.get("max_error"));
  return {
    example,
    options: {
      mode: words.get("mode") === "paper" ? "paper" : "full",
      maxError: error > 0 && error <= 1 ? error : 4e-4,
    },
  };
}
