/** What to tell people about each problem the service answers with (app/problems.py), and about no answer at all. */

export interface Problem {
  /** The last part of `type`; the page's own ones are below. */
  slug: string;
  /** The service's own sentence about this very case. */
  detail: string;
  status: number;
  requestId: string | null;
}

export interface ProblemWords {
  title: string;
  /** What to do about it. */
  advice: string;
  /** Whether the same request may succeed later. */
  again: boolean;
}

const WORDS: Record<string, ProblemWords> = {
  "malformed-request": words("The request was not understood", "Reload this page and try again.", true),
  "invalid-parameter": words("A setting is not allowed", "Choose another value."),
  unauthorized: words("This service needs a key", "Enter a key you were given by its operator."),
  "not-found": words("The service does not offer this", "It may be older than this page; reload the page."),
  "method-not-allowed": words(
    "The service does not offer this",
    "It may be older than this page; reload the page.",
  ),
  "not-acceptable": words("The service cannot answer in this format", "Choose another format."),
  "upload-too-slow": words("The upload took too long", "Try a faster connection, or a smaller file.", true),
  "upload-too-large": words(
    "The file is too large",
    "Reduce the mesh, or write it in a binary format (GLB, PLY, STL).",
  ),
  "mesh-too-large": words("The mesh is too large", "Reduce its number of faces, for instance by decimation."),
  "mesh-too-complex": words(
    "The mesh is too complex",
    "Too many faces cross or crowd each other. Send its outer surface alone, or a simplified mesh.",
  ),
  "unsupported-format": words("This format is not read", "The name's ending must fit the content."),
  "unreadable-mesh": words(
    "The file cannot be read",
    "It may be damaged or incomplete. Write it again, with its geometry inside.",
  ),
  "empty-mesh": words(
    "There is no surface in the file",
    "An empty scene has no faces, and too few points are no surface; write a triangle mesh.",
  ),
  "degenerate-mesh": words(
    "The mesh cannot be measured",
    "Check it for invalid coordinates and for faces without area.",
  ),
  "no-plane": words(
    "There is no mirror plane to complete it with",
    "Raise the largest error, or choose a plane from the list.",
  ),
  "no-axis": words(
    "There is no rotation axis to cut sectors about",
    "Raise the largest error, or choose an axis from the list.",
  ),
  "internal-error": words("The service has a defect", "Please report it, with the request id."),
  overloaded: words("The service is busy", "Try again in a moment.", true),
  "worker-lost": words("The computation was lost", "Try again in a moment.", true),
  "not-ready": words("The service is starting", "Try again in a few seconds.", true),
  "deadline-passed": words(
    "The computation took too long",
    "Try again, or reduce the number of faces.",
    true,
  ),
  "no-answer": words(
    "The service does not answer",
    "Check that it is running and that you are connected to it.",
    true,
  ),
  "not-understood": words(
    "The answer was not understood",
    "Reload this page: it may be older than the service.",
    true,
  ),
};

function words(title: string, advice: string, again = false): ProblemWords {
  return { title, advice, again };
}

/** Words for a problem, also for one that this page does not know. */
export function problemWords(problem: Problem): ProblemWords {
  return WORDS[problem.slug] ?? words("The service refused", "See what it says.", problem.status >= 500);
}

/** The problem an answer states, or one that says that it states none. */
export function problemFrom(status: number, text: string): Problem {
  try {
    const body = JSON.parse(text) as { type?: unknown; detail?: unknown; request_id?: unknown };
    if (typeof body.type === "string" && typeof body.detail === "string") {
      const requestId = typeof body.request_id === "string" ? body.request_id : null;
      return { slug: body.type.split("/").pop() ?? "", detail: body.detail, status, requestId };
    }
  } catch {
    // A proxy's error page, for instance.
  }
  return {
    slug: "not-understood",
    detail: `Something on the way answered with status ${status}.`,
    status,
    requestId: null,
  };
}

export const noAnswer: Problem = {
  slug: "no-answer",
  detail: "The connection broke off or was refused.",
  status: 0,
  requestId: null,
};

export class ProblemError extends Error {
  constructor(readonly problem: Problem) {
    super(problem.detail);
  }
}
