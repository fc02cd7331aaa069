/** Asks for the key of a service that wants one. It is kept for as long as the tab is open. */

import { storeKey } from "./api";
import { byId, h } from "./dom";

/** Answers whether a key was entered. */
export function askForKey(): Promise<boolean> {
  const dialog = byId<HTMLDialogElement>("key");
  if (dialog.open) return Promise.resolve(false);
  const input = h("input", { type: "password", id: "key-value", autocomplete: "off", required: true });
  const form = h(
    "form",
    { method: "dialog" },
    h("h2", { id: "key-title" }, "This service needs a key"),
    h("p", { class: "muted" }, "Its operator gives one out. The key is kept until this tab is closed."),
    h("label", { for: "key-value" }, "Key"),
    input,
    h(
      "div",
      { class: "buttons" },
      h("button", { class: "button primary", value: "use" }, "Use this key"),
      h("button", { class: "button", value: "cancel", formnovalidate: true }, "Cancel"),
    ),
  );
  dialog.replaceChildren(form);
  dialog.returnValue = "cancel";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener(
      "close",
      () => {
        const given = dialog.returnValue === "use" && input.value !== "";
        if (given) storeKey(input.value);
        resolve(given);
      },
      { once: true },
    );
  });
}
