/** How planes and axes lie to the main axis: across it, through it, diagonal. */

import type { Item } from "./items";
import { dot } from "./vector";

/** Two directions are parallel, or at right angles, up to this. */
const NEARLY = 1e-3;

/** The axis of the highest order, continuous ones before all. */
export function mainAxis(items: Item[]): Item | null {
  const axes = items.filter((item) => item.kind === "axis");
  const height = (axis: Item): number => (axis.continuous ? Infinity : (axis.order ?? 0));
  return axes.reduce<Item | null>((best, axis) => (best && height(best) >= height(axis) ? best : axis), null);
}

/** The kind of a plane or axis in words; axes of other orders than 2 are told apart by it. */
export function kindOf(item: Item, main: Item | null): string {
  const order = item.kind === "axis" ? (item.order ? `${item.order}-fold, ` : "every angle, ") : "";
  if (!main) return item.kind === "plane" ? "Planes" : "Axes";
  const cosine = Math.abs(dot(item.direction, main.direction));
  if (item.kind === "plane") {
    if (cosine > 1 - NEARLY) return "Across the main axis";
    return cosine < NEARLY ? "Through the main axis" : "Diagonal";
  }
  if (cosine > 1 - NEARLY) return `${order}main axis`;
  return cosine < NEARLY ? `${order}across the main axis` : `${order}diagonal`;
}
