/** Planes, axes, similar and rejected candidates as lists of buttons that answer to the picture, and it to them. */

import { errorColor } from "./colors";
import { h } from "./dom";
import { short, vector } from "./format";
import { icon } from "./icons";
import { kindOf, mainAxis } from "./kinds";
import type { Item } from "./items";
import type { AxisResult, PlaneResult } from "./result";
import { accepted, type State, type Store } from "./store";

const REASONS: Record<NonNullable<Item["reason"]>, string> = {
  not_symmetric: "its error is over the largest allowed",
  duplicate: "the same as a better one, or too near to it",
  similar: "it holds roughly, but belongs to no group with the others",
  not_continuous: "one turn holds, but not every angle",
};

/** What is listed apart from the results: title, explanation, and which items. */
const OTHERS: [string, string, (item: Item) => boolean][] = [
  [
    "Similar",
    "Within the largest error, but in no group with the results. Choose one to see it.",
    (item) => item.reason === "similar",
  ],
  [
    "Rejected candidates",
    "Proposed on the way and turned down. Choose one to see it.",
    (item) => item.reason !== "similar",
  ],
];

/** A longer list is folded by kind. */
const MOST_UNFOLDED = 10;

interface Row {
  item: Item;
  element: HTMLElement;
  pick: HTMLButtonElement;
  eye: HTMLButtonElement | null;
}

export interface Lists {
  elements: HTMLElement[];
  /** Follows selection, hover and switches; the items must be those it was made of. */
  update(state: State): void;
}

export function lists(store: Store): Lists {
  const state = store.get();
  const rows: Row[] = [];
  const elements: HTMLElement[] = [];
  const results = accepted(state);
  for (const kind of ["plane", "axis"] as const) {
    const items = results.filter((item) => item.kind === kind);
    const title = kind === "plane" ? "Planes" : "Axes";
    const own = items.map((item) => row(item, store));
    rows.push(...own);
    elements.push(section(title, own, store, mainAxis(results)));
  }
  for (const [title, text, isIn] of OTHERS) {
    const own = state.items.filter((item) => item.reason && isIn(item)).map((item) => row(item, store));
    rows.push(...own);
    if (own.length > 0) elements.push(otherSection(title, text, own));
  }
  return { elements, update: (now) => rows.forEach((each) => show(each, now)) };
}

function section(title: string, rows: Row[], store: Store, main: Item | null): HTMLElement {
  const ids = rows.map(({ item }) => item.id);
  const all = h(
    "button",
    { type: "button", class: "link", onclick: () => toggleAll(store, ids) },
    "show / hide all",
  );
  return h(
    "section",
    { class: "results", "aria-label": title },
    h("h3", {}, title, h("span", { class: "count" }, String(rows.length)), rows.length > 1 && all),
    rows.length > 0
      ? rowsOf(rows, main)
      : h("p", { class: "muted small" }, `No ${title.toLowerCase()} within the largest error.`),
  );
}

/** One list, or where it would be long one for each kind, folded. */
function rowsOf(rows: Row[], main: Item | null): HTMLElement {
  const listed = (some: Row[]): HTMLElement => h("ul", {}, ...some.map(({ element }) => element));
  if (rows.length <= MOST_UNFOLDED) return listed(rows);
  const kinds = new Map<string, Row[]>();
  for (const row of rows) {
    const kind = kindOf(row.item, main);
    kinds.set(kind, [...(kinds.get(kind) ?? []), row]);
  }
  return h(
    "div",
    {},
    ...[...kinds].map(([kind, some]) => {
      const largest = Math.max(...some.map(({ item }) => item.error));
      return h(
        "details",
        { class: "kind" },
        h(
          "summary",
          {},
          kind,
          h("span", { class: "count" }, String(some.length)),
          h("span", { class: "note" }, `error up to ${short(largest)}`),
        ),
        listed(some),
      );
    }),
  );
}

function otherSection(title: string, text: string, rows: Row[]): HTMLElement {
  return h(
    "details",
    { class: "results rejected" },
    h("summary", {}, title, h("span", { class: "count" }, String(rows.length))),
    h("p", { class: "muted small" }, text),
    h("ul", {}, ...rows.map(({ element }) => element)),
  );
}

function row(item: Item, store: Store): Row {
  const pick = h(
    "button",
    { type: "button", class: "pick", "aria-pressed": "false", onclick: () => select(store, item.id) },
    h("span", { class: `swatch ${item.kind}` }),
    h("span", { class: "name" }, label(item), h("span", { class: "note" }, note(item))),
    h(
      "span",
      { class: "numbers" },
      h("span", {}, short(item.error)),
      h("span", { class: "note" }, `rms ${short(item.rms)}`),
    ),
  );
  pick.title = `Symmetry error ${item.error}, rms distance ${item.rms} in the file's units`;
  const eye = item.reason
    ? null
    : h("button", { type: "button", class: "quiet icon eye", onclick: () => toggle(store, item.id) });
  const element = h("li", { class: "row", "data-id": item.id }, pick, eye);
  element.addEventListener("pointerenter", (event) => {
    if (event.pointerType !== "touch") store.set({ hovered: item.id });
  });
  element.addEventListener("pointerleave", () => store.set({ hovered: null }));
  pick.addEventListener("focus", () => {
    if (pick.matches(":focus-visible")) store.set({ hovered: item.id });
  });
  pick.addEventListener("blur", () => store.set({ hovered: null }));
  return { item, element, pick, eye };
}

const label = (item: Item): string => (item.reason ? (item.kind === "plane" ? "Plane" : "Axis") : item.name);

/** What a result is, beside its name. */
export function note(item: Item): string {
  if (item.reason) return REASONS[item.reason];
  const turns = item.kind === "axis" && (item.order ? `${item.order}-fold` : "every angle");
  const round = item.kind === "plane" && item.continuous && "one of all through the axis";
  const quality =
    item.evidence === "predicted" ? "predicted, not measured" : item.exact ? "exact" : "approximate";
  return [turns, round, quality].filter(Boolean).join(", ");
}

function show({ item, element, pick, eye }: Row, state: State): void {
  const selected = item.id === state.selected;
  const hidden = state.hidden.has(item.id);
  const color = item.reason ? "" : errorColor(item.error, state.answered?.maxError ?? state.maxError);
  (pick.firstElementChild as HTMLElement).style.color = color;
  pick.setAttribute("aria-pressed", String(selected));
  element.classList.toggle("selected", selected);
  element.classList.toggle("hovered", item.id === state.hovered);
  element.classList.toggle("off", hidden);
  if (eye && eye.ariaPressed !== String(!hidden)) {
    eye.setAttribute("aria-pressed", String(!hidden));
    eye.setAttribute("aria-label", `Show ${item.name}`);
    eye.replaceChildren(icon(hidden ? "hidden" : "eye"));
  }
  const details = element.querySelector("dl");
  if (selected === Boolean(details)) return;
  if (details) details.remove();
  else {
    const folded = element.closest<HTMLDetailsElement>("details.kind");
    if (folded) folded.open = true;
    element.append(numbers(item, state));
    element.scrollIntoView({ block: "nearest" });
  }
}

/** Where it is, in the file's own coordinates. */
function numbers(item: Item, state: State): HTMLElement {
  const source = sourceOf(item, state);
  const scale = state.result?.frame.scale ?? 1;
  const rows: [string, string][] = [[item.kind === "plane" ? "Normal" : "Direction", vector(item.direction)]];
  if (source && "offset" in source) rows.push(["Offset", short(source.offset, 6)]);
  if (source && "point" in source) rows.push(["Point", vector(source.point, scale)]);
  return h("dl", {}, ...rows.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))));
}

/** The entry of the answer that an item stands for. */
export function sourceOf(item: Item, state: State) {
  const index = Number(item.id.split(" ")[1]);
  if (item.reason === "similar") return state.result?.similar?.[index];
  if (item.reason) return state.result?.rejected?.[index];
  const list: (PlaneResult | AxisResult)[] | undefined =
    item.kind === "plane" ? state.result?.planes : state.result?.axes;
  return list?.[index];
}

function select(store: Store, id: string): void {
  store.set({ selected: store.get().selected === id ? null : id });
}

function toggle(store: Store, id: string): void {
  const hidden = new Set(store.get().hidden);
  if (!hidden.delete(id)) hidden.add(id);
  store.set({ hidden });
}

/** Hides all of a list, or shows them again if none is to be seen. */
function toggleAll(store: Store, ids: string[]): void {
  const hidden = new Set(store.get().hidden);
  const showing = ids.some((id) => !hidden.has(id));
  for (const id of ids) {
    if (showing) hidden.add(id);
    else hidden.delete(id);
  }
  store.set({ hidden });
}
