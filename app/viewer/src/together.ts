/** Files that belong together: a mesh, and what it keeps in other files. They are sent in one upload. */

import { formats } from "./formats";

const COMPANIONS = ["bin", "mtl", "png", "jpg", "jpeg", "webp"];

/** Read by the service for the one mesh that is in it. */
const ARCHIVE = "zip";

const beside = new WeakMap<File, File[]>();

/** What a file picker offers. */
export const accepted = (): string => [...meshes(), ARCHIVE, ...COMPANIONS].map((name) => `.${name}`).join(",");

const meshes = (): string[] => formats().read.map((format) => format.extension);

const extension = (file: File): string => file.name.split(".").pop()?.toLowerCase() ?? "";

/** The first mesh among files that were chosen, with those beside it that are no meshes; or the first file. */
export function together(files: Iterable<File>): File | undefined {
  const all = [...files];
  const known = meshes();
  const mesh = all.find((file) => [...known, ARCHIVE].includes(extension(file))) ?? all[0];
  if (mesh) {
    beside.set(
      mesh,
      all.filter((file) => COMPANIONS.includes(extension(file)) && file !== mesh),
    );
  }
  return mesh;
}

/** A mesh and the files that came with it. */
export const withCompanions = (mesh: File): File[] => [mesh, ...(beside.get(mesh) ?? [])];
