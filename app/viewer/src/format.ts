/** Numbers and names as people read them. */

/** Short, with an exponent where that is shorter: 0.00012 becomes 1.2e-4. */
export function short(value: number, digits = 2): string {
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e-3 && size < 1e5)
    return String(Number(value.toPrecision(Math.max(digits, size >= 100 ? 3 : digits))));
  return value
    .toExponential(digits - 1)
    .replace(/\.?0+e/, "e")
    .replace("e+", "e");
}

/** A coordinate: enough digits to tell it, no noise below what a float32 file can hold. */
export function coordinate(value: number, scale: number): string {
  return Math.abs(value) < 1e-7 * scale ? "0" : String(Number(value.toPrecision(6)));
}

export const vector = (values: readonly number[], scale = 1): string =>
  `(${values.map((value) => coordinate(value, scale)).join(", ")})`;

export const count = (value: number): string => value.toLocaleString("en");

export function bytes(size: number): string {
  if (size < 1e3) return `${size} bytes`;
  return size < 1e6 ? `${(size / 1e3).toFixed(0)} kB` : `${(size / 1e6).toFixed(1)} MB`;
}

export function milliseconds(value: number): string {
  return value < 1000 ? `${value.toFixed(value < 10 ? 1 : 0)} ms` : `${(value / 1000).toFixed(1)} s`;
}

export const plural = (number: number, one: string, many = `${one}s`): string =>
  `${count(number)} ${number === 1 ? one : many}`;

/** A word quoted for a POSIX shell where it needs to be. */
export const shellWord = (word: string): string =>
  /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", `'\\''`)}'`;

const UNITS: Record<string, string> = {
  micron: "µm",
  millimeter: "mm",
  centimeter: "cm",
  inch: "in",
  foot: "ft",
  meter: "m",
};

/** The sign of a unit of length, or nothing where the file states none. */
export const unitSign = (unit: string | null): string => (unit === null ? "" : (UNITS[unit] ?? unit));
