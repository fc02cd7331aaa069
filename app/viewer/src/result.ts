/** What `POST /detect` answers (app/schemas.py). Everything is in the input frame. */

export type Vector = [number, number, number];
export type Row = [number, number, number, number];
export type Matrix = [Row, Row, Row, Row];
export type Mode = "full" | "paper";

interface Measured {
  symmetry_error: number;
  rms_distance: number;
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

export type Reason = "not_symmetric" | "duplicate" | "not_continuous" | "look_alike";

export type RejectedResult =
  | { kind: "plane"; normal: Vector; offset: number; symmetry_error: number; reason: Reason }
  | { kind: "axis"; direction: Vector; point: Vector; symmetry_error: number; reason: Reason };

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
  rejected?: RejectedResult[];
  bop?: unknown;
}

export interface Limits {
  max_upload_bytes: number;
  max_faces: number;
  formats: string[];
}
