/** The gizmo that moves, turns and scales the selected handle, or moves its pivot. */

import { MathUtils, Object3D, Quaternion, type Camera } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";

import { dragTo, endDrag, startDrag } from "../../actions/edit";
import { apply, basisOf, matrixOf, quaternionOf, rotationOf, type Transform, type Vec3 } from "../../posing/affine";
import { bendTowards, bentTip, type PartEnds } from "../../posing/bend";
import type { GizmoMode } from "../../store/state";
import { gripOf } from "../scene";

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
    if (ends) {
      const tip = apply(matrixOf(transform, position), bentTip(ends, transform.bend, transform.joint));
      this.proxy.position.set(tip[0] - center[0], tip[1] - center[1], tip[2] - center[2]);
    } else this.proxy.position.set(...gripOf(transform, position, center));
    this.proxy.quaternion.copy(quaternionOf(held.transform.rotation)).multiply(axesTurn(held.transform));
    this.proxy.scale.set(...held.transform.scale);
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
    const { x, y, z } = this.proxy.position;
    const grip: Vec3 = [x + held.center[0], y + held.center[1], z + held.center[2]];
    const { transform, position } = held;
    if (held.ends) {
      // The bend is applied before the rest of the transform.
      const tip = apply(matrixOf(transform, position).invert(), grip);
      return { ...transform, bend: bendTowards(held.ends, tip, transform.joint) };
    }
    if (this.pivoting) {
      // When the pivot moves, the translation is adjusted so that the shape does not move.
      const [tx, ty, tz] = transform.translation;
      return { ...transform, pivot: [grip[0] - tx, grip[1] - ty, grip[2] - tz], pivotAt: null };
    }
    const pivot = transform.pivot ?? position;
    const q = this.proxy.quaternion.clone().multiply(axesTurn(transform).invert()).normalize();
    const { scale } = this.proxy;
    return {
      ...transform,
      translation: [grip[0] - pivot[0], grip[1] - pivot[1], grip[2] - pivot[2]],
      rotation: rotationOf(q),
      scale: [scale.x, scale.y, scale.z],
    };
  }
}

/** The rotation from the mesh's axes to the axes of scale. */
function axesTurn({ axes }: Transform): Quaternion {
  return axes ? new Quaternion().setFromRotationMatrix(basisOf(axes)) : new Quaternion();
}
