/** Keeps the 3D picture in step with the state, and tells the state what the pointer is on. */

import { subject, type State, type Store } from "./store";
import type { Heat, HeatMeter } from "./heat";
import { LEAST_HEAT, MeshView, type MeshColors } from "./meshview";
import { Markers } from "./markers";
import type { Stage } from "./stage";
import type { Vector } from "./result";

/** A pointer that moved farther than this between down and up has turned the shape, not clicked. */
const CLICK = 5;

const COLORS: Record<State["theme"], MeshColors> = {
  light: { surface: "#c3c9d2", edges: "#5d6675", original: "#8fb3dd", image: "#efb877" },
  dark: { surface: "#98a1af", edges: "#20262f", original: "#6f9bd0", image: "#dca05a" },
};

/** Answers the markers, for the pointer. */
export function attachPicture(store: Store, stage: Stage, meter: HeatMeter): Markers {
  const mesh = new MeshView();
  const markers = new Markers();
  let heat: { about: string; heat: Heat } | null = null;
  stage.scene.add(mesh.group, markers.group);

  store.subscribe((state, before) => {
    const first = state === before;
    if (state.flat !== before.flat) stage.setFlat(state.flat);
    if (state.wire !== before.wire) mesh.setWire(state.wire);
    if (first || state.theme !== before.theme) mesh.setColors(COLORS[state.theme]);
    if (state.up !== before.up || state.surface !== before.surface) stage.setUp(state.up);
    if (state.surface !== before.surface) {
      heat = null;
      mesh.group.visible = state.surface !== null;
      if (state.surface) {
        mesh.load(state.surface);
        meter.load(state.surface.corners, state.surface.normals);
        stage.home();
      }
    }
    if (state.items !== before.items || state.up !== before.up || state.surface !== before.surface) {
      const up: Vector = state.up === "y" ? [0, 1, 0] : [0, 0, 1];
      markers.clear(state.surface?.corners ?? new Float32Array(), up);
    }
    markers.update(state);
    const about = subject(state);
    const key = about ? about.transform.join() : "";
    const beforeKey = subject(before)?.transform.join() ?? "";
    if (
      state.view !== before.view ||
      state.theme !== before.theme ||
      key !== beforeKey ||
      state.surface !== before.surface
    ) {
      if (state.view === "mirror" && about) mesh.showMirror(about);
      else if (state.view !== "heat" || !about) mesh.showMesh();
      else if (heat?.about === key) showHeat(heat.heat);
      else measure(about.transform, key);
    }
    describe(state);
    stage.render();
  });
  return markers;

  /** What the picture shows, for who cannot see it: a screen reader, a test. */
  function describe(state: State): void {
    const canvas = stage.canvas;
    const faces = (state.surface?.corners.length ?? 0) / 9;
    canvas.dataset.faces = String(faces);
    canvas.dataset.shown = markers.shown().join(",");
    canvas.ariaDescription = state.result
      ? `${state.result.mesh.filename}, ${faces} faces. Shown: ${markers.shown().join(", ") || "the mesh alone"}.`
      : "Nothing yet.";
  }

  function measure(transform: number[], key: string): void {
    mesh.showMesh();
    queueMicrotask(() => store.set({ heatLargest: null }));
    void meter
      .measure(transform, () => undefined)
      .then((measured) => {
        const state = store.get();
        heat = { about: key, heat: measured };
        if (subject(state)?.transform.join() !== key) return;
        if (state.view === "heat") showHeat(measured);
      });
  }

  function showHeat(measured: Heat): void {
    mesh.showHeat(measured, Math.max(measured.largest, LEAST_HEAT));
    stage.render();
    // Not at once: a listener is being told of another change.
    queueMicrotask(() => {
      if (store.get().heatLargest !== measured.largest) store.set({ heatLargest: measured.largest });
    });
  }
}

/** Hover and click on planes and axes. */
export function attachPointer(store: Store, stage: Stage, canvas: HTMLCanvasElement, markers: Markers): void {
  let down: [number, number] | null = null;
  const under = (event: PointerEvent) =>
    markers.idOf(stage.pick(event.clientX, event.clientY, markers.targets()));
  canvas.addEventListener("pointermove", (event) => {
    if (event.pointerType === "touch" || event.buttons !== 0) return;
    const hovered = under(event);
    canvas.style.cursor = hovered ? "pointer" : "";
    if (hovered !== store.get().hovered) store.set({ hovered });
  });
  canvas.addEventListener("pointerleave", () => store.set({ hovered: null }));
  canvas.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]));
  canvas.addEventListener("pointerup", (event) => {
    if (!down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > CLICK) return;
    const id = under(event);
    store.set({ selected: id === store.get().selected ? null : id });
  });
}
