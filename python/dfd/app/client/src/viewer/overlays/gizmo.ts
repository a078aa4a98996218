/** The gizmo that moves, turns and scales the selected handle, or moves its pivot. */

import { MathUtils, Object3D, Quaternion, Vector3, type Camera } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";

import { dragTo, endDrag, startDrag } from "../../actions/edit";
import {
  apply,
  basisOf,
  matrixOf,
  quaternionOf,
  rotationOf,
  subtract,
  type Transform,
  type Vec3,
} from "../../posing/affine";
import { bendTowards, bentTip, type PartEnds } from "../../posing/bend";
import type { GizmoMode } from "../../store/state";

export interface Held {
  readonly transform: Transform;
  readonly position: Vec3;
  readonly center: Vec3;
  /** Both ends of the axis, in the bend mode. */
  readonly ends: PartEnds | null;
}

const SNAP_ANGLE = MathUtils.degToRad(15);
const SNAP_SCALE = 0.1;

export class Gizmo {
  readonly helper: Object3D;
  /** The object that the controls move; it must be in the scene. */
  readonly proxy = new Object3D();
  private readonly controls: TransformControls;
  private held: Held | null = null;
  private pivoting = false;

  constructor(camera: Camera, canvas: HTMLElement, redraw: () => void) {
    this.controls = new TransformControls(camera, canvas);
    this.controls.setSize(0.85);
    this.controls.setColors(0xd64545, 0x3f9b4a, 0x3b6fd8, 0xf2b632);
    this.helper = this.controls.getHelper();
    this.controls.addEventListener("change", redraw);
    this.controls.addEventListener("dragging-changed", (event) => (event.value ? startDrag() : endDrag()));
    this.controls.addEventListener("objectChange", () => {
      if (this.held) dragTo(this.read(this.held));
    });
  }

  get dragging(): boolean {
    return this.controls.dragging;
  }

  /** Whether the pointer is over the gizmo. */
  get hovered(): boolean {
    return this.controls.axis !== null;
  }

  hold(held: Held | null): void {
    if (this.controls.dragging) return;
    this.held = held;
    if (!held) {
      this.controls.detach();
      return;
    }
    const { ends, transform, position, center } = held;
    const grip = ends ? bentTip(ends, transform.bend, transform.joint) : (transform.pivot ?? position);
    this.proxy.position.set(...subtract(apply(matrixOf(transform, position), grip), center));
    this.proxy.quaternion.copy(quaternionOf(transform.rotation)).multiply(axesTurn(transform));
    this.proxy.scale.set(...transform.scale);
    this.proxy.updateMatrixWorld();
    this.controls.attach(this.proxy);
  }

  configure(mode: GizmoMode, space: "local" | "world", snap: number | null, pivoting: boolean): void {
    this.pivoting = pivoting;
    this.controls.setMode(pivoting || mode === "bend" ? "translate" : mode);
    this.controls.setSpace(space);
    this.controls.setTranslationSnap(snap);
    this.controls.setRotationSnap(snap === null ? null : SNAP_ANGLE);
    this.controls.setScaleSnap(snap === null ? null : SNAP_SCALE);
  }

  private read(held: Held): Transform {
    const { transform, position, center, ends } = held;
    const { scale, quaternion } = this.proxy;
    const grip = this.proxy.position
      .clone()
      .add(new Vector3(...center))
      .toArray();
    if (ends) {
      // The bend is applied before the rest of the transform.
      const tip = apply(matrixOf(transform, position).invert(), grip);
      return { ...transform, bend: bendTowards(ends, tip, transform.joint) };
    }
    if (this.pivoting) return { ...transform, pivot: subtract(grip, transform.translation), pivotAt: null };
    return {
      ...transform,
      translation: subtract(grip, transform.pivot ?? position),
      rotation: rotationOf(quaternion.clone().multiply(axesTurn(transform).invert()).normalize()),
      scale: scale.toArray(),
    };
  }
}

/** The rotation from the mesh's axes to the axes of scale. */
function axesTurn({ axes }: Transform): Quaternion {
  return axes ? new Quaternion().setFromRotationMatrix(basisOf(axes)) : new Quaternion();
}
