/** The gizmo that moves, rotates, scales and bends the selected handle, or moves its pivot. */

import { MathUtils, Object3D, Quaternion, Vector3 } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";

import { dragTo, endDrag, startDrag } from "../../actions/edit";
import {
  add,
  apply,
  basisOf,
  matrixOf,
  niceStep,
  quaternionOf,
  rotationOf,
  subtract,
  type Transform,
  type Vec3,
} from "../../posing/affine";
import { bendTowards, bentTip } from "../../posing/bend";
import { pulledScale, stepped } from "../../posing/scale";
import type { BendAxis } from "../../protocol/messages";
import { present, selectedHandle, store, type State } from "../../store/state";
import { FIELD_OF_VIEW, type Stage } from "../stage";

/** The handle that the gizmo moves. */
interface Held {
  readonly transform: Transform;
  readonly position: Vec3;
  readonly center: Vec3;
  /** In bend mode, the axis of the handle's part; null in other modes. */
  readonly bends: BendAxis | null;
  /** Whether only the pivot moves. */
  readonly pivoting: boolean;
}

type Pixel = readonly [number, number];

/** A drag that scales by pixels: `pull` returns the signed distance of a pixel from the start. */
interface Pull {
  readonly start: Vec3;
  readonly axes: readonly number[];
  readonly pull: (pixel: Pixel) => number;
}

/** Steps of snapped rotations and bends in degrees; with Shift, the finer one. */
const STEP = 15;
const FINE_STEP = 5;
const SIZE = 0.85;
/** Length of an arm of the scale gizmo, and radius of the ring around it, as fractions of the height of the view. */
const ARM = 0.12 * SIZE;
const RING = 0.17 * SIZE;
const RING_WIDTH = 8; // pixels on each side of the ring that receive presses

export class Gizmo {
  readonly helper: Object3D;
  /** The object that the controls move; it must be in the scene. */
  readonly proxy = new Object3D();
  private readonly controls: TransformControls;
  private held: Held | null = null;
  private pull: Pull | null = null;
  private pointer: Pixel = [0, 0];
  private fine = false;
  private onRing = false;

  constructor(private readonly stage: Stage) {
    const { camera, canvas } = stage;
    // These listeners must run before those of the controls.
    const first = { capture: true };
    canvas.addEventListener("pointermove", (event) => this.moved(event), first);
    canvas.addEventListener("pointerdown", (event) => this.pressed(event), first);
    canvas.addEventListener("pointerup", (event) => this.released(event), first);
    canvas.addEventListener("pointercancel", (event) => this.released(event), first);
    this.controls = new TransformControls(camera, canvas);
    this.controls.setSize(SIZE);
    this.controls.setColors(0xd64545, 0x3f9b4a, 0x3b6fd8, 0xf2b632);
    this.helper = this.controls.getHelper();
    this.controls.addEventListener("change", () => stage.invalidate());
    this.controls.addEventListener("dragging-changed", (event) => {
      if (!event.value) this.end();
      else {
        this.begin();
        if (this.controls.mode === "scale") this.pullAxes(this.controls.axis ?? "XYZ");
      }
    });
    this.controls.addEventListener("objectChange", () => {
      if (this.held && !this.pull) dragTo(this.read(this.held));
    });
  }

  /** Whether the gizmo uses the pointer. */
  get busy(): boolean {
    return this.controls.dragging || this.controls.axis !== null || this.onRing || this.pull !== null;
  }

  /** The axis (0 to 2) that the pointer drags; null without one. */
  get grabbed(): number | null {
    const axis = "XYZ".indexOf(this.controls.axis ?? "none");
    return this.controls.dragging && this.controls.axis?.length === 1 && axis >= 0 ? axis : null;
  }

  /** The ring that scales evenly: its center, relative to the mesh's, and its radius in pixels; null in other modes. */
  get ring(): { readonly at: Vec3; readonly radius: number; readonly hot: boolean } | null {
    if (!this.held || this.controls.mode !== "scale") return null;
    const hot = this.onRing || this.controls.axis === "XYZ";
    return { at: this.proxy.position.toArray(), radius: RING * this.stage.height, hot };
  }

  /** Move the gizmo to the selected handle, or hide it. */
  follow(state: State): void {
    const { gizmo, tool, local } = state;
    this.controls.setMode(tool === "pivot" || gizmo === "bend" ? "translate" : gizmo);
    this.controls.setSpace(local ? "local" : "world");
    if (this.controls.dragging || this.pull) return;
    this.held = heldOf(state);
    if (!this.held) {
      this.onRing = false;
      this.controls.detach();
      return;
    }
    const { bends, transform, position, center } = this.held;
    const grip = bends ? bentTip(bends, transform.bend, transform.joint) : (transform.pivot ?? position);
    this.proxy.position.set(...subtract(apply(matrixOf(transform, position), grip), center));
    this.proxy.quaternion.copy(quaternionOf(transform.rotation)).multiply(axesTurn(transform));
    this.proxy.scale.set(...transform.scale);
    this.proxy.updateMatrixWorld();
    this.controls.attach(this.proxy);
  }

  private begin(): void {
    this.start = { position: this.proxy.position.clone(), quaternion: this.proxy.quaternion.clone() };
    startDrag();
  }

  private end(): void {
    this.pull = null;
    endDrag();
  }

  /** The place of the gizmo when the drag began. */
  private start = { position: new Vector3(), quaternion: new Quaternion() };

  private read(held: Held): Transform {
    const { transform, position, center, bends, pivoting } = held;
    const { mesh, snap } = store.get();
    const known = selectedHandle(store.get());
    const now = known ? present(store.get(), known).transform : transform;
    if (this.controls.mode === "rotate") {
      const turned = this.turned(snap).multiply(axesTurn(transform).invert());
      return { ...transform, rotation: rotationOf(turned.normalize(), now.rotation) };
    }
    const moved = this.proxy.position.clone().sub(this.start.position);
    if (snap && mesh && !bends) snapAlong(moved, niceStep(mesh.diagonal / 50), this.frame);
    const grip = add(moved.add(this.start.position).toArray(), center);
    if (bends) return { ...transform, bend: this.bent(held, bends, grip, now.bend) };
    if (pivoting) return { ...transform, pivot: subtract(grip, transform.translation), pivot_at: null };
    return { ...transform, translation: subtract(grip, transform.pivot ?? position) };
  }

  /** Return the rotation of the gizmo. Unlike that of the controls, its speed does not depend on the field of view. */
  private turned(snap: boolean): Quaternion {
    const { start, proxy, controls, stage } = this;
    const turn = rotationOf(proxy.quaternion.clone().multiply(start.quaternion.clone().invert()).normalize());
    const size = (degrees: number) => Math.tan(MathUtils.degToRad(degrees / 2));
    const speed = controls.axis === "E" ? 1 : size(FIELD_OF_VIEW) / size(stage.camera.fov);
    const angle = Math.hypot(...turn);
    const wanted = snap ? stepped(speed * angle, this.step) : speed * angle;
    const scaled = turn.map((part) => (part * wanted) / Math.max(angle, 1e-12)) as unknown as Vec3;
    return quaternionOf(scaled).multiply(start.quaternion);
  }

  /** Return the bend that moves the tip to `grip`, and put the gizmo at the tip. The search begins at `from`. */
  private bent({ transform, position, center }: Held, bends: BendAxis, grip: Vec3, from: Vec3): Vec3 {
    // The transform acts after the bend.
    const matrix = matrixOf(transform, position);
    const rows = this.grabbedRows(new Vector3(...subtract(grip, center)));
    const misses = (tip: Vec3) => {
      const off = new Vector3(...subtract(apply(matrix, tip), grip));
      return rows.map((row) => row.dot(off));
    };
    let bend = bendTowards(bends, from, transform.joint, misses);
    const angle = Math.hypot(...bend);
    if (store.get().snap && angle > 0)
      bend = bend.map((part) => (part * stepped(angle, this.step)) / angle) as unknown as Vec3;
    const tip = apply(matrix, bentTip(bends, bend, transform.joint));
    this.proxy.position.set(...subtract(tip, center));
    return bend;
  }

  private get step(): number {
    return this.fine ? FINE_STEP : STEP;
  }

  /** The axes along which the gizmo moves: those of the handle, or those of the mesh. */
  private get frame(): Quaternion {
    return this.controls.space === "local" && this.controls.axis !== "XYZ" ? this.start.quaternion : new Quaternion();
  }

  /** Return the directions in which the pointer moves the tip to `at`: the grabbed axes, or across the line of sight. */
  private grabbedRows(at: Vector3): Vector3[] {
    const axis = this.controls.axis ?? "XYZ";
    if (axis !== "XYZ")
      return [0, 1, 2]
        .filter((i) => axis.includes("XYZ"[i]))
        .map((i) => new Vector3().setComponent(i, 1).applyQuaternion(this.frame));
    const { camera } = this.stage;
    const sight = at.clone().sub(camera.position).normalize();
    const up = new Vector3(0, 1, 0).applyQuaternion(camera.quaternion);
    const across = up.cross(sight).negate().normalize();
    return [across, across.clone().cross(sight)];
  }

  private moved(event: PointerEvent): void {
    this.pointer = this.pixel(event);
    this.fine = event.shiftKey;
    const before = this.onRing;
    this.onRing = !this.controls.dragging && (this.pull !== null || this.overRing());
    if (before !== this.onRing) this.stage.invalidate();
    const { pull, held } = this;
    if (!pull || !held) return;
    const scale = pulledScale(pull.start, pull.axes, pull.pull(this.pointer), this.arm, store.get().snap);
    dragTo({ ...held.transform, scale });
    // The controls need not see the pointer.
    if (!this.controls.dragging) event.stopImmediatePropagation();
  }

  private pressed(event: PointerEvent): void {
    this.pointer = this.pixel(event);
    const center = this.center();
    if (event.button !== 0 || !event.isPrimary || !center || !this.held || !this.overRing()) return;
    event.stopImmediatePropagation();
    this.stage.canvas.setPointerCapture(event.pointerId);
    const away = (pixel: Pixel) => Math.hypot(pixel[0] - center[0], pixel[1] - center[1]);
    const begun = away(this.pointer);
    this.begin();
    this.pull = { start: this.held.transform.scale, axes: [0, 1, 2], pull: (pixel) => away(pixel) - begun };
  }

  private released(event: PointerEvent): void {
    if (!this.pull || this.controls.dragging) return;
    event.stopImmediatePropagation();
    this.end();
  }

  /** Scale the axes that the controls hold, such as "XY", by the motion of the pointer along them. */
  private pullAxes(name: string): void {
    const [center, held] = [this.center(), this.held];
    if (!center || !held) return;
    const axes = [0, 1, 2].filter((i) => name.includes("XYZ"[i]));
    // The middle of the gizmo scales evenly: up and to the right is larger.
    let direction = [1, -1];
    if (axes.length < 3) {
      const reach = this.proxy.position.distanceTo(this.stage.camera.position) * this.stage.slopeOfPixel;
      direction = [0, 0];
      for (const axis of axes) {
        const unit = new Vector3().setComponent(axis, 10 * reach).applyQuaternion(this.proxy.quaternion);
        const end = this.stage.project(unit.add(this.proxy.position).toArray());
        const [dx, dy] = end ? [end[0] - center[0], end[1] - center[1]] : [0, 0];
        const size = Math.max(Math.hypot(dx, dy), 1e-9);
        direction = [direction[0] + dx / size, direction[1] + dy / size];
      }
    }
    const size = Math.max(Math.hypot(...direction), 1e-9);
    const [x, y] = this.pointer;
    const along = (pixel: Pixel) => ((pixel[0] - x) * direction[0] + (pixel[1] - y) * direction[1]) / size;
    this.pull = { start: held.transform.scale, axes, pull: along };
  }

  private get arm(): number {
    return ARM * this.stage.height;
  }

  private center(): Pixel | null {
    return this.stage.project(this.proxy.position.toArray());
  }

  private overRing(): boolean {
    const { ring } = this;
    const center = ring && this.center();
    if (!center) return false;
    const away = Math.hypot(this.pointer[0] - center[0], this.pointer[1] - center[1]);
    return Math.abs(away - ring.radius) <= RING_WIDTH;
  }

  private pixel(event: PointerEvent): Pixel {
    const box = this.stage.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }
}

/** Round the coordinates of `moved` along the axes of `frame` to whole steps. */
function snapAlong(moved: Vector3, step: number, frame: Quaternion): void {
  moved.applyQuaternion(frame.clone().invert());
  moved.set(stepped(moved.x, step), stepped(moved.y, step), stepped(moved.z, step)).applyQuaternion(frame);
}

function heldOf(state: State): Held | null {
  const { mesh, axis, tool, gizmo, comparing } = state;
  const handle = selectedHandle(state);
  const pivoting = tool === "pivot";
  // The gizmo must not take the clicks of other tools.
  if (!handle || !mesh || comparing || !(pivoting || tool === "hold")) return null;
  const bending = gizmo === "bend" && !pivoting;
  const bends = bending && axis?.handle === handle.handle ? axis.bends : null;
  if (bending && !bends) return null;
  return { ...present(state, handle), center: mesh.center, bends, pivoting };
}

/** Return the rotation from the mesh's axes to the axes along which the transform scales. */
function axesTurn({ axes }: Transform): Quaternion {
  return axes ? new Quaternion().setFromRotationMatrix(basisOf(axes)) : new Quaternion();
}
