/** The picture: renderer, camera and orbit; it draws only when something changed. */

import { PerspectiveCamera, Scene as ThreeScene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import type { Vec3 } from "../posing/affine";
import type { Level, View } from "../store/state";
import { Clock } from "./clock";
import { Pace, type Drawing } from "./pace";
import { Rest, type Easel, type Stop } from "./rest";
import { SHAPE_LAYER, Still, type Drawable } from "./still";

const FIELD_OF_VIEW = 38;

/** From the shape to the camera; straight from above, a camera would not know what is up. */
export const VIEWS: Record<View, Vec3> = {
  usual: [0.555, 0.296, 0.777],
  front: [0, 0, 1],
  back: [0, 0, -1],
  right: [1, 0, 0],
  left: [-1, 0, 0],
  top: [0, 1, 1e-4],
  bottom: [0, -1, 1e-4],
};

/** What is drawn whole or coarse. */
export interface Subject {
  readonly hasLevels: boolean;
  readonly whole: boolean;
  readonly opaque: boolean;
  readonly shown: Level;
  readonly revision: number;
  readonly drawable: Drawable;
  use(level: Level): void;
  update(): void;
}

export class Stage implements Easel {
  readonly renderer: WebGLRenderer;
  readonly scene = new ThreeScene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
  readonly orbit: OrbitControls;
  /** How finely frames are drawn. */
  readonly pace: Pace;
  /** What it shows, where there is something. */
  subject: () => Subject | null = () => null;
  /** Called with the level that is seen now, or that only a coarse one has come. */
  saw: (seen: Level | "loading") => void = () => undefined;
  /** Called after every picture, for what lies over the canvas. */
  drawn: () => void = () => undefined;
  private readonly rest: Rest;
  private readonly clock: Clock;
  /** Where a processor draws, the whole comes bit by bit. */
  private readonly still: Still | null;
  private halvings = 0;
  width = 1;
  height = 1;

  constructor(readonly canvas: HTMLCanvasElement) {
    // Where a processor draws, smooth edges cost more than all else together, and so do many pixels.
    const antialias = !drawsInSoftware();
    this.pace = new Pace(!antialias);
    this.rest = new Rest(this, this.pace);
    const gl = opaqueContext(canvas, antialias);
    this.renderer = new WebGLRenderer({ canvas, context: gl, antialias });
    this.clock = new Clock(gl);
    // It has no smooth edges.
    this.still = antialias ? null : new Still(this.renderer, this.scene, this.camera, this.clock);
    this.camera.layers.enable(SHAPE_LAYER);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.addEventListener("change", () => this.invalidate());
    this.orbit.addEventListener("start", () => this.hold(true));
    this.orbit.addEventListener("end", () => this.hold(false));
    this.orbit.zoomToCursor = true;
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.rest.renew());
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    this.resize();
  }

  /** Draw at the screen's next frame. */
  invalidate(): void {
    this.rest.ask();
  }

  /** Draw what has been asked for. */
  drawNext(): void {
    this.rest.frame();
  }

  /** Draw the whole now. */
  draw(): void {
    this.rest.drawWhole();
  }

  /** Whether nothing is left to be drawn. */
  get rests(): boolean {
    return this.rest.state === "whole";
  }

  /** Somebody takes hold of what moves, or lets go. */
  hold(on: boolean): void {
    this.rest.hold(on);
  }

  /** Look at a shape about the origin, of that radius, from the front and a little above. */
  frameShape(radius: number): void {
    this.camera.near = radius / 100;
    this.camera.far = radius * 60;
    this.orbit.minDistance = radius / 20;
    this.orbit.maxDistance = radius * 20;
    this.frame([0, 0, 0], radius, VIEWS.usual);
  }

  /** Show all of a sphere, from a direction or from where it is seen now. */
  frame(center: Vec3, radius: number, from?: Vec3): void {
    const half = (FIELD_OF_VIEW * Math.PI) / 360;
    const narrow = Math.atan(Math.tan(half) * Math.min(this.camera.aspect, 1));
    this.stand(
      from ? new Vector3(...from) : this.direction,
      (1.02 * radius) / Math.sin(narrow),
      new Vector3(...center),
    );
  }

  /** Look at the same point from another direction. */
  lookFrom(from: Vec3): void {
    this.stand(new Vector3(...from), this.direction.length(), this.orbit.target);
  }

  /** From what is looked at to the camera. */
  private get direction(): Vector3 {
    return this.camera.position.clone().sub(this.orbit.target);
  }

  private stand(from: Vector3, distance: number, target: Vector3): void {
    this.orbit.target.copy(target);
    this.camera.position.copy(from).setLength(distance).add(target);
    this.camera.updateProjectionMatrix();
    this.orbit.update();
    this.invalidate();
  }

  /** Where a point of the scene appears, in pixels of the page from the view's top left; null behind the eye. */
  project(point: Vec3): readonly [number, number] | null {
    const at = new Vector3(...point).project(this.camera);
    if (at.z > 1) return null;
    return [((at.x + 1) / 2) * this.width, ((1 - at.y) / 2) * this.height];
  }

  // --- what the picture at rest is made by

  key(): string | null {
    const subject = this.subject();
    if (!this.still || !subject?.hasLevels || !subject.opaque || this.pace.quality === "full") return null;
    const { matrixWorld, projectionMatrix } = this.camera;
    this.camera.updateMatrixWorld();
    return [subject.revision, this.width, this.height, ...matrixWorld.elements, ...projectionMatrix.elements].join();
  }

  get hasCoarse(): boolean {
    return this.subject()?.hasLevels ?? false;
  }

  get pixels(): number {
    return this.width * this.height;
  }

  now(): number {
    return performance.now();
  }

  atNextFrame(run: () => void): Stop {
    const frame = requestAnimationFrame(run);
    return () => cancelAnimationFrame(frame);
  }

  after(milliseconds: number, run: () => void): Stop {
    const timer = setTimeout(run, milliseconds);
    return () => clearTimeout(timer);
  }

  paint({ level, halvings }: Drawing): void {
    const begun = performance.now();
    this.sharpen(halvings);
    const subject = this.subject();
    subject?.use(level);
    subject?.update();
    this.renderer.render(this.scene, this.camera);
    this.finish(subject);
    if (level === "full" && halvings === 0 && subject?.shown === "full") this.measure(begun);
  }

  keep(): void {
    const subject = this.subject();
    if (!this.still || !subject) return;
    const begun = performance.now();
    this.sharpen(0);
    this.still.make(subject.drawable);
    this.measure(begun);
  }

  compose(composed: () => void): Stop {
    const subject = this.subject();
    if (!this.still || !subject) return () => undefined;
    this.sharpen(0);
    return this.still.compose(subject.drawable, (milliseconds) => {
      this.pace.measured(milliseconds);
      composed();
    });
  }

  showKept(): void {
    const subject = this.subject();
    this.sharpen(0);
    subject?.use("full");
    this.still?.show();
    this.finish(subject);
  }

  private measure(begun: number): void {
    this.clock.ask(begun, (milliseconds) => this.pace.measured(milliseconds));
  }

  private finish(subject: Subject | null): void {
    this.drawn();
    if (subject) this.saw(subject.whole ? subject.shown : "loading");
  }

  private sharpen(halvings: number): void {
    if (this.halvings === halvings) return;
    this.halvings = halvings;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2) / 2 ** (halvings / 2));
  }

  private resize(): void {
    const box = (this.canvas.parentElement ?? this.canvas).getBoundingClientRect();
    this.width = Math.max(Math.round(box.width), 1);
    this.height = Math.max(Math.round(box.height), 1);
    this.sharpen(0);
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(this.width, this.height, false);
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
    // At once: a resized canvas is empty until something is drawn.
    this.rest.frame(false);
  }
}

let software: boolean | null = null;

/** Whether a processor draws, not a graphics card: there every pixel that is painted anew counts. */
export function drawsInSoftware(): boolean {
  software ??= /swiftshader|llvmpipe|software|basic render/i.test(rendererName());
  return software;
}

function rendererName(): string {
  const context = document.createElement("canvas").getContext("webgl2");
  const names = context?.getExtension("WEBGL_debug_renderer_info");
  const name = context && names ? String(context.getParameter(names.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

/** A canvas that lets nothing shine through: three.js would ask for a clear one, which browsers blend over the page. */
function opaqueContext(canvas: HTMLCanvasElement, antialias: boolean): WebGL2RenderingContext {
  const gl = canvas.getContext("webgl2", { alpha: false, antialias, powerPreference: "high-performance" });
  if (!gl) throw new Error("There is no WebGL 2.");
  return gl;
}
