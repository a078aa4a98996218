/** Draw the shape, the gizmo and the marks of the store's state. */

import * as THREE from "three";

import { savePicture } from "../actions/files";
import { problem } from "../actions/toasts";
import { subtract } from "../posing/affine";
import { weightOf } from "../posing/columns";
import { draws, isolates, store, type Picked, type Posed, type State } from "../store/state";
import { touch } from "./overlays/brush";
import { Gizmo } from "./overlays/gizmo";
import { drawMarks, marksOf, ringMarks } from "./overlays/marks";
import { Picker } from "./picker";
import { mirrorOf, sceneOf } from "./scene";
import { Shape } from "./shape";
import { Stage, VIEWS } from "./stage";

export class Viewer {
  readonly stage: Stage;
  shape: Shape | null = null;
  private picker: Picker | null = null;
  readonly gizmo: Gizmo;
  private marks: ReturnType<typeof marksOf> = [];
  private readonly plane = new THREE.LineSegments(
    new THREE.EdgesGeometry(new THREE.PlaneGeometry(2, 2)),
    new THREE.LineBasicMaterial(),
  );

  constructor(
    canvas: HTMLCanvasElement,
    overlay: HTMLElement,
    private readonly box: HTMLElement,
  ) {
    this.stage = new Stage(canvas);
    this.stage.draws = () => {
      this.shape?.posed.update();
      this.shape?.fadeWires(this.stage.slopeOfPixel);
    };
    this.stage.drawn = () => {
      drawMarks(overlay, [...ringMarks(this.gizmo), ...this.marks], (point) => this.stage.project(point));
      // The browser shows the picture after this frame.
      if (this.shape && !store.get().drawn) requestAnimationFrame(() => setTimeout(() => store.set({ drawn: true })));
    };
    this.gizmo = new Gizmo(this.stage);
    this.stage.scene.add(this.plane, this.gizmo.proxy, this.gizmo.helper);
    this.follow(overlay);
  }

  /** Save a picture of the shape alone, without colors of weights; on request, with a transparent background. */
  screenshot(transparent = false): void {
    const { stage } = this;
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [stage.canvas.width, stage.canvas.height];
    this.bare(() => {
      const context = canvas.getContext("2d");
      if (transparent) context?.putImageData(stage.pixels(), 0, 0);
      else context?.drawImage(stage.canvas, 0, 0);
    });
    canvas.toBlob((blob) => {
      if (blob) savePicture(blob);
      else problem("The browser could not make a picture of this size.");
    });
  }

  /** Return a small picture of the shape as a data: URL; with `posed`, of this pose around the selected handle. */
  thumbnail(posed?: Posed): string {
    const { stage, shape } = this;
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [240, 180];
    const scale = stage.canvas.height / stage.height;
    // With a pose, the middle of the picture is between that of the shape, which is the origin, and the handle.
    const middle = this.gizmo.proxy.position.clone().multiplyScalar(posed ? 0.7 : 0);
    const [x, y] = stage.project(middle.toArray()) ?? [0, 0];
    const radius = (shape?.radius ?? 1) / (stage.camera.position.distanceTo(stage.orbit.target) * stage.slopeOfPixel);
    // The part of the canvas that the picture shows, which is inside the canvas.
    const high = Math.min((posed ? 1.1 : 2.4) * radius * scale, stage.canvas.height, 0.75 * stage.canvas.width);
    const [width, height] = [(4 / 3) * high, high];
    const left = THREE.MathUtils.clamp(x * scale - width / 2, 0, stage.canvas.width - width);
    const top = THREE.MathUtils.clamp(y * scale - height / 2, 0, stage.canvas.height - height);
    if (posed) shape?.posed.setGiven(posed);
    this.bare(() => canvas.getContext("2d")?.drawImage(stage.canvas, left, top, width, height, 0, 0, 240, 180));
    if (posed) shape?.posed.setGiven(store.get().posed);
    return canvas.toDataURL("image/jpeg", 0.8);
  }

  /** Draw the shape alone, call `read`, and draw everything again. */
  private bare(read: () => void): void {
    const { stage, shape } = this;
    const helpers = [this.plane, this.gizmo.helper, stage.compass].filter(({ visible }) => visible);
    helpers.forEach((helper) => (helper.visible = false));
    shape?.hideHeat(true);
    stage.draw();
    read();
    shape?.hideHeat(false);
    helpers.forEach((helper) => (helper.visible = true));
    stage.invalidate();
  }

  pick(x: number, y: number): Picked | null {
    const { camera, width, height } = this.stage;
    return this.picker?.pick(camera, x, y, width, height) ?? null;
  }

  /** Return the index of the mark whose target is drawn at a pixel, and the pixel of the target. */
  markAt(x: number, y: number): { readonly index: number; readonly at: readonly [number, number] } | null {
    const { edit, mesh, tool } = store.get();
    const found = (tool === "marks" && mesh ? (edit?.marks ?? []) : []).flatMap(({ target }, index) => {
      const at = target && mesh && this.stage.project(subtract(target, mesh.center));
      return at && Math.hypot(at[0] - x, at[1] - y) <= GRIP ? [{ index, at }] : [];
    });
    return found.at(-1) ?? null;
  }

  private follow(overlay: HTMLElement): void {
    const { stage } = this;
    store.on("meshArrays", () => {
      this.load();
      if (this.shape) stage.frameShape(this.shape.radius);
    });
    store.on("featureColors", (colors) => {
      if (colors) this.shape?.setFeatureColors(colors);
      stage.invalidate();
    });
    store.on("posed", (posed) => {
      this.shape?.posed.setGiven(posed);
      this.mark();
      stage.invalidate();
    });
    store.watch(
      (state) => POSED_BY.map((key) => state[key]),
      () => this.poseSoon(),
    );
    // The mark under the pointer is an element over the canvas, so the canvas need not be drawn again.
    store.on("hover", () => this.mark());
    store.watch(
      ({ look, wireframe, comparing, edit, xray, ...state }) => {
        return [look, wireframe, comparing, edit?.symmetry, xray, state.weights, isolates(state)];
      },
      () => this.dress(),
    );
    store.on("orthographic", (on) => stage.setOrthographic(on));
    store.on("narrow", (narrow) => (stage.compass.visible = !narrow));
    stage.compass.visible = !store.get().narrow;
    store.on("dragging", (dragging) => (stage.orbit.enabled = !dragging));
    store.on("tool", (tool) => {
      stage.orbit.mouseButtons.LEFT = draws(tool) ? null : THREE.MOUSE.ROTATE;
      overlay.classList.toggle("through", draws(tool) || tool === "marks");
    });
    store.on("framed", (wish) => {
      if (!wish || !this.shape) return;
      if (wish.what === "shape") stage.frameShape(this.shape.radius);
      else if (wish.what === "selection") this.frameSelection(this.shape);
      else stage.lookFrom(VIEWS[wish.what]);
    });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.dress());
    // All objects of a lost graphics context are lost, so the shape is loaded again.
    stage.canvas.addEventListener("webglcontextlost", () => this.unload());
    stage.canvas.addEventListener("webglcontextrestored", () => this.load());
  }

  private unload(): void {
    this.picker?.dispose();
    this.shape?.dispose();
    this.picker = this.shape = null;
  }

  private load(): void {
    const { mesh, meshArrays, featureColors, posed } = store.get();
    this.unload();
    if (mesh && meshArrays) {
      this.shape = new Shape(mesh, meshArrays, this.stage.renderer, () => this.stage.invalidate());
      this.picker = new Picker(this.stage.renderer, this.shape);
      this.stage.scene.add(this.shape.group);
      if (featureColors) this.shape.setFeatureColors(featureColors);
      this.shape.posed.setGiven(posed);
    }
    this.dress();
    this.pose();
  }

  /** Apply the look, and the colors of the page's theme. */
  private dress(): void {
    const { color, backgroundColor } = getComputedStyle(this.stage.canvas);
    this.stage.scene.background = new THREE.Color(backgroundColor);
    this.shape?.dress(store.get());
    this.drawPlane(store.get(), new THREE.Color(color));
    this.stage.invalidate();
  }

  private poseWaits = false;

  /** Pose once after all changes of the present event. */
  private poseSoon(): void {
    if (this.poseWaits) return;
    this.poseWaits = true;
    queueMicrotask(() => {
      this.poseWaits = false;
      this.pose();
    });
  }

  private pose(): void {
    const state = store.get();
    this.shape?.show(sceneOf(state));
    this.gizmo.follow(state);
    this.mark();
    this.stage.invalidate();
  }

  private mark(): void {
    const state = store.get();
    this.marks = this.shape ? marksOf(state, sceneOf(state), this.shape) : [];
    this.stage.drawn();
  }

  private drawPlane({ edit, mesh }: State, color: THREE.Color): void {
    const used = mesh && edit?.symmetry;
    const { plane } = this;
    plane.visible = Boolean(used);
    plane.material.color = color;
    if (!used || !this.shape) return;
    const { normal, offset } = mirrorOf(used, mesh.center);
    plane.position.set(...normal).multiplyScalar(offset);
    plane.lookAt(plane.position.clone().add(new THREE.Vector3(...normal)));
    plane.scale.setScalar(0.65 * this.shape.radius);
  }

  /** Look at the surface that follows the selected handle; without a handle, look at the whole shape. */
  private frameSelection(shape: Shape): void {
    const { selected } = store.get();
    const columns = sceneOf(store.get()).columns.filter(({ handle }) => handle === selected && handle > 0);
    const posed = shape.posed.read();
    const held = new THREE.Box3();
    const point = new THREE.Vector3();
    shape.vertexOf.forEach((vertex, row) => {
      const most = columns.reduce((sum, column) => sum + weightOf(column, vertex), 0);
      if (most > 0.5) held.expandByPoint(point.fromArray(posed, 4 * row));
    });
    if (held.isEmpty()) this.stage.frameShape(shape.radius);
    else {
      const { center, radius } = held.getBoundingSphere(new THREE.Sphere());
      this.stage.frame(center.toArray(), Math.max(1.2 * radius, shape.radius / 10));
    }
  }

  /** Show a selection box. When it is done, paint or erase the vertices in it. */
  selectBox(box: DOMRect, done: boolean, erase: boolean): void {
    this.box.hidden = done;
    for (const side of ["left", "top", "width", "height"] as const) this.box.style[side] = `${box[side]}px`;
    if (!done || !this.shape || !this.picker) return;
    const { camera, width, height } = this.stage;
    const rows = this.picker.within(camera, box, width, height, store.get().xray);
    touch(this.shape, (row) => rows.has(row), erase);
  }
}

const GRIP = 12; // pixels from the target of a mark within which a press takes the mark

/** Keys of the state on which the pose and the marks depend. */
const POSED_BY =
  "edit columns ahead moment comparing probe painted selected mesh stays weights look isolated hover ladders level suggestions similar dragging gizmo local snap tool axis marked".split(
    " ",
  ) as (keyof State)[];
