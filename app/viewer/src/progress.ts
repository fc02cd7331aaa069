/** The bar over the picture while a request is under way. */

import { byId, h } from "./dom";
import { isBusy, type Store } from "./store";

export function attachProgress(store: Store, cancel: () => void): void {
  const element = byId("progress");
  const text = h("span", {});
  const bar = h("progress", { max: 1, "aria-label": "Progress" });
  element.append(text, bar, h("button", { type: "button", class: "button", onclick: cancel }, "Cancel"));
  store.subscribe((state) => {
    const { phase, file } = state;
    element.hidden = !isBusy(state);
    const name = file?.name ?? "the mesh";
    if (phase.kind === "uploading") {
      text.textContent = `Uploading ${name}, ${Math.round(100 * phase.share)} %`;
      bar.value = phase.share;
    } else if (phase.kind === "computing") {
      text.textContent = `Finding the symmetries of ${name} …`;
      bar.removeAttribute("value");
    } else if (phase.kind === "starting") {
      text.textContent = "The service is starting …";
      bar.removeAttribute("value");
    }
  });
}
