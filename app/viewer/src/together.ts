/** Files that belong together: a mesh, and what it keeps in other files. They are sent in one upload. */

import { formats } from "./formats";

/** Formats that keep something in other files. */
const REFERRING = ["gltf", "obj", "ply"];
const COMPANIONS = ["bin", "mtl", "png", "jpg", "jpeg", "webp"];

/** Read by the service for the one mesh that is in it. */
const ARCHIVE = "zip";

const beside = new WeakMap<File, File[]>();

/** What a file picker offers. */
export const accepted = (): string =>
  [...meshes(), ARCHIVE, ...COMPANIONS].map((name) => `.${name}`).join(",");

const meshes = (): string[] => formats().read.map((format) => format.extension);

const extension = (file: File): string => file.name.split(".").pop()?.toLowerCase() ?? "";

/** The meshes among files that were chosen, with those beside them that are no meshes; or the first file. */
export function together(files: Iterable<File>): File[] {
  const all = [...files];
  const known = [...meshes(), ARCHIVE];
  const found = all.filter((file) => known.includes(extension(file)));
  const companions = all.filter((file) => COMPANIONS.includes(extension(file)));
  for (const mesh of found) beside.set(mesh, REFERRING.includes(extension(mesh)) ? companions : []);
  return found.length > 0 ? found : all.slice(0, 1);
}

/** A mesh and the files that came with it. */
export const withCompanions = (mesh: File): File[] => [mesh, ...(beside.get(mesh) ?? [])];
