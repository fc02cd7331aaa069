/** Requests to the service this page came from. Addresses are relative: it may live behind a path prefix. */

import { noAnswer, problemFrom, ProblemError } from "./problems";
import type { LevelName, Limits, Mode, Vector } from "./result";
import { withCompanions } from "./together";

export interface Options {
  mode: Mode;
  maxError: number;
  level: LevelName;
  tolerance: number | null;
}

/** The options of a state, and nothing else of it. */
export const optionsIn = ({ mode, maxError, level, tolerance }: Options): Options => ({
  mode,
  maxError,
  level,
  tolerance,
});

export interface Progress {
  /** Bytes sent, of how many. */
  sent(done: number, total: number): void;
  /** Everything is sent; now the service computes. */
  computing(): void;
}

export interface Download {
  content: Blob;
  /** The value of a header of the answer, or null. */
  header(name: string): string | null;
}

const KEY = "prsnet-key";

export const storedKey = (): string => sessionStorage.getItem(KEY) ?? "";
export const storeKey = (key: string): void => sessionStorage.setItem(KEY, key);

/** The address of one of the service's endpoints. */
export function endpoint(path: string, query: Record<string, string | string[]> = {}): URL {
  const url = new URL(path, document.baseURI);
  for (const [name, values] of Object.entries(query)) {
    for (const value of [values].flat()) url.searchParams.append(name, value);
  }
  return url;
}

/** What `/detect` is asked for: only what differs from its defaults. */
export function detectQuery(options: Options): Record<string, string | string[]> {
  return {
    ...(options.mode === "full" ? {} : { mode: options.mode }),
    ...(options.maxError === 4e-4 ? {} : { max_error: String(options.maxError) }),
    ...(options.level === "auto" ? {} : { level: options.level }),
    ...(options.tolerance === null ? {} : { tolerance: String(options.tolerance) }),
  };
}

type PlaneNumbers = { normal: Vector; offset: number };

/** The query of what answers with a mesh, at a plane in the input frame, or at the best one if there is none. */
export function meshQuery(
  options: Options,
  format: string,
  plane: PlaneNumbers | null,
): Record<string, string> {
  return {
    format,
    ...(plane
      ? { normal: plane.normal.join(","), offset: String(plane.offset) }
      : { max_error: String(options.maxError) }),
  };
}

/** The query of `/sector`, about an axis in the input frame, or about the best one if there is none. */
export function sectorQuery(
  options: Options,
  format: string,
  axis: { direction: Vector; point: Vector; order: number } | null,
): Record<string, string> {
  if (!axis) return { format, max_error: String(options.maxError) };
  const { direction, point, order } = axis;
  return { format, axis: direction.join(","), point: point.join(","), order: String(order) };
}

/** The query of `/complete`. */
export function completeQuery(
  options: Options,
  format: string,
  symmetrize: boolean,
  plane: PlaneNumbers | null,
): Record<string, string> {
  return { ...meshQuery(options, format, plane), ...(symmetrize ? { symmetrize: "true" } : {}) };
}

/**
 * Sends a file, with those that belong to it, and waits for the answer.
 *
 * Rejects with a `ProblemError`, or with an `AbortError` when `signal` was used. XMLHttpRequest, because fetch does
 * not tell how much of an upload is sent.
 */
export function send(url: URL, file: File, signal: AbortSignal, progress?: Progress): Promise<Download> {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    const form = new FormData();
    for (const part of withCompanions(file)) form.append("file", part, part.name);
    request.open("POST", url);
    request.responseType = "blob";
    if (storedKey()) request.setRequestHeader("X-API-Key", storedKey());
    request.upload.onprogress = (event) => progress?.sent(event.loaded, event.total);
    request.upload.onload = () => progress?.computing();
    request.onerror = () => reject(new ProblemError(noAnswer));
    request.onabort = () => reject(new DOMException("Cancelled.", "AbortError"));
    request.onload = async () => {
      const content = request.response as Blob;
      if (request.status === 200) resolve({ content, header: (name) => request.getResponseHeader(name) });
      else reject(new ProblemError(problemFrom(request.status, await content.text())));
    };
    signal.addEventListener("abort", () => request.abort());
    request.send(form);
  });
}

/** The limits of a request; null where they cannot be had, which is no reason not to try. */
export async function fetchLimits(): Promise<Limits | "unauthorized" | null> {
  try {
    const headers = storedKey() ? { "X-API-Key": storedKey() } : undefined;
    const response = await fetch(endpoint("model"), headers ? { headers } : {});
    if (response.status === 401) return "unauthorized";
    return response.ok ? ((await response.json()) as { limits: Limits }).limits : null;
  } catch {
    return null;
  }
}

/** The same request for a terminal. */
export function curlLine(filenames: string[], options: Options, shellWord: (word: string) => string): string {
  const key = storedKey() ? ' -H "X-API-Key: $PRSNET_KEY"' : "";
  const files = filenames.map((name) => ` -F ${shellWord(`file=@${name}`)}`).join("");
  return `curl${key}${files} ${shellWord(endpoint("detect", detectQuery(options)).href)}`;
}
