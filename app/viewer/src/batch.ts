/** Several files at once: a list of what was found in each, to be opened one by one, and all of it as CSV. */

import { detectQuery, endpoint, optionsIn, send } from "./api";
import { download, h } from "./dom";
import { plural } from "./format";
import { noAnswer, problemWords, ProblemError, type Problem } from "./problems";
import type { AxisResult, DetectResult, PlaneResult } from "./result";
import type { Entry, Store } from "./store";

/** Requests at a time. */
const AT_ONCE = 2;

export interface Batch {
  element: HTMLElement;
  /** Asks about all files, and opens the first. */
  open(files: File[]): Promise<void>;
}

export function createBatch(store: Store, show: (file: File) => void): Batch {
  const list = h("ul", { class: "files" });
  const title = h("h3", {});
  const csv = h(
    "button",
    { type: "button", class: "button", onclick: () => saveCsv(store.get().batch) },
    "CSV of all",
  );
  const element = h("section", { class: "batch", "aria-label": "Files", hidden: true }, title, list, csv);
  let running: AbortController | null = null;

  store.subscribe((state, before) => {
    if (state !== before && state.batch === before.batch && state.file === before.file) return;
    element.hidden = state.batch.length === 0;
    if (element.hidden) running?.abort();
    const done = state.batch.filter(({ result, problem }) => result || problem).length;
    title.textContent =
      done < state.batch.length ? `${done} of ${state.batch.length} files` : plural(done, "file");
    csv.disabled = done < state.batch.length;
    list.replaceChildren(...state.batch.map((entry) => h("li", {}, row(entry, entry.file === state.file))));
  });

  function row(entry: Entry, isOpen: boolean): HTMLElement {
    return h(
      "button",
      { type: "button", class: "file", "aria-current": String(isOpen), onclick: () => show(entry.file) },
      h("span", { class: "name" }, entry.file.name),
      h("span", { class: entry.problem ? "note danger" : "note" }, outcome(entry)),
    );
  }

  return {
    element,
    async open(files) {
      running?.abort();
      const own = (running = new AbortController());
      store.set({ batch: files.map((file) => ({ file, result: null, problem: null })) });
      show(files[0]);
      const waiting = [...files.keys()];
      const work = async (): Promise<void> => {
        for (let index = waiting.shift(); index !== undefined; index = waiting.shift()) {
          const found = await ask(files[index], own.signal);
          if (own.signal.aborted) return;
          const batch = [...store.get().batch];
          batch[index] = { ...batch[index], ...found };
          store.set({ batch });
        }
      };
      await Promise.all(Array.from({ length: AT_ONCE }, work));
    },
  };

  async function ask(file: File, signal: AbortSignal): Promise<Partial<Entry>> {
    try {
      const options = { ...optionsIn(store.get()), tolerance: null };
      const { content } = await send(endpoint("detect", detectQuery(options)), file, signal);
      return { result: JSON.parse(await content.text()) as DetectResult };
    } catch (error) {
      const problem: Problem =
        error instanceof ProblemError ? error.problem : { ...noAnswer, detail: String(error) };
      return { problem };
    }
  }
}

/** What came of one file, in a few words. */
export function outcome({ result, problem }: Entry): string {
  if (problem) return problemWords(problem).title;
  if (!result) return "waiting …";
  const { planes, axes } = result;
  return `${result.point_group}: ${plural(planes.length, "plane")}, ${plural(axes.length, "axis", "axes")}`;
}

const COLUMNS =
  "file,point_group,kind,index,x,y,z,offset,px,py,pz,order,continuous,exact,symmetry_error,rms_distance,evidence";

/** A row a plane or axis, as `format=csv` of the service; of a file without any, or without an answer, one row. */
export function csvOf(entries: Entry[]): string {
  const rows = entries.flatMap(({ file, result, problem }): unknown[][] => {
    if (!result) return [[file.name, "", problem?.slug ?? "none"]];
    const start = [file.name, result.point_group];
    const rest = (found: PlaneResult | AxisResult, order: number | null): unknown[] => [
      ...found.point,
      order ?? "",
      found.continuous ? "yes" : "no",
      found.exact ? "yes" : "no",
      found.symmetry_error,
      found.rms_distance,
      found.evidence,
    ];
    const found = [
      ...result.planes.map((plane, i) => [
        ...start,
        "plane",
        i,
        ...plane.normal,
        plane.offset,
        ...rest(plane, null),
      ]),
      ...result.axes.map((axis, i) => [
        ...start,
        "axis",
        i,
        ...axis.direction,
        "",
        ...rest(axis, axis.order),
      ]),
    ];
    return found.length > 0 ? found : [[...start, "none"]];
  });
  const width = COLUMNS.split(",").length;
  const filled = rows.map((row) =>
    [...row, ...Array<string>(width - row.length).fill("")].map(cell).join(","),
  );
  return [COLUMNS, ...filled, ""].join("\r\n");
}

function cell(value: unknown): string {
  const text = String(value);
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

function saveCsv(entries: Entry[]): void {
  download(new Blob([csvOf(entries)], { type: "text/csv" }), "symmetries.csv");
}
