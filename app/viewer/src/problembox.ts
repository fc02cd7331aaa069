/** What went wrong, what the service says about it, and what to do. */

import { byId, h } from "./dom";
import { problemWords } from "./problems";
import type { Store } from "./store";

export function attachProblemBox(store: Store, retry: () => void): void {
  const element = byId("problem");
  const close = (): void => store.set({ phase: { kind: "idle" } });
  element.addEventListener("keydown", (event) => {
    if (event.key === "Escape") close();
  });
  store.subscribe((state, before) => {
    if (state.phase === before.phase && state !== before) return;
    element.hidden = state.phase.kind !== "failed";
    if (state.phase.kind !== "failed") return element.replaceChildren();
    const { problem } = state.phase;
    const words = problemWords(problem);
    element.replaceChildren(
      h("h2", {}, words.title),
      h("p", {}, problem.detail),
      h("p", { class: "muted" }, words.advice),
      problem.requestId
        ? h("p", { class: "muted small" }, "Request id ", h("code", {}, problem.requestId))
        : "",
      h(
        "div",
        { class: "buttons" },
        words.again && h("button", { type: "button", class: "button primary", onclick: retry }, "Try again"),
        h("button", { type: "button", class: "button", onclick: close }, "Close"),
      ),
    );
  });
}
