/** The directions of the file's x, y and z, in a corner. */

import { Vector3 } from "three";
import { svg } from "./dom";
import type { Stage } from "./stage";

const NAMES = ["x", "y", "z"] as const;
const SIZE = 64;
const ARM = 20;

/** Draws into `parent` and follows the camera. */
export function attachGizmo(stage: Stage, parent: HTMLElement): void {
  const picture = svg("svg", {
    viewBox: `0 0 ${SIZE} ${SIZE}`,
    width: SIZE,
    height: SIZE,
    "aria-hidden": "true",
  });
  const arms = NAMES.map((name) => {
    const line = svg("line", { x1: SIZE / 2, y1: SIZE / 2, class: `gizmo-${name}` });
    const label = svg("text", {
      class: `gizmo-${name}`,
      "text-anchor": "middle",
      "dominant-baseline": "central",
    });
    label.textContent = name;
    picture.append(line, label);
    return { line, label };
  });
  parent.append(picture);
  stage.onFrame(() => {
    const view = stage.camera.matrixWorldInverse;
    arms.forEach(({ line, label }, index) => {
      const direction = new Vector3().setComponent(index, 1).transformDirection(view);
      const [x, y] = [SIZE / 2 + ARM * direction.x, SIZE / 2 - ARM * direction.y];
      line.setAttribute("x2", x.toFixed(1));
      line.setAttribute("y2", y.toFixed(1));
      label.setAttribute("x", (x + 8 * direction.x).toFixed(1));
      label.setAttribute("y", (y - 8 * direction.y).toFixed(1));
    });
  });
}
