/** How to ask: full or paper mode, and the largest error of a result. */

import { h } from "./dom";
import { short } from "./format";
import { segments } from "./segments";
import type { Mode } from "./result";
import type { State, Store } from "./store";

/** Powers of ten. */
const [LEAST, MOST, STEP] = [-6, -1, 0.02];
const DEFAULT = 4e-4;

export interface Controls {
  element: HTMLElement;
  update(state: State): void;
}

export function controls(store: Store, ask: () => void): Controls {
  const mode = segments<Mode>(
    "Mode",
    [
      { value: "full", label: "Full", title: "Every symmetry, refined on exact distances" },
      { value: "paper", label: "Paper", title: "The network's own output, validated as in the paper" },
    ],
    (value) => (store.set({ mode: value }), ask()),
  );
  const output = h("span", { class: "value", id: "max-error-value" });
  const meaning = h("span", { class: "muted small" });
  const slider = h("input", {
    type: "range",
    id: "max-error",
    min: LEAST,
    max: MOST,
    step: STEP,
    oninput: () => describe(valueOf(slider)),
    onchange: () => (store.set({ maxError: valueOf(slider) }), ask()),
  });
  const reset = h(
    "button",
    { type: "button", class: "link", onclick: () => (store.set({ maxError: DEFAULT }), ask()) },
    "reset",
  );

  function describe(value: number): void {
    const share = `${short(100 * Math.sqrt(value))} % of the diameter`;
    output.textContent = short(value);
    meaning.textContent = `an rms deviation of ${share}`;
    slider.setAttribute("aria-valuetext", `${short(value)}, ${meaning.textContent}`);
    reset.hidden = value === DEFAULT;
  }

  const element = h(
    "section",
    { class: "controls", "aria-label": "How to ask" },
    h("div", { class: "line" }, h("span", { class: "label" }, "Mode"), mode.element),
    h(
      "div",
      { class: "line" },
      h("label", { for: "max-error", class: "label" }, "Largest error"),
      output,
      reset,
    ),
    slider,
    meaning,
  );
  return {
    element,
    update(state) {
      mode.show(state.mode);
      slider.value = String(Math.log10(state.maxError));
      describe(state.maxError);
    },
  };
}

const valueOf = (slider: HTMLInputElement): number => Number((10 ** Number(slider.value)).toPrecision(2));
