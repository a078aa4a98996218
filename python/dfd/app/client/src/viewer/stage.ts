/** Renderer, camera and orbit controls; the scene is drawn only after changes. */

import { PerspectiveCamera, Scene as ThreeScene, Vector3, WebGLRenderer, WebGLRenderTarget } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { ViewHelper } from "three/addons/helpers/ViewHelper.js";

import type { Vec3 } from "../posing/affine";
import type { View } from "../store/state";

export const FIELD_OF_VIEW = 38;
/** At this field of view, all rays of the picture are parallel up to less than a pixel: the view is orthographic. */
const NARROW_FIELD = 0.1;

/** Pixels from the compass to the right and lower edges of the view. The legend is below it. */
const COMPASS = { right: 0, bottom: 32 };

/** Directions from the shape to the camera. `top` and `bottom` are tilted, so that the camera has an up direction. */
export const VIEWS: Record<View, Vec3> = {
  usual: [0.555, 0.296, 0.777],
  front: [0, 0, 1],
  back: [0, 0, -1],
  right: [1, 0, 0],
  left: [-1, 0, 0],
  top: [0, 1, 1e-4],
  bottom: [0, -1, 1e-4],
};

export class Stage {
  readonly renderer: WebGLRenderer;
  readonly scene = new ThreeScene();
  readonly camera = new PerspectiveCamera(FIELD_OF_VIEW, 1, 0.01, 100);
  readonly orbit: OrbitControls;
  /** The axes in a corner of the view. */
  readonly compass: ViewHelper;
  /** Called before every picture, to pose the shape. */
  draws: () => void = () => undefined;
  /** Called after every picture, for elements over the canvas. */
  drawn: () => void = () => undefined;
  width = 1;
  height = 1;
  private pending = 0;
  /** The radius of the shape. */
  private radius = 1;

  constructor(readonly canvas: HTMLCanvasElement) {
    const antialias = !drawsInSoftware();
    // By default, three.js creates a transparent canvas, which browsers blend with the page.
    const context = canvas.getContext("webgl2", { alpha: false, antialias, powerPreference: "high-performance" });
    if (!context) throw new Error("The browser does not support WebGL 2.");
    this.renderer = new WebGLRenderer({ canvas, context, antialias });
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.addEventListener("change", () => this.invalidate());
    this.orbit.zoomToCursor = true;
    this.compass = new ViewHelper(this.camera, canvas);
    this.compass.setLabels("X", "Y", "Z");
    Object.assign(this.compass.location, COMPASS);
    canvas.addEventListener("webglcontextrestored", () => this.invalidate());
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
    this.resize();
  }

  /** Draw the picture before the next frame of the screen. */
  invalidate(): void {
    this.pending ||= requestAnimationFrame(() => this.draw());
  }

  /** Return whether the canvas shows the present state. */
  get rests(): boolean {
    return this.pending === 0;
  }

  /** Draw the picture now. */
  draw(): void {
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    this.clip();
    this.draws();
    this.renderer.render(this.scene, this.camera);
    this.renderer.autoClear = false;
    this.compass.render(this.renderer);
    this.renderer.autoClear = true;
    this.drawn();
  }

  /** Look along the axis of the compass that a press hits, and return whether it hits one. */
  pressCompass(event: PointerEvent): boolean {
    const { compass, orbit } = this;
    compass.center.copy(orbit.target);
    if (!compass.visible || !compass.handleClick(event)) return false;
    compass.update(1); // the turn ends within this second
    orbit.update();
    this.invalidate();
    return true;
  }

  /** Draw the picture with a transparent background, and return its pixels. */
  pixels(): ImageData {
    const { width, height } = this.canvas;
    const target = new WebGLRenderTarget(width, height, { samples: 4 });
    const { background } = this.scene;
    this.scene.background = null;
    this.renderer.setClearAlpha(0);
    this.renderer.setRenderTarget(target);
    this.renderer.clear();
    this.renderer.render(this.scene, this.camera);
    const bytes = new Uint8ClampedArray(4 * width * height);
    this.renderer.readRenderTargetPixels(target, 0, 0, width, height, bytes);
    this.renderer.setRenderTarget(null);
    this.renderer.setClearAlpha(1);
    this.scene.background = background;
    target.dispose();
    // The first row that WebGL reads is the lowest.
    const picture = new ImageData(width, height);
    for (let row = 0; row < height; row++) {
      picture.data.set(bytes.subarray(4 * width * row, 4 * width * (row + 1)), 4 * width * (height - 1 - row));
    }
    return picture;
  }

  /** Look at a shape at the origin with the given radius, from the view `usual`. */
  frameShape(radius: number): void {
    this.radius = radius;
    this.limit();
    this.frame([0, 0, 0], radius, VIEWS.usual);
  }

  /** Show a whole sphere, seen from a given direction or from the present direction. */
  frame(center: Vec3, radius: number, from?: Vec3): void {
    const half = (this.camera.fov * Math.PI) / 360;
    const narrow = Math.atan(Math.tan(half) * Math.min(this.camera.aspect, 1));
    const distance = (1.02 * radius) / Math.sin(narrow);
    this.placeCamera(from ? new Vector3(...from) : this.direction, distance, new Vector3(...center));
  }

  /** Switch between an orthographic and a perspective view of the same size at the target. */
  setOrthographic(on: boolean): void {
    const before = this.slopeOfPixel;
    this.camera.fov = on ? NARROW_FIELD : FIELD_OF_VIEW;
    this.limit();
    this.placeCamera(this.direction, (this.direction.length() * before) / this.slopeOfPixel, this.orbit.target);
  }

  /** Limit the distance of the camera, so that the shape stays visible. */
  private limit(): void {
    const stretch = Math.tan((FIELD_OF_VIEW * Math.PI) / 360) / Math.tan((this.camera.fov * Math.PI) / 360);
    this.orbit.minDistance = (stretch * this.radius) / 20;
    this.orbit.maxDistance = stretch * this.radius * 20;
  }

  /** The length that a pixel shows, divided by the distance from the camera. */
  get slopeOfPixel(): number {
    return (2 * Math.tan((this.camera.fov * Math.PI) / 360)) / this.height;
  }

  /** Look at the same point from another direction. */
  lookFrom(from: Vec3): void {
    this.placeCamera(new Vector3(...from), this.direction.length(), this.orbit.target);
  }

  /** The direction from the target to the camera. */
  private get direction(): Vector3 {
    return this.camera.position.clone().sub(this.orbit.target);
  }

  private placeCamera(from: Vector3, distance: number, target: Vector3): void {
    this.orbit.target.copy(target);
    this.camera.position.copy(from).setLength(distance).add(target);
    this.clip();
    this.orbit.update();
    this.invalidate();
  }

  /** Set the distances between which the camera sees, so that they contain the shape. */
  private clip(): void {
    const away = this.camera.position.length();
    this.camera.near = Math.max(away - 30 * this.radius, this.radius / 100);
    this.camera.far = away + 30 * this.radius;
    this.camera.updateProjectionMatrix();
  }

  /** Project a point to pixels from the top left of the view; null if it is behind the camera. */
  project(point: Vec3): readonly [number, number] | null {
    const at = new Vector3(...point).project(this.camera);
    if (at.z > 1) return null;
    return [((at.x + 1) / 2) * this.width, ((1 - at.y) / 2) * this.height];
  }

  /** Return the point at pixel (x, y) that is as far from the camera's plane as `point`. */
  beside(point: Vec3, x: number, y: number): Vec3 {
    const { z } = new Vector3(...point).project(this.camera);
    return new Vector3((2 * x) / this.width - 1, 1 - (2 * y) / this.height, z).unproject(this.camera).toArray();
  }

  private resize(): void {
    const box = (this.canvas.parentElement ?? this.canvas).getBoundingClientRect();
    this.width = Math.max(Math.round(box.width), 1);
    this.height = Math.max(Math.round(box.height), 1);
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(this.width, this.height, false);
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
    // Draw at once, because a resized canvas is empty.
    this.draw();
  }
}

/** Return whether the renderer runs on the CPU, where antialiasing is too slow. */
function drawsInSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  const names = context?.getExtension("WEBGL_debug_renderer_info");
  const name = context && names ? String(context.getParameter(names.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
}
