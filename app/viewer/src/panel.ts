/** The panel beside the picture. Its parts are made anew for every answer, and follow the state in between. */

import { controls } from "./controls";
import { byId, h } from "./dom";
import { exports } from "./exports";
import { levels, type ChooseLevel } from "./levels";
import { lists, type Lists } from "./list";
import type { Session } from "./session";
import type { Say } from "./status";
import { isBusy, type Store } from "./store";
import { facts, nearest, summary, warnings } from "./summary";

export function attachPanel(
  store: Store,
  session: Session,
  say: Say,
  batch: HTMLElement,
  picturePng: () => Promise<Blob>,
): void {
  const panel = byId("panel");
  const head = h("div", { class: "part" });
  const results = h("div", { class: "part" });
  const foot = h("div", { class: "part" });
  const ask = controls(store, () => void session.again());
  const takeAway = exports(store, say, (file) => void session.open(file), picturePng);
  panel.append(batch, head, ask.element, results, takeAway.element, foot);
  const choose: ChooseLevel = (level, tolerance) => {
    store.set({ level, tolerance });
    void session.again();
  };
  let shown: Lists | null = null;

  store.subscribe((state, before) => {
    const { result } = state;
    panel.hidden = result === null && state.batch.length === 0;
    panel.classList.toggle("empty", result === null);
    panel.classList.toggle("waiting", isBusy(state));
    if (state.mode !== before.mode || state.maxError !== before.maxError || state === before)
      ask.update(state);
    if (!result) return;
    if (result !== before.result || !shown) {
      shown = lists(store);
      head.replaceChildren(
        ...[summary(result), nearest(result), warnings(result)].filter((part) => part !== null),
      );
      results.replaceChildren(...shown.elements);
      foot.replaceChildren(
        ...[levels(result, choose, state.level !== "auto" || state.tolerance !== null), facts(result)].filter(
          (part) => part !== null,
        ),
      );
    }
    shown.update(state);
    takeAway.update(state);
  });
}
