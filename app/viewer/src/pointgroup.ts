/** Point groups (Schoenflies symbols in ASCII) in words. */

export interface GroupWords {
  /** Letter and index, to be set as C with a small 2v. */
  letter: string;
  index: string;
  text: string;
  /** How many operations it has, counting the identity; Infinity for the round ones. */
  operations: number;
}

const SPECIAL: Record<string, [string, number]> = {
  C1: ["No symmetry: nothing but leaving it as it is maps the shape onto itself.", 1],
  Cs: ["One mirror plane and nothing else, like a chair.", 2],
  Ci: ["A centre of inversion and nothing else: every point has its opposite through the centre.", 2],
  T: ["The turns of a tetrahedron, no mirror planes: four 3-fold and three 2-fold axes.", 12],
  Td: ["A tetrahedron: four 3-fold axes, three 2-fold axes and six mirror planes.", 24],
  Th: ["Four 3-fold and three 2-fold axes, and three mirror planes, like the seams of a volleyball.", 24],
  O: ["The turns of a cube, no mirror planes: three 4-fold, four 3-fold and six 2-fold axes.", 24],
  Oh: ["A cube: three 4-fold, four 3-fold and six 2-fold axes, and nine mirror planes.", 48],
  I: ["The turns of an icosahedron, no mirror planes: six 5-fold, ten 3-fold and fifteen 2-fold axes.", 60],
  Ih: ["An icosahedron: six 5-fold, ten 3-fold and fifteen 2-fold axes, and fifteen mirror planes.", 120],
  Cinf: ["Every turn about one axis, but no mirror plane.", Infinity],
  Cinfv: ["A surface of revolution: every turn about one axis, and every plane through it.", Infinity],
  Cinfh: ["Every turn about one axis and the plane across it, but none through it.", Infinity],
  Dinf: ["Every turn about one axis and half turns about every axis across it.", Infinity],
  Dinfh: [
    "Like a cylinder: every turn about one axis, every plane through it, and the plane across it.",
    Infinity,
  ],
  Kh: ["A sphere: every axis and every plane through the centre.", Infinity],
};

/** What a symbol means; for one that is not known, only that. */
export function describeGroup(symbol: string): GroupWords {
  const words = { letter: symbol.slice(0, 1), index: symbol.slice(1).replace("inf", "∞") };
  const special = SPECIAL[symbol];
  if (special) return { ...words, text: special[0], operations: special[1] };
  const match = /^([CDS])(\d+)([vhd]?)$/.exec(symbol);
  const order = Number(match?.[2]);
  const family = match ? cyclic(match[1] + match[3], order) : null;
  return { ...words, text: family?.[0] ?? `The point group ${symbol}.`, operations: family?.[1] ?? NaN };
}

const NUMBERS = "no one two three four five six seven eight nine ten eleven twelve".split(" ");

function cyclic(family: string, n: number): [string, number] | null {
  const axis = `one ${n}-fold axis (turns by ${degrees(n)})`;
  const Axis = axis.replace("one", "One");
  const many = n < NUMBERS.length ? NUMBERS[n] : String(n);
  switch (family) {
    case "C":
      return [`${Axis} and no mirror plane, like a propeller.`, n];
    case "Cv":
      return [`${Axis} and ${many} mirror planes through it, like a pyramid.`, 2 * n];
    case "Ch":
      return [`${Axis} and one mirror plane across it.`, 2 * n];
    case "D":
      return [`${Axis} and ${many} 2-fold axes across it, no mirror plane, like a twisted prism.`, 2 * n];
    case "Dh":
      return [
        `Like a prism: ${axis}, ${many} 2-fold axes across it, ${many} mirror planes through it and one across it.`,
        4 * n,
      ];
    case "Dd":
      return [
        `Like an antiprism: ${axis}, ${many} 2-fold axes across it, and ${many} mirror planes through it, between them.`,
        4 * n,
      ];
    case "S":
      return [`Turning by ${degrees(n)} and mirroring across the axis at the same time; neither alone.`, n];
    default:
      return null;
  }
}

const degrees = (n: number): string => `${Number((360 / n).toFixed(2))}°`;
