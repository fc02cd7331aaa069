/** The page's side of the worker that measures distances for the heat map. */

import type { Answer, Request } from "./worker";
import type { Lattice } from "./subdivide";

declare const WORKER_FILE: string;

export interface Heat {
  lattice: Lattice;
  /** One a vertex of the lattice, unit frame. */
  distances: Float32Array;
  largest: number;
}

export class HeatMeter {
  private worker: Worker | null = null;
  private lattice: Lattice | null = null;
  private job = 0;
  private waiting: { resolve: (heat: Heat) => void; progress: (done: number) => void } | null = null;

  /** The surface to measure from now on; what was under way is forgotten. */
  load(corners: Float32Array, normals: Float32Array): void {
    this.worker?.terminate();
    this.waiting = this.lattice = null;
    this.worker = new Worker(new URL(WORKER_FILE, import.meta.url), { type: "module" });
    this.worker.onmessage = (event: MessageEvent<Answer>) => this.receive(event.data);
    this.send({ kind: "mesh", corners: new Float32Array(corners), normals: new Float32Array(normals) });
  }

  /** Distances of the surface under a transform to the surface; never answers if another call comes first. */
  measure(transform: number[], progress: (done: number) => void): Promise<Heat> {
    this.job++;
    return new Promise((resolve) => {
      this.waiting = { resolve, progress };
      this.send({ kind: "measure", job: this.job, transform });
    });
  }

  private send(request: Request): void {
    const transfer = request.kind === "mesh" ? [request.corners.buffer, request.normals.buffer] : [];
    this.worker?.postMessage(request, transfer);
  }

  private receive(answer: Answer): void {
    if (answer.kind === "lattice") {
      this.lattice = answer.lattice;
    } else if (answer.job === this.job && this.waiting && this.lattice) {
      if (answer.kind === "progress") this.waiting.progress(answer.done);
      else
        this.waiting.resolve({ lattice: this.lattice, distances: answer.distances, largest: answer.largest });
    }
  }
}
