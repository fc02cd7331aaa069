/** Canvas, camera and light. The scene is the unit frame: a ball of diameter 1 around the origin holds the mesh. */

import {
  DirectionalLight,
  HemisphereLight,
  OrthographicCamera,
  PerspectiveCamera,
  Raycaster,
  Scene,
  Spherical,
  Vector2,
  Vector3,
  WebGLRenderer,
  type Camera,
  type Object3D,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Up } from "./store";

const FIELD_OF_VIEW = 30;
/** From where the shape is first seen: degrees from the front to the right, degrees above the ground. */
const AZIMUTH = 32;
const ELEVATION = 20;
const [NEAREST, FARTHEST] = [0.3, 12];
/** Pixels that overlays take from the height of the canvas. */
const OVERLAYS = 100;
/** How far an arrow key turns. */
const STEP = Math.PI / 18;

/** Draws when something has changed, and then once. */
export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 50);
  /** Sees along parallel lines; the controls move the other camera, and this one follows it. */
  private readonly flat = new OrthographicCamera();
  private isFlat = false;
  private readonly renderer: WebGLRenderer;
  private controls: OrbitControls;
  private readonly raycaster = new Raycaster();
  private readonly afterFrame: (() => void)[] = [];
  private up: Up = "y";
  private asked = false;

  /** Throws where the browser has no WebGL. */
  constructor(readonly canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.renderer.localClippingEnabled = true;
    this.scene.add(new HemisphereLight(0xffffff, 0x8890a0, 1.7), this.camera);
    const key = new DirectionalLight(0xffffff, 2.0);
    key.position.set(-0.6, 0.9, 1.2);
    this.camera.add(key);
    this.scene.add(key.target);
    this.controls = this.newControls();
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    canvas.addEventListener("keydown", (event) => this.onKey(event));
    this.resize();
    this.home();
  }

  /** Draw again with the next frame. */
  render(): void {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => {
      this.asked = false;
      this.renderer.render(this.scene, this.eye());
      for (const task of this.afterFrame) task();
    });
  }

  /** Called after every frame, for what follows the camera. */
  onFrame(task: () => void): void {
    this.afterFrame.push(task);
  }

  /** Parallel lines stay parallel, and what is far is not smaller. */
  setFlat(flat: boolean): void {
    this.isFlat = flat;
    this.render();
  }

  /** Pixels from the upper left corner of the canvas at which a point of the scene is seen. */
  pixelOf(point: Vector3): [number, number] {
    const seen = point.clone().project(this.eye());
    return [((seen.x + 1) / 2) * this.canvas.clientWidth, ((1 - seen.y) / 2) * this.canvas.clientHeight];
  }

  /** The camera that is looked through. */
  private eye(): Camera {
    if (!this.isFlat) return this.camera;
    const { flat, camera } = this;
    const half = camera.position.distanceTo(this.controls.target) * Math.tan((FIELD_OF_VIEW * Math.PI) / 360);
    flat.top = half;
    flat.bottom = -half;
    flat.right = half * camera.aspect;
    flat.left = -flat.right;
    flat.near = -FARTHEST;
    flat.far = 2 * FARTHEST;
    flat.updateProjectionMatrix();
    flat.position.copy(camera.position);
    flat.quaternion.copy(camera.quaternion);
    flat.updateMatrixWorld();
    return flat;
  }

  /** Which of the file's axes points upwards on the screen; coordinates stay as they are. */
  setUp(up: Up): void {
    if (up === this.up) return;
    this.up = up;
    this.home();
  }

  /** Back to the first view. */
  home(): void {
    const [azimuth, elevation] = [(AZIMUTH * Math.PI) / 180, (ELEVATION * Math.PI) / 180];
    const [right, above, front] = [
      Math.sin(azimuth) * Math.cos(elevation),
      Math.sin(elevation),
      Math.cos(azimuth) * Math.cos(elevation),
    ];
    const direction = this.up === "y" ? new Vector3(right, above, front) : new Vector3(right, -front, above);
    this.camera.up.set(0, this.up === "y" ? 1 : 0, this.up === "y" ? 0 : 1);
    // Controls take the axis they turn about from the camera when they are made.
    this.controls.dispose();
    this.controls = this.newControls();
    this.camera.position.copy(direction.multiplyScalar(this.distance()));
    this.controls.update();
    this.render();
  }

  /** From a direction of the file's coordinates, such as along x. */
  lookFrom(axis: 0 | 1 | 2): void {
    const direction = new Vector3().setComponent(axis, 1);
    const above = this.up === "y" ? 1 : 2;
    // Not quite from above: there the controls do not know which way is up.
    if (axis === above) direction.setComponent(above === 1 ? 2 : 1, above === 1 ? 1e-3 : -1e-3).normalize();
    this.camera.position.copy(direction.multiplyScalar(this.camera.position.length()));
    this.controls.update();
    this.render();
  }

  /** What is to be seen, as PNG. */
  picture(): Promise<Blob> {
    this.renderer.render(this.scene, this.eye()); // a drawing buffer lasts only until the browser has shown it
    return new Promise((resolve, reject) =>
      this.canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The picture is empty.")))),
    );
  }

  private newControls(): OrbitControls {
    const controls = new OrbitControls(this.camera, this.canvas);
    controls.minDistance = NEAREST;
    controls.maxDistance = FARTHEST;
    controls.addEventListener("change", () => this.render());
    return controls;
  }

  /** Far enough for the ball to fit the narrower side of the canvas, with room for what lies over it. */
  private distance(): number {
    const half = (FIELD_OF_VIEW * Math.PI) / 360;
    const narrower = Math.min(half, Math.atan(Math.tan(half) * this.camera.aspect));
    const height = this.canvas.clientHeight || 1;
    return (0.56 / Math.sin(narrower)) * (height / Math.max(0.7 * height, height - OVERLAYS));
  }

  /** The first of some objects under a point of the page, or null. */
  pick(x: number, y: number, objects: Object3D[]): Object3D | null {
    const box = this.canvas.getBoundingClientRect();
    const point = new Vector2(((x - box.left) / box.width) * 2 - 1, 1 - ((y - box.top) / box.height) * 2);
    this.raycaster.setFromCamera(point, this.eye());
    return this.raycaster.intersectObjects(objects, false)[0]?.object ?? null;
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement ?? this.canvas;
    if (!width || !height) return;
    const before = this.distance();
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.camera.position.multiplyScalar(this.distance() / before);
    this.controls.update();
    this.render();
  }

  private onKey(event: KeyboardEvent): void {
    const steps: Record<string, [number, number, number]> = {
      ArrowLeft: [-STEP, 0, 1],
      ArrowRight: [STEP, 0, 1],
      ArrowUp: [0, -STEP, 1],
      ArrowDown: [0, STEP, 1],
      "+": [0, 0, 0.85],
      "=": [0, 0, 0.85],
      "-": [0, 0, 1 / 0.85],
    };
    const step = steps[event.key];
    if (step) this.turn(...step);
    else if (event.key === "0") this.home();
    else return;
    event.preventDefault();
  }

  private turn(sideways: number, upwards: number, zoom: number): void {
    const { position } = this.camera;
    const zUp = this.up === "z";
    const local = zUp ? new Vector3(position.x, position.z, -position.y) : position.clone();
    const place = new Spherical().setFromVector3(local);
    place.theta += sideways;
    place.phi += upwards;
    place.radius = Math.min(FARTHEST, Math.max(NEAREST, place.radius * zoom));
    local.setFromSpherical(place.makeSafe());
    position.copy(zUp ? new Vector3(local.x, -local.z, local.y) : local);
    this.controls.update();
    this.render();
  }
}
