/** The first thing to be seen: where to drop a mesh, and examples for who has none at hand. */

import { byId, h } from "./dom";
import { EXAMPLES, fetchExample } from "./examples";
import { formats } from "./formats";
import { icon } from "./icons";
import { isBusy, type Store } from "./store";
import { accepted, together } from "./together";

export function attachStart(store: Store, open: (files: File[]) => void): void {
  const picker = byId<HTMLInputElement>("file");
  const { read } = formats();
  picker.accept = accepted();
  picker.multiple = true;
  picker.addEventListener("change", () => {
    const files = together(picker.files ?? []);
    if (files.length > 0) open(files);
    picker.value = "";
  });
  const choose = h(
    "button",
    { type: "button", class: "drop", onclick: () => picker.click() },
    icon("upload"),
    h("strong", {}, "Drop meshes here, or choose files"),
    h(
      "span",
      { class: "muted small" },
      `${read.map(({ label, note }) => `${label} ${note}`.trim()).join(", ")}. It goes to this service and nowhere else.`,
    ),
  );
  const start = byId("start");
  start.append(
    h("h1", {}, "Every mirror plane and rotation axis of a mesh"),
    choose,
    h("h2", {}, "Or try one of these"),
    h("ul", { class: "examples" }, ...EXAMPLES.map((example) => h("li", {}, exampleButton(example)))),
  );
  store.subscribe((state) => {
    start.hidden = state.surface !== null;
    start.classList.toggle("waiting", isBusy(state));
  });

  function exampleButton(example: (typeof EXAMPLES)[number]): HTMLElement {
    const picture = h("img", {
      src: `static/viewer/examples/${example.file}.png`,
      alt: "",
      width: 96,
      height: 72,
      loading: "lazy",
    });
    return h(
      "button",
      {
        type: "button",
        class: "example",
        onclick: () => void fetchExample(example).then((file) => open([file])),
      },
      picture,
      h("span", {}, h("strong", {}, example.title), h("span", { class: "muted small" }, example.note)),
    );
  }
}

/** Files may be dropped anywhere on the page, at any time. */
export function attachDrop(open: (files: File[]) => void): void {
  const veil = byId("veil");
  let inside = 0;
  const enter = (by: number): void => {
    inside = Math.max(0, inside + by);
    veil.hidden = inside === 0;
  };
  const isFile = (event: DragEvent): boolean => event.dataTransfer?.types.includes("Files") ?? false;
  document.addEventListener("dragenter", (event) => isFile(event) && enter(1));
  document.addEventListener("dragleave", (event) => isFile(event) && enter(-1));
  document.addEventListener("dragover", (event) => {
    if (isFile(event)) event.preventDefault();
  });
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    enter(-inside);
    const files = together(event.dataTransfer?.files ?? []);
    if (files.length > 0) open(files);
  });
}
