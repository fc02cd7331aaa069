/** The bundled examples (examples/README.md says where they are from). */

export interface Example {
  file: string;
  title: string;
  note: string;
}

export const EXAMPLES: Example[] = [
  { file: "chair.obj", title: "Chair", note: "one mirror plane" },
  { file: "vase.ply", title: "Vase", note: "eight planes, 8-fold axis" },
  { file: "propeller.stl", title: "Propeller", note: "turns, but no mirror" },
  { file: "nut.glb", title: "Hexagonal nut", note: "planes through and across" },
  { file: "star.ply", title: "Icosahedral star", note: "15 planes, 31 axes" },
  { file: "bottle.obj", title: "Bottle", note: "a surface of revolution" },
  { file: "plant.off", title: "Plant", note: "no symmetry at all" },
  { file: "broken.3mf", title: "Damaged table", note: "a part is missing" },
];

const fetched = new WeakSet<File>();

/** Whether a file is one of the examples, and can be linked to. */
export const isExample = (file: File | null): boolean => file !== null && fetched.has(file);

/** One example as a file, as if it had been dropped. */
export async function fetchExample(example: Example): Promise<File> {
  const response = await fetch(new URL(`static/viewer/examples/${example.file}`, document.baseURI));
  if (!response.ok) throw new Error(`The example is missing (${response.status}).`);
  const file = new File([await response.blob()], example.file);
  fetched.add(file);
  return file;
}
