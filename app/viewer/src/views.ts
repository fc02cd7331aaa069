/** Over the picture: what it shows (mesh, mirror preview, heat map), the legend of its colours, and its tools. */

import { errorGradient, heatGradient, LEAST_ERROR } from "./colors";
import { byId, h } from "./dom";
import { short, unitSign } from "./format";
import { icon } from "./icons";
import { gridStep } from "./measure";
import { LEAST_HEAT } from "./meshview";
import { segments } from "./segments";
import { accepted, subject, type State, type Store, type Up, type View } from "./store";

export function attachViews(store: Store, home: () => void): void {
  const view = segments<View>(
    "View",
    [
      { value: "mesh", label: "Mesh" },
      { value: "mirror", label: "Mirror preview", title: "One half, and its image in place of the other" },
      { value: "heat", label: "Heat map", title: "Distance of the moved surface to the surface" },
    ],
    (value) => store.set({ view: value }),
  );
  const up = segments<Up>(
    "Upwards",
    [
      { value: "y", label: "y up", title: "Only the view turns; coordinates stay" },
      { value: "z", label: "z up", title: "Only the view turns; coordinates stay" },
    ],
    (value) => store.set({ up: value }),
  );
  const reset = h(
    "button",
    {
      type: "button",
      class: "quiet icon",
      "aria-label": "Reset the view",
      title: "Reset the view (0)",
      onclick: home,
    },
    icon("home"),
  );
  const [views, tools, legend] = [byId("views"), byId("tools"), byId("legend")];
  views.append(view.element);
  const drawing = drawn(store);
  tools.append(drawing.element, up.element, reset);
  store.subscribe((state) => {
    view.show(state.view);
    up.show(state.up);
    drawing.show(state);
    tools.hidden = state.surface === null;
    views.hidden = subject(state) === null;
    legend.hidden = subject(state) === null || (state.view === "mesh" && accepted(state).length === 0);
    if (!legend.hidden) legend.replaceChildren(...legendOf(state));
  });
}

const DRAWN = [
  { name: "flat", label: "Orthographic", title: "What is far is not smaller" },
  { name: "wire", label: "Wireframe", title: "The edges of all triangles" },
  { name: "grid", label: "Grid", title: "Round lengths of the file on the ground" },
  { name: "ruler", label: "Ruler", title: "From the file's origin to the chosen plane or axis" },
] as const;

/** How the picture is drawn: boxes to check, behind a button. */
function drawn(store: Store): { element: HTMLElement; show(state: State): void } {
  const boxes = DRAWN.map(({ name }) =>
    h("input", { type: "checkbox", onchange: (event: Event) => set(name, event) }),
  );
  const step = h("p", { class: "muted small", id: "grid-step" });
  const element = h(
    "details",
    { class: "drawn" },
    h("summary", { title: "How the picture is drawn" }, "Drawing"),
    h(
      "div",
      { class: "choices" },
      ...DRAWN.map(({ label, title }, index) =>
        h("label", { class: "check small", title }, boxes[index], label),
      ),
      step,
    ),
  );
  element.addEventListener("keydown", (event) => {
    if (event.key === "Escape") element.open = false;
  });
  document.addEventListener("pointerdown", (event) => {
    if (!element.contains(event.target as Node)) element.open = false;
  });
  const set = (name: (typeof DRAWN)[number]["name"], event: Event): void =>
    store.set({ [name]: (event.currentTarget as HTMLInputElement).checked });
  return {
    element,
    show(state) {
      DRAWN.forEach(({ name }, index) => (boxes[index].checked = state[name]));
      const { result } = state;
      step.textContent =
        result && state.grid
          ? `A square of the grid is ${short(gridStep(result))} ${unitSign(result.frame.units)} wide.`.replace(
              "  ",
              " ",
            )
          : state.ruler && !state.selected
            ? "Choose a plane or axis to measure."
            : "";
      step.hidden = step.textContent === "";
    },
  };
}

function legendOf(state: State): HTMLElement[] {
  const about = subject(state)!;
  const name = about.reason ? "the chosen candidate" : about.name.toLowerCase();
  if (state.view === "mirror") {
    const image = about.kind === "plane" ? "its mirror image" : `turned by ${degrees(about.order)}`;
    return [
      h("strong", {}, `At ${name}`),
      h("span", { class: "key" }, h("i", { class: "original" }), "one half as it is"),
      h("span", { class: "key" }, h("i", { class: "image" }), image),
    ];
  }
  if (state.view === "heat") {
    const what = about.kind === "plane" ? "mirrored" : `turned by ${degrees(about.order)},`;
    const units = unitSign(state.result?.frame.units ?? null);
    const long = (value: number): string => `${short(value)} ${units}`.trim();
    const scale = state.result?.frame.scale ?? 1;
    const largest = state.heatLargest === null ? null : Math.max(state.heatLargest, LEAST_HEAT) * scale;
    return [
      h("strong", {}, `Distance to the surface, ${what} at ${name}`),
      bar(heatGradient()),
      h(
        "span",
        { class: "ends" },
        h("span", {}, "0"),
        h("span", {}, largest === null ? "measuring …" : long(largest)),
      ),
      h(
        "span",
        { class: "muted" },
        state.heatLargest === null
          ? ""
          : `largest ${long(state.heatLargest * scale)}, rms ${long(about.rms)}`,
      ),
    ];
  }
  const maxError = state.answered?.maxError ?? state.maxError;
  return [
    h("strong", {}, "Symmetry error"),
    bar(errorGradient()),
    h("span", { class: "ends" }, h("span", {}, `≤ ${short(LEAST_ERROR)}`), h("span", {}, short(maxError))),
  ];
}

function bar(gradient: string): HTMLElement {
  const element = h("span", { class: "scale" });
  element.style.background = gradient;
  return element;
}

const degrees = (order: number | null): string => `${order ? short(360 / order, 4) : "137.5"}°`;
