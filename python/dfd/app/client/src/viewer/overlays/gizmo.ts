/** The gizmo that moves, rotates, scales and bends the selected handle, or moves its pivot. */

import { MathUtils, Object3D, Quaternion, Vector3, type Camera } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";

import { dragTo, endDrag, startDrag } from "../../actions/edit";
import {
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
import { bendTowards, bentTip, type PartEnds } from "../../posing/bend";
import { draws, present, selectedHandle, type State } from "../../store/state";

/** The handle that the gizmo moves. */
interface Held {
  readonly transform: Transform;
  readonly position: Vec3;
  readonly center: Vec3;
  /** In bend mode, the ends of the axis of the handle's part; null in other modes. */
  readonly ends: PartEnds | null;
  /** Whether only the pivot moves. */
  readonly pivoting: boolean;
}

const SNAP_ANGLE = MathUtils.degToRad(15);
const SNAP_SCALE = 0.1;

export class Gizmo {
  readonly helper: Object3D;
  /** The object that the controls move; it must be in the scene. */
  readonly proxy = new Object3D();
  private readonly controls: TransformControls;
  private held: Held | null = null;

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

  /** Whether the gizmo uses the pointer. */
  get busy(): boolean {
    return this.controls.dragging || this.controls.axis !== null;
  }

  /** The axis (0 to 2) that the pointer drags; null without one. */
  get grabbed(): number | null {
    const axis = "XYZ".indexOf(this.controls.axis ?? "none");
    return this.controls.dragging && this.controls.axis?.length === 1 && axis >= 0 ? axis : null;
  }

  /** Move the gizmo to the selected handle, or hide it. */
  follow(state: State): void {
    const { gizmo, tool, local, snap, mesh } = state;
    this.controls.setMode(tool === "pivot" || gizmo === "bend" ? "translate" : gizmo);
    this.controls.setSpace(local ? "local" : "world");
    this.controls.setTranslationSnap(snap && mesh ? niceStep(mesh.diagonal / 50) : null);
    this.controls.setRotationSnap(snap ? SNAP_ANGLE : null);
    this.controls.setScaleSnap(snap ? SNAP_SCALE : null);
    if (this.controls.dragging) return;
    this.held = heldOf(state);
    if (!this.held) {
      this.controls.detach();
      return;
    }
    const { ends, transform, position, center } = this.held;
    const grip = ends ? bentTip(ends, transform.bend, transform.joint) : (transform.pivot ?? position);
    this.proxy.position.set(...subtract(apply(matrixOf(transform, position), grip), center));
    this.proxy.quaternion.copy(quaternionOf(transform.rotation)).multiply(axesTurn(transform));
    this.proxy.scale.set(...transform.scale);
    this.proxy.updateMatrixWorld();
    this.controls.attach(this.proxy);
  }

  private read({ transform, position, center, ends, pivoting }: Held): Transform {
    const { scale, quaternion } = this.proxy;
    const grip = this.proxy.position
      .clone()
      .add(new Vector3(...center))
      .toArray();
    if (ends) {
      // The transform acts after the bend, so the inverse transform gives the tip of the bent part.
      const tip = apply(matrixOf(transform, position).invert(), grip);
      return { ...transform, bend: bendTowards(ends, tip, transform.joint) };
    }
    if (pivoting) return { ...transform, pivot: subtract(grip, transform.translation), pivot_at: null };
    return {
      ...transform,
      translation: subtract(grip, transform.pivot ?? position),
      rotation: rotationOf(quaternion.clone().multiply(axesTurn(transform).invert()).normalize()),
      scale: scale.toArray(),
    };
  }
}

function heldOf(state: State): Held | null {
  const { mesh, axis, tool, gizmo, comparing } = state;
  const handle = selectedHandle(state);
  // While a click keeps a point still, the gizmo must not take the click.
  if (!handle || !mesh || comparing || draws(tool) || tool === "fix") return null;
  const pivoting = tool === "pivot";
  const bends = gizmo === "bend" && !pivoting;
  const { base, tip } = axis?.handle === handle.handle ? axis : { base: null, tip: null };
  const ends = bends && base && tip ? { base, tip } : null;
  if (bends && !ends) return null;
  return { ...present(state, handle), center: mesh.center, ends, pivoting };
}

/** Return the rotation from the mesh's axes to the axes along which the transform scales. */
function axesTurn({ axes }: Transform): Quaternion {
  return axes ? new Quaternion().setFromRotationMatrix(basisOf(axes)) : new Quaternion();
}
