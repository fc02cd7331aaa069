/** From a file to a result on the page: what happens when one is opened, and when an option is changed. */

import { detectQuery, endpoint, fetchLimits, optionsIn, send, type Options } from "./api";
import { bytes } from "./format";
import { formats } from "./formats";
import { readAnnotated, type AnnotatedMesh } from "./glb";
import { itemsOf } from "./items";
import { cornerNormals } from "./normals";
import { ProblemError, type Problem } from "./problems";
import type { DetectResult, Limits } from "./result";
import type { State, Store, Surface, Up } from "./store";
import { withCompanions } from "./together";

/** A start takes some ten seconds, or a minute where kernels are compiled. */
const [MOST_TRIES, PAUSE_MS] = [90, 1000];

export interface Session {
  open(file: File): Promise<void>;
  /** Ask again about the same file, with the options of the state. */
  again(): Promise<void>;
  /** Do again what failed. */
  retry(): Promise<void>;
  cancel(): void;
  /** Back to the start. */
  close(): void;
}

export function createSession(store: Store, askForKey: () => Promise<boolean>): Session {
  let running: AbortController | null = null;
  /** The file whose mesh is on the page. */
  let shown: File | null = null;
  let attempt: { file: File; first: boolean } | null = null;
  let limits: Limits | null = null;
  void fetchLimits().then(async (answer) => {
    if (answer === "unauthorized") {
      if (await askForKey()) answer = await fetchLimits();
    }
    if (answer !== "unauthorized") limits = answer;
  });

  const run = async (file: File, first: boolean): Promise<void> => {
    running?.abort();
    const own = (running = new AbortController());
    attempt = { file, first };
    const options = optionsIn(store.get());
    try {
      refuseTooLarge(file, limits);
      store.set({ file, phase: { kind: "uploading", share: 0 } });
      const answer = await onceReady(store, own.signal, () =>
        request(file, options, first, own.signal, store),
      );
      if (own !== running) return;
      shown = file;
      store.set({
        ...answer,
        ...(first ? fresh(answer.result) : {}),
        ...untouched(store.get(), answer),
        phase: { kind: "idle" },
      });
    } catch (error) {
      if (own !== running) return;
      const back = { file: shown, ...optionsOf(store.get()) };
      if (error instanceof DOMException && error.name === "AbortError") {
        store.set({ ...back, phase: { kind: "idle" } });
        return;
      }
      const problem = problemOf(error);
      if (problem.slug === "unauthorized" && (await askForKey())) return run(file, first);
      store.set({ ...back, phase: { kind: "failed", problem } });
    }
  };

  return {
    open: (file) => run(file, true),
    async again() {
      if (shown) await run(shown, false);
    },
    async retry() {
      if (attempt) await run(attempt.file, attempt.first);
    },
    cancel: () => running?.abort(),
    close() {
      running?.abort();
      running = shown = attempt = null;
      store.set({ ...empty, phase: { kind: "idle" }, file: null, batch: [] });
    },
  };
}

const empty: Partial<State> = {
  result: null,
  answered: null,
  items: [],
  surface: null,
  selected: null,
  hovered: null,
  view: "mesh",
};

/** After a failure the controls show again what the result on the page was asked with. */
function optionsOf(state: State): Partial<State> {
  return state.answered ? optionsIn(state.answered) : {};
}

/** Another mesh is first seen as it is, with the direction upwards that is usual in its format. */
function fresh(result: DetectResult): Partial<State> {
  const up: Up = formats().read.find(({ extension }) => extension === result.mesh.format)?.up ?? "y";
  return { up, view: "mesh" };
}

/** Other results have other numbers: nothing is selected or hidden; without any there is nothing to preview. */
function untouched(state: State, answer: Answer): Partial<State> {
  const none = answer.result.planes.length + answer.result.axes.length === 0;
  return {
    selected: null,
    hovered: null,
    hidden: new Set(),
    ...(none && state.view !== "mesh" ? { view: "mesh" } : {}),
  };
}

/** A service that has just been started is waited for, as someone who has just started it would do. */
async function onceReady<T>(store: Store, signal: AbortSignal, attempt: () => Promise<T>): Promise<T> {
  for (let tries = 0; ; tries++) {
    try {
      return await attempt();
    } catch (error) {
      if (!(error instanceof ProblemError) || error.problem.slug !== "not-ready" || tries >= MOST_TRIES)
        throw error;
    }
    store.set({ phase: { kind: "starting" } });
    await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
    signal.throwIfAborted();
  }
}

type Answer = Pick<State, "result" | "answered" | "items"> & { result: DetectResult; surface?: Surface };

/** Asks for the mesh and the result in one answer the first time, for the result alone after that. */
async function request(
  file: File,
  options: Options,
  first: boolean,
  signal: AbortSignal,
  store: Store,
): Promise<Answer> {
  const query = {
    ...detectQuery(options),
    include: ["rejected", "bop"],
    ...(first ? { format: "glb" } : {}),
  };
  const { content } = await send(endpoint("detect", query), file, signal, {
    sent: (done, total) => store.set({ phase: { kind: "uploading", share: total > 0 ? done / total : 1 } }),
    computing: () => store.set({ phase: { kind: "computing" } }),
  });
  if (!first) {
    const result = JSON.parse(await content.text()) as DetectResult;
    return { result, answered: options, items: itemsOf(result) };
  }
  const annotated = readAnnotated(await content.arrayBuffer());
  const { result } = annotated;
  const surface = await surfaceOf(annotated);
  return { result, answered: options, items: itemsOf(result), surface };
}

/** Into the unit frame while there are 64 bits to a coordinate; the graphics card has 32. */
async function surfaceOf({ corners, colors, places, pictures, result }: AnnotatedMesh): Promise<Surface> {
  const { center, scale } = result.frame;
  const unit = new Float32Array(corners.length);
  for (let i = 0; i < corners.length; i++) unit[i] = (corners[i] - center[i % 3]) / scale;
  const decoded = await Promise.all(
    pictures.map(async ({ content, start, count }) => {
      const image = await createImageBitmap(content).catch(() => null); // a broken picture is none
      return image && { image, start, count };
    }),
  );
  return {
    corners: unit,
    normals: cornerNormals(unit),
    colors,
    places,
    pictures: decoded.filter((picture) => picture !== null),
  };
}

/** Told before the upload: a connection that is cut while sending would hide the service's own words. */
function refuseTooLarge(file: File, limits: Limits | null): void {
  const size = withCompanions(file).reduce((total, part) => total + part.size, 0);
  if (!limits || size < limits.max_upload_bytes) return;
  const detail = `The file has ${bytes(size)}; the service takes ${bytes(limits.max_upload_bytes)}.`;
  throw new ProblemError({ slug: "upload-too-large", detail, status: 413, requestId: null });
}

function problemOf(error: unknown): Problem {
  if (error instanceof ProblemError) return error.problem;
  const detail = error instanceof Error ? error.message : String(error);
  return { slug: "not-understood", detail, status: 0, requestId: null };
}
