/** The two colour scales. Both pass from blue to warm, which all kinds of colour vision tell apart. */

type Rgb = [number, number, number];

/** For errors: of like lightness throughout, so that it reads on light and dark ground. */
const ERROR_STOPS: Rgb[] = [
  [37, 120, 214],
  [125, 100, 212],
  [205, 82, 150],
  [232, 124, 48],
];

/** For distances on the surface: pale where the surface comes to lie on itself, ever stronger where it does not. */
const HEAT_STOPS: Rgb[] = [
  [58, 104, 178],
  [96, 176, 196],
  [246, 232, 150],
  [240, 138, 60],
  [186, 32, 54],
];

/** Errors up to this one get the first colour: far below what modelling precision leaves. */
export const LEAST_ERROR = 1e-8;

/** Where an error stands between nothing and the largest one allowed, on a logarithmic scale: 0 to 1. */
export function errorShare(error: number, maxError: number): number {
  const share = Math.log(Math.max(error, LEAST_ERROR) / LEAST_ERROR) / Math.log(maxError / LEAST_ERROR);
  return Math.min(1, Math.max(0, Number.isFinite(share) ? share : 1));
}

/** The colour of an error as `#rrggbb`. */
export const errorColor = (error: number, maxError: number): string =>
  css(at(ERROR_STOPS, errorShare(error, maxError)));

/** The colour of a distance, as a share of the largest on the scale: components from 0 to 1, sRGB. */
export const heatColor = (share: number): Rgb => at(HEAT_STOPS, share).map((value) => value / 255) as Rgb;

export const errorGradient = (): string => gradient(ERROR_STOPS);
export const heatGradient = (): string => gradient(HEAT_STOPS);

function at(stops: Rgb[], share: number): Rgb {
  const place = Math.min(1, Math.max(0, share)) * (stops.length - 1);
  const index = Math.min(stops.length - 2, Math.floor(place));
  const t = place - index;
  return [0, 1, 2].map((k) => (1 - t) * stops[index][k] + t * stops[index + 1][k]) as Rgb;
}

const css = (color: Rgb): string =>
  `#${color.map((value) => Math.round(value).toString(16).padStart(2, "0")).join("")}`;
const gradient = (stops: Rgb[]): string => `linear-gradient(to right, ${stops.map(css).join(", ")})`;
