/** The mesh itself: as it is, half of it mirrored, or coloured by the distance to its image. */

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  EdgesGeometry,
  Group,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshStandardMaterial,
  Plane,
  RepeatWrapping,
  SRGBColorSpace,
  Texture,
  Vector3,
} from "three";
import { heatColor } from "./colors";
import type { Heat } from "./heat";
import type { Item } from "./items";
import type { Vector } from "./result";
import type { Surface } from "./store";
import { fullerSide } from "./section";
import { across } from "./vector";

/** Edges are drawn where faces meet at more than this angle, in degrees, ... */
const EDGE_ANGLE = 32;
/** ... unless there are so many faces that it would take long and show little. */
const MOST_FACES_FOR_EDGES = 60_000;

export interface MeshColors {
  surface: string;
  edges: string;
  original: string;
  image: string;
}

const material = (): MeshStandardMaterial =>
  new MeshStandardMaterial({
    roughness: 0.78,
    metalness: 0,
    side: DoubleSide,
    polygonOffset: true,
    polygonOffsetFactor: 1.5,
    polygonOffsetUnits: 1.5,
  });

/** The heat map's scale ends here at least, unit frame: what is exact shall look so. */
export const LEAST_HEAT = 0.01;

export class MeshView {
  readonly group = new Group();
  private readonly plain = material();
  private readonly image = material();
  private readonly hot = material();
  private readonly lines = new LineBasicMaterial({ transparent: true, opacity: 0.55 });
  private readonly mesh = new Mesh<BufferGeometry, MeshStandardMaterial | MeshStandardMaterial[]>(
    new BufferGeometry(),
    this.plain,
  );
  private pictured: MeshStandardMaterial[] = [];
  private readonly mirrored = new Mesh(this.mesh.geometry, this.image);
  private readonly heated = new Mesh(new BufferGeometry(), this.hot);
  private readonly edges = new LineSegments(new BufferGeometry(), this.lines);
  private colors: MeshColors | null = null;

  constructor() {
    this.hot.vertexColors = true;
    this.mirrored.matrixAutoUpdate = false;
    this.group.add(this.mesh, this.mirrored, this.heated, this.edges);
    this.showMesh();
  }

  /** Another mesh. */
  load(surface: Surface): void {
    for (const old of [this.mesh, this.heated, this.edges]) old.geometry.dispose();
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(surface.corners, 3));
    geometry.setAttribute("normal", new BufferAttribute(surface.normals, 3));
    if (surface.colors) geometry.setAttribute("color", new BufferAttribute(surface.colors, 3));
    this.plain.vertexColors = surface.colors !== null;
    this.plain.needsUpdate = true;
    this.mesh.geometry = this.mirrored.geometry = geometry;
    this.layPictures(surface, geometry);
    const few = surface.corners.length / 9 <= MOST_FACES_FOR_EDGES;
    this.edges.geometry = few ? new EdgesGeometry(geometry, EDGE_ANGLE) : new BufferGeometry();
    this.heated.geometry = new BufferGeometry();
    this.showMesh();
  }

  /** Pictures on the mesh as it is; its image keeps the plain colour, which tells the two apart. */
  private layPictures({ places, pictures, corners, colors }: Surface, geometry: BufferGeometry): void {
    for (const old of this.pictured) {
      old.map?.dispose();
      old.dispose();
    }
    this.pictured = [];
    this.mesh.material = this.plain;
    if (!places || pictures.length === 0) return;
    geometry.setAttribute("uv", new BufferAttribute(places, 2));
    let at = 0;
    const plainUntil = (start: number): void => {
      if (start > at) geometry.addGroup(at, start - at, 0);
    };
    for (const { image, start, count } of pictures) {
      plainUntil(start);
      const map = new Texture(image);
      map.colorSpace = SRGBColorSpace;
      map.wrapS = map.wrapT = RepeatWrapping;
      map.flipY = false;
      map.needsUpdate = true;
      const own = material();
      own.map = map;
      own.vertexColors = colors !== null;
      own.wireframe = this.plain.wireframe;
      geometry.addGroup(start, count, this.pictured.push(own));
      at = start + count;
    }
    plainUntil(corners.length / 3);
    this.mesh.material = [this.plain, ...this.pictured];
  }

  /** Triangles as lines, or filled. */
  setWire(wire: boolean): void {
    for (const each of [this.plain, this.image, this.hot, ...this.pictured]) each.wireframe = wire;
  }

  setColors(colors: MeshColors): void {
    this.colors = colors;
    this.tint(colors.surface);
    this.image.color.set(colors.image);
    this.lines.color.set(colors.edges);
  }

  showMesh(): void {
    this.arrange(true, false, false);
    this.clip(null);
    if (this.colors) this.tint(this.colors.surface);
  }

  /** The half with more surface as it is, and beside it its image; for an axis, the half beyond it is the shape turned. */
  showMirror(item: Item): void {
    this.arrange(true, true, false);
    const normal = item.kind === "plane" ? item.direction : across(item.direction, [0, 1, 0])[0];
    const side = fullerSide(this.mesh.geometry.getAttribute("position").array, normal, item.point);
    this.clip([halfSpace(normal, item.point, side)]);
    this.image.clippingPlanes = [halfSpace(normal, item.point, side === 1 ? -1 : 1)];
    this.mirrored.matrix.copy(matrixOf(item.transform));
    this.mirrored.matrixWorldNeedsUpdate = true;
    if (this.colors) this.tint(this.colors.original);
  }

  /** Colours by distance; `largest` ends the scale. */
  showHeat(heat: Heat, largest: number): void {
    this.arrange(false, false, true);
    this.lines.clippingPlanes = null;
    const { positions, normals, indices } = heat.lattice;
    const geometry = this.heated.geometry;
    if (geometry.getAttribute("position")?.array !== positions) {
      geometry.setAttribute("position", new BufferAttribute(positions, 3));
      geometry.setAttribute("normal", new BufferAttribute(normals, 3));
      geometry.setIndex(new BufferAttribute(indices, 1));
    }
    geometry.setAttribute("color", new BufferAttribute(colorsOf(heat.distances, largest), 3));
  }

  private clip(planes: Plane[] | null): void {
    for (const each of [this.plain, this.lines, ...this.pictured]) each.clippingPlanes = planes;
  }

  /** A mesh with colours of its own keeps them. */
  private tint(color: string): void {
    this.plain.color.set(this.plain.vertexColors ? "#ffffff" : color);
  }

  private arrange(mesh: boolean, mirrored: boolean, heated: boolean): void {
    this.mesh.visible = mesh;
    this.mirrored.visible = mirrored;
    this.heated.visible = heated;
    this.edges.visible = !heated;
  }
}

function halfSpace(normal: Vector, point: Vector, side: 1 | -1): Plane {
  return new Plane().setFromNormalAndCoplanarPoint(
    new Vector3(...normal).multiplyScalar(side),
    new Vector3(...point),
  );
}

function matrixOf(transform: number[]): Matrix4 {
  return new Matrix4().set(...(transform.concat([0, 0, 0, 1]) as Parameters<Matrix4["set"]>));
}

function colorsOf(distances: Float32Array, largest: number): Float32Array {
  const table = Array.from({ length: 256 }, (_, i) => {
    const [red, green, blue] = heatColor(i / 255);
    return new Color().setRGB(red, green, blue, SRGBColorSpace).toArray() as Vector;
  });
  const colors = new Float32Array(3 * distances.length);
  distances.forEach((distance, i) => {
    colors.set(table[Math.min(255, Math.round((255 * distance) / largest))], 3 * i);
  });
  return colors;
}
