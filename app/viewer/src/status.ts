/** What happens, said to screen readers; and, where it is shown nowhere else, in a short note on the page. */

import { byId, h } from "./dom";
import { plural } from "./format";
import { isBusy, type Store } from "./store";

const SHOWN_MS = 2500;

/** `visibly`: also for those who see. */
export type Say = (text: string, visibly?: boolean) => void;

export function createSay(): Say {
  const region = byId("status");
  return (text, visibly = false) => {
    region.textContent = text;
    if (!visibly) return;
    const note = h("div", { class: "toast", "aria-hidden": "true" }, text);
    document.body.append(note);
    setTimeout(() => note.remove(), SHOWN_MS);
  };
}

/** Tells of uploads, results and how many there are. */
export function attachStatus(store: Store, say: Say): void {
  store.subscribe((state, before) => {
    if (state.phase.kind !== before.phase.kind) {
      if (state.phase.kind === "uploading") say("Uploading.");
      if (state.phase.kind === "computing") say("Computing.");
      if (state.phase.kind === "idle" && state.result === before.result && isBusy(before)) say("Cancelled.");
    }
    if (state.result && state.result !== before.result) {
      const { planes, axes, point_group: group } = state.result;
      say(
        `Done: point group ${group}, ${plural(planes.length, "plane")}, ${plural(axes.length, "axis", "axes")}.`,
      );
    }
  });
}
