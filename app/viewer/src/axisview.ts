/**
 * One axis in the scene: a thin rod, and at both ends the sign of its order as crystallographers draw it: a lens for 2,
 * a triangle for 3, a square for 4, and so on; a ring where every angle is a symmetry.
 */

import {
  CircleGeometry,
  CylinderGeometry,
  DoubleSide,
  Group,
  Mesh,
  MeshBasicMaterial,
  Quaternion,
  TorusGeometry,
  Vector3,
  type BufferGeometry,
  type Object3D,
} from "three";
import type { Item } from "./items";
import type { Emphasis, Marker } from "./markers";
import { add, dot, scaled } from "./vector";

const RADIUS = 0.0045;
/** What the pointer may miss it by. */
const REACH = 0.02;
const SIGN = 0.026;
const MARGIN = 0.11;
const OPACITY: Record<Emphasis, number> = { normal: 0.95, strong: 1, faint: 0.2 };
const THICKNESS: Record<Emphasis, number> = { normal: 1, strong: 1.7, faint: 0.8 };

export class AxisView implements Marker {
  readonly object = new Group();
  readonly target: Object3D;
  private readonly material = new MeshBasicMaterial({ transparent: true, side: DoubleSide });
  private readonly rod: Mesh;
  private readonly signs: Mesh[] = [];

  constructor(item: Item, corners: Float32Array) {
    const [low, high] = extent(item, corners);
    const size = high - low;
    this.rod = new Mesh(new CylinderGeometry(RADIUS, RADIUS, size, 12), this.material);
    this.target = new Mesh(new CylinderGeometry(REACH, REACH, size, 8));
    this.target.visible = false; // the pointer finds it nevertheless
    this.object.add(this.rod, this.target);
    for (const side of [-1, 1]) {
      const sign = new Mesh(signOf(item), this.material);
      sign.rotateX(Math.PI / 2);
      sign.position.y = (side * size) / 2;
      this.signs.push(sign);
      this.object.add(sign);
    }
    this.object.quaternion.copy(
      new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), new Vector3(...item.direction)),
    );
    this.object.position.set(...add(item.point, scaled(item.direction, (low + high) / 2)));
  }

  paint(color: string, emphasis: Emphasis, crowd: number): void {
    this.material.color.set(color);
    this.material.opacity = OPACITY[emphasis];
    const thickness = THICKNESS[emphasis] * (emphasis === "strong" ? 1 : Math.max(0.4, crowd ** -0.25));
    this.rod.scale.set(thickness, 1, thickness);
    for (const sign of this.signs) sign.scale.setScalar(thickness);
  }
}

function signOf(item: Item): BufferGeometry {
  if (item.continuous || item.order === null) return new TorusGeometry(SIGN, 0.004, 8, 40);
  if (item.order === 2) return new CircleGeometry(SIGN * 1.2, 32).scale(0.5, 1, 1);
  return new CircleGeometry(SIGN * 1.15, Math.min(item.order, 48));
}

/** Where the mesh begins and ends along the axis, from its point, with a margin. */
function extent(item: Item, corners: Float32Array): [number, number] {
  const origin = dot(item.direction, item.point);
  const [x, y, z] = item.direction;
  let [low, high] = [Infinity, -Infinity];
  for (let at = 0; at < corners.length; at += 3) {
    const place = x * corners[at] + y * corners[at + 1] + z * corners[at + 2] - origin;
    low = Math.min(low, place);
    high = Math.max(high, place);
  }
  return [low - MARGIN, high + MARGIN];
}
