/** The directions of the file's x, y and z, in a corner; a click on one looks from there. */

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
    role: "group",
    "aria-label": "Look along an axis",
  });
  const arms = NAMES.map((name, index) => {
    const line = svg("line", { x1: SIZE / 2, y1: SIZE / 2, class: `gizmo-${name}` });
    const label = svg("text", {
      class: `gizmo-${name}`,
      "text-anchor": "middle",
      "dominant-baseline": "central",
    });
    label.textContent = name;
    const look = (): void => stage.lookFrom(index as 0 | 1 | 2);
    const target = svg("circle", {
      r: 9,
      class: "gizmo-target",
      role: "button",
      tabindex: 0,
      "aria-label": `Look from ${name}`,
    });
    target.addEventListener("click", look);
    target.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      look();
    });
    picture.append(line, label, target);
    return { line, label, target };
  });
  parent.append(picture);
  stage.onFrame(() => {
    const view = stage.camera.matrixWorldInverse;
    arms.forEach(({ line, label, target }, index) => {
      const direction = new Vector3().setComponent(index, 1).transformDirection(view);
      const [x, y] = [SIZE / 2 + ARM * direction.x, SIZE / 2 - ARM * direction.y];
      line.setAttribute("x2", x.toFixed(1));
      line.setAttribute("y2", y.toFixed(1));
      const [atX, atY] = [(x + 8 * direction.x).toFixed(1), (y - 8 * direction.y).toFixed(1)];
      label.setAttribute("x", atX);
      label.setAttribute("y", atY);
      target.setAttribute("cx", atX);
      target.setAttribute("cy", atY);
    });
  });
}
