/** One plane in the scene: a translucent quad around the mesh, its rim, and the line in which it cuts the surface. */

import {
  BufferGeometry,
  DoubleSide,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineLoop,
  Mesh,
  MeshBasicMaterial,
  type Object3D,
} from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import type { Item } from "./items";
import type { Emphasis, Marker } from "./markers";
import type { Vector } from "./result";
import { section } from "./section";
import { across, add, dot, scaled } from "./vector";

/** How far the quad reaches beyond the mesh, unit frame. */
const MARGIN = 0.06;
const FILL: Record<Emphasis, number> = { normal: 0.15, strong: 0.32, faint: 0.05 };
const RIM: Record<Emphasis, number> = { normal: 0.75, strong: 1, faint: 0.25 };
const CUT: Record<Emphasis, number> = { normal: 0.9, strong: 1, faint: 0.15 };

export class PlaneView implements Marker {
  readonly object = new Group();
  readonly target: Object3D;
  private readonly fill = new MeshBasicMaterial({ transparent: true, depthWrite: false, side: DoubleSide });
  private readonly rim = new LineBasicMaterial({ transparent: true, depthWrite: false });
  private readonly cut = new LineMaterial({ transparent: true, linewidth: 2 });

  constructor(item: Item, corners: Float32Array, up: Vector) {
    const quad = quadAround(item, corners, up);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute(quad.flat(), 3));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    this.target = new Mesh(geometry, this.fill);
    this.object.add(this.target, new LineLoop(geometry.clone().setIndex(null), this.rim));
    const segments = section(corners, item.direction, item.point);
    if (segments.length > 0) {
      const lines = new LineSegmentsGeometry();
      lines.setPositions(segments);
      this.object.add(new LineSegments2(lines, this.cut));
    }
  }

  paint(color: string, emphasis: Emphasis, crowd: number): void {
    for (const material of [this.fill, this.rim, this.cut]) material.color.set(color);
    this.fill.opacity = emphasis === "strong" ? FILL.strong : FILL[emphasis] / Math.sqrt(crowd);
    this.rim.opacity = emphasis === "strong" ? RIM.strong : RIM[emphasis] / Math.sqrt(crowd);
    this.cut.opacity = CUT[emphasis];
    this.cut.linewidth = emphasis === "strong" ? 3 : 2;
    this.object.renderOrder = emphasis === "strong" ? 2 : 1;
  }
}

/** The corners of the smallest upright rectangle in the plane that the mesh, seen along the normal, fits into. */
function quadAround(item: Item, corners: Float32Array, up: Vector): Vector[] {
  const [right, above] = across(item.direction, up);
  const low = [Infinity, Infinity];
  const high = [-Infinity, -Infinity];
  const origin = [dot(right, item.point), dot(above, item.point)];
  for (let at = 0; at < corners.length; at += 3) {
    const point: Vector = [corners[at], corners[at + 1], corners[at + 2]];
    const place = [dot(right, point) - origin[0], dot(above, point) - origin[1]];
    for (let k = 0; k < 2; k++) {
      low[k] = Math.min(low[k], place[k]);
      high[k] = Math.max(high[k], place[k]);
    }
  }
  const corner = (x: number, y: number) => add(item.point, add(scaled(right, x), scaled(above, y)));
  const [left, bottom, wide, tall] = [low[0] - MARGIN, low[1] - MARGIN, high[0] + MARGIN, high[1] + MARGIN];
  return [corner(left, bottom), corner(wide, bottom), corner(wide, tall), corner(left, tall)];
}
