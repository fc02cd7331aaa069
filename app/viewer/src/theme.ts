/** Light or dark: what the system says until the switch is used, and that choice from then on. */

import { byId } from "./dom";
import { icon } from "./icons";
import type { State, Store } from "./store";

type Theme = State["theme"];

const KEY = "prsnet-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");

const stored = (): Theme | null => {
  const value = localStorage.getItem(KEY);
  return value === "light" || value === "dark" ? value : null;
};

export const initialTheme = (): Theme => stored() ?? (dark.matches ? "dark" : "light");

export function attachTheme(store: Store): void {
  const button = byId<HTMLButtonElement>("theme");
  button.addEventListener("click", () => {
    const theme = store.get().theme === "dark" ? "light" : "dark";
    localStorage.setItem(KEY, theme);
    store.set({ theme });
  });
  dark.addEventListener("change", () => {
    if (!stored()) store.set({ theme: initialTheme() });
  });
  store.subscribe(({ theme }, before) => {
    if (theme === before.theme && button.firstChild) return;
    document.documentElement.dataset.theme = theme;
    button.replaceChildren(icon(theme === "dark" ? "sun" : "moon"));
    button.setAttribute("aria-label", theme === "dark" ? "Use light colours" : "Use dark colours");
    button.title = button.ariaLabel ?? "";
  });
}
