/** Puts the page together. */

import { createBatch } from "./batch";
import { byId } from "./dom";
import { fetchExample } from "./examples";
import { attachGizmo } from "./gizmo";
import { HeatMeter } from "./heat";
import { askForKey } from "./keydialog";
import { readLink } from "./link";
import { attachMeasure } from "./measure";
import { attachPanel } from "./panel";
import { attachPicture, attachPointer } from "./picture";
import { attachProblemBox } from "./problembox";
import { attachProgress } from "./progress";
import { createSession } from "./session";
import { Stage } from "./stage";
import { attachDrop, attachStart } from "./start";
import { attachStatus, createSay } from "./status";
import { createStore } from "./store";
import { attachTheme, initialTheme } from "./theme";
import { attachViews } from "./views";

const store = createStore({
  phase: { kind: "idle" },
  file: null,
  mode: "full",
  maxError: 4e-4,
  level: "auto",
  tolerance: null,
  batch: [],
  result: null,
  answered: null,
  items: [],
  surface: null,
  selected: null,
  hovered: null,
  hidden: new Set(),
  view: "mesh",
  up: "y",
  heatLargest: null,
  flat: false,
  wire: false,
  grid: false,
  ruler: false,
  theme: initialTheme(),
});
const say = createSay();
const session = createSession(store, askForKey);
/** Another mesh is asked about at the level that people mean: a tolerance in the units of the last says nothing. */
const show = (file: File): void => {
  store.set({ level: "auto", tolerance: null });
  void session.open(file);
};
const batch = createBatch(store, show);
const open = (files: File[]): void => {
  if (files.length > 1) return void batch.open(files);
  store.set({ batch: [] });
  show(files[0]);
};

attachTheme(store);
const stage = createStage();
if (stage) {
  const markers = attachPicture(store, stage, new HeatMeter());
  attachPointer(store, stage, byId<HTMLCanvasElement>("canvas"), markers);
  attachGizmo(stage, byId("tools"));
  attachMeasure(store, stage);
}
attachViews(store, () => stage?.home());
attachStart(store, open);
attachDrop(open);
attachPanel(store, session, say, batch.element, async () => {
  if (!stage) throw new Error("There is no picture without WebGL.");
  return stage.picture();
});
attachProgress(store, () => session.cancel());
attachProblemBox(store, () => void session.retry());
attachStatus(store, say);
attachHead();
openLink();

/** The picture; without WebGL there is none, and the lists and numbers remain. */
function createStage(): Stage | null {
  try {
    return new Stage(byId<HTMLCanvasElement>("canvas"));
  } catch {
    byId("picture").classList.add("no-webgl");
    return null;
  }
}

/** What the address asks for, if it asks for anything. */
function openLink(): void {
  const link = readLink(location.hash);
  if (!link) return;
  store.set(link.options);
  void fetchExample(link.example).then((file) => session.open(file));
}

function attachHead(): void {
  const another = byId<HTMLButtonElement>("open");
  another.addEventListener("click", () => session.close());
  store.subscribe((state) => {
    byId("filename").textContent = state.result?.mesh.filename ?? "";
    another.hidden = state.result === null;
    document.title = state.result
      ? `${state.result.mesh.filename}: ${state.result.point_group} · prsnet`
      : "prsnet: symmetries of a mesh";
  });
}
