/** What `POST /detect` answers (app/schemas.py). Everything is in the input frame. */

export type Vector = [number, number, number];
export type Row = [number, number, number, number];
export type Matrix = [Row, Row, Row, Row];
export type Mode = "full" | "paper";
export type LevelName = "auto" | "exact";

/** What it rests on: the surface, or the network where too little of the surface is there to tell. */
export type Evidence = "measured" | "predicted";

interface Measured {
  symmetry_error: number;
  rms_distance: number;
  /** Largest deviation seen, features included, input units. */
  max_distance: number;
  /** Share of the surface whose counterpart is there and fits. */
  coverage: number;
  /** Probability that it is a symmetry of the intact shape; null in paper mode. */
  confidence: number | null;
  evidence: Evidence;
  /** Never of what is predicted. */
  exact: boolean;
  continuous: boolean;
}

export interface PlaneResult extends Measured {
  normal: Vector;
  offset: number;
  point: Vector;
  matrix: Matrix;
}

export interface AxisResult extends Measured {
  direction: Vector;
  point: Vector;
  order: number | null;
  matrix: Matrix | null;
}

export type Reason = "not_symmetric" | "duplicate" | "not_continuous";

export type RejectedResult =
  | { kind: "plane"; normal: Vector; offset: number; symmetry_error: number; reason: Reason }
  | { kind: "axis"; direction: Vector; point: Vector; symmetry_error: number; reason: Reason };

/** Holds within the largest error, but belongs to no group. */
export type SimilarResult =
  | { kind: "plane"; normal: Vector; offset: number; symmetry_error: number }
  | { kind: "axis"; direction: Vector; point: Vector; symmetry_error: number };

/** A part of the surface that breaks a symmetry. */
export interface Patch {
  center: Vector;
  size: number;
  max_distance: number;
  /** Something stands there without a counterpart; else something is missing there. */
  present: boolean;
}

/** A group that holds at some tolerance; planes and axes of the answer are those of the chosen one. */
export interface Level {
  point_group: string;
  planes: number;
  axes: number;
  /** The tolerance it needs, input units. */
  rms_distance: number;
  next_rms_distance: number | null;
  missing: number;
  /** Null where it was not tested. */
  exact: boolean | null;
  chosen: boolean;
  /** Probability that it is a group of the intact shape. */
  confidence: number;
  evidence: Evidence;
  breaks: Patch[];
}

export interface DetectResult {
  planes: PlaneResult[];
  axes: AxisResult[];
  point_group: string;
  frame: { coordinates: "input"; units: string | null; center: Vector; scale: number };
  mesh: {
    filename: string;
    format: string | null;
    vertices: number;
    faces: number;
    bounds: [Vector, Vector];
    watertight: boolean;
  };
  model: { name: string; version: string; sha256: string };
  timings_ms: Record<string, number>;
  warnings: string[];
  /** Empty in paper mode. */
  levels?: Level[];
  similar?: SimilarResult[];
  rejected?: RejectedResult[];
  bop?: unknown;
}

export interface Limits {
  max_upload_bytes: number;
  max_faces: number;
  formats: string[];
}
