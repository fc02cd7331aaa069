/** A few choices side by side, of which one holds: a group of radio buttons to keyboard and screen reader. */

import { h } from "./dom";

export interface Segments<Value extends string> {
  element: HTMLElement;
  show(value: Value): void;
}

export function segments<Value extends string>(
  legend: string,
  choices: { value: Value; label: string; title?: string }[],
  onChoice: (value: Value) => void,
): Segments<Value> {
  const name = legend.toLowerCase().replaceAll(" ", "-");
  const inputs = choices.map(({ value }) =>
    h("input", { type: "radio", name, value, onchange: () => onChoice(value) }),
  );
  const element = h(
    "fieldset",
    { class: "segments" },
    h("legend", { class: "unseen" }, legend),
    ...choices.map(({ label, title }, index) => h("label", { title }, inputs[index], h("span", {}, label))),
  );
  return {
    element,
    show(value) {
      for (const input of inputs) input.checked = input.value === value;
    },
  };
}
