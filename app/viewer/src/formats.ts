/** The formats that the service reads and writes: it says so in the page (app/http/pages.py). */

export interface MeshFormat {
  extension: string;
  /** What people call it. */
  label: string;
  /** A restriction, as it follows the label. */
  note: string;
  /** The axis that by convention points upwards. */
  up: "y" | "z";
}

interface Formats {
  read: MeshFormat[];
  /** Of completed meshes, by extension. */
  written: string[];
}

export function formats(): Formats {
  const stated = document.querySelector<HTMLMetaElement>('meta[name="formats"]');
  if (!stated) throw new Error("The page does not say its formats.");
  return JSON.parse(stated.content) as Formats;
}
