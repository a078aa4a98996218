/** The view: it follows the store, and tells what a person does on the canvas. */

import { Color, MOUSE } from "three";

import * as edit from "../actions/edit";
import { tell, type Arrivals } from "../actions/server";
import type { Payload } from "../protocol/frames";
import type { ColorsMessage, DetailMessage, MeshMessage, PositionsMessage } from "../protocol/messages";
import { alive, present, selectedHandle, store, type State } from "../store/state";
import { Background } from "./overlays/background";
import { Brush } from "./overlays/brush";
import { Gizmo } from "./overlays/gizmo";
import { marksOf, ringOf } from "./overlays/marks";
import { Markers } from "./overlays/markers";
import { Picker, type Pick } from "./picker";
import { Planes } from "./overlays/planes";
import { Pointer } from "./pointer";
import { mirrorOf, sceneOf } from "./scene";
import { Shape } from "./shape";
import { Stage } from "./stage";
import { themeColor } from "./theme";

/** What of the state the shape's pose and its marks depend on. */
const POSED = [
  "edit",
  "columns",
  "ahead",
  "moment",
  "comparing",
  "probe",
  "painted",
  "selected",
  "hidden",
  "mesh",
  "suggestions",
  "alike",
  "showGhosts",
  "dragging",
  "gizmo",
  "space",
  "snap",
  "tool",
] as const satisfies readonly (keyof State)[];

export class Viewer implements Arrivals {
  readonly stage: Stage;
  shape: Shape | null = null;
  picker: Picker | null = null;
  private readonly gizmo: Gizmo;
  private readonly markers: Markers;
  private readonly planes = new Planes();
  private readonly background = new Background();
  private readonly brush: Brush;

  constructor(canvas: HTMLCanvasElement, overlay: HTMLElement) {
    this.stage = new Stage(canvas);
    this.markers = new Markers(overlay, (point) => this.stage.project(point));
    this.stage.subject = () => (this.shape?.group.visible ? this.shape : null);
    this.stage.saw = (seen) => {
      if (store.get().seen !== seen) store.set({ seen });
    };
    this.stage.drawn = () => this.markers.place();
    // The gizmo hears of a press before the orbit does, and stops it.
    this.gizmo = new Gizmo(this.stage.camera, canvas, this.gizmoEvents(), () => this.stage.invalidate());
    this.stage.scene.add(this.background.mesh, this.planes.group, this.gizmo.proxy, this.gizmo.helper);
    this.brush = new Brush(() => this.shape);
    new Pointer(canvas, {
      busy: () => this.gizmo.dragging || this.gizmo.hovered,
      dragging: () => this.gizmo.dragging,
      pick: (x, y) => this.pick(x, y),
      click: (picked) => this.click(picked),
      wheel: (delta) => this.wheel(delta),
      paint: (picked, erase) => this.brush.paint(picked, erase),
      rest: (picked) => this.probe(picked),
    });
    this.follow(overlay);
  }

  /** What pictures leave out. */
  get helpers(): readonly { visible: boolean }[] {
    return [this.planes.group, this.gizmo.helper];
  }

  /** Show the whole shape again. */
  frame(): void {
    if (this.shape) this.stage.frameShape(this.shape.radius);
  }

  // --- what arrives in arrays

  mesh(message: MeshMessage, payload: Payload): void {
    this.picker?.dispose();
    this.shape?.dispose();
    this.stage.pace.forget();
    const shape = new Shape(message, payload, this.stage.renderer, () => this.stage.invalidate());
    this.shape = shape;
    this.picker = new Picker(this.stage.renderer, shape);
    this.stage.scene.add(shape.group);
    this.stage.frameShape(shape.radius);
    this.dress();
    this.pose();
  }

  detail(message: DetailMessage, payload: Payload): void {
    if (message.mesh === store.get().mesh?.mesh) this.shape?.detail(message, payload);
    this.stage.invalidate();
  }

  colors(_: ColorsMessage, payload: Payload): void {
    this.shape?.setFeatureColors(payload.get("colors", "uint8"));
    this.stage.invalidate();
  }

  positions(_: PositionsMessage, payload: Payload): void {
    if (store.get().edit?.posing !== "server") return;
    this.shape?.setGiven({ positions: payload.get("positions", "float32"), normals: payload.get("normals", "int16") });
    this.stage.invalidate();
  }

  pick(x: number, y: number): Pick | null {
    const { camera, width, height } = this.stage;
    return this.picker?.pick(camera, x, y, width, height) ?? null;
  }

  /** Colors of the page's theme, for what is drawn on the canvas. */
  dress(): void {
    const color = (name: string) => new Color(themeColor(name));
    const state = store.get();
    this.background.dress(themeColor("--stage-light"), themeColor("--stage"));
    this.shape?.setClay(color("--clay"));
    this.shape?.setWireframe(state.wireframe, color("--wire"), 0.5);
    this.drawPlanes(state, color("--accent"));
    this.shape?.setLook(state.look, state.comparing ? 0 : 1);
    this.stage.invalidate();
  }

  // --- following the store

  private follow(overlay: HTMLElement): void {
    for (const key of POSED)
      store.watch(
        (state) => state[key],
        () => this.soon(),
      );
    // Marks lie over the picture, which stays as it is.
    store.watch(
      (state) => state.hover,
      () => this.mark(),
    );
    for (const key of ["look", "wireframe", "theme", "comparing", "showPlanes"] as const) {
      store.watch(
        (state) => state[key],
        () => this.dress(),
      );
    }
    store.watch(
      (state) => state.edit?.symmetry,
      () => this.dress(),
    );
    store.watch(
      (state) => state.edit?.planes,
      () => this.dress(),
    );
    store.watch(
      (state) => state.edit,
      () => this.askForPositions(),
    );
    store.watch(
      (state) => state.dragging,
      (dragging) => {
        this.stage.orbit.enabled = !dragging;
        this.stage.hold(dragging);
      },
    );
    const { pace } = this.stage;
    pace.quality = store.get().quality;
    store.watch(
      (state) => state.quality,
      (quality) => {
        pace.quality = quality;
        this.stage.invalidate();
      },
    );
    store.watch(
      (state) => state.look === "features" && alive(state) && state.mesh,
      (wanted) => {
        if (wanted) tell({ type: "features" });
      },
    );
    store.watch(
      (state) => state.tool,
      (tool) => {
        this.stage.orbit.mouseButtons.LEFT = tool === "paint" ? null : MOUSE.ROTATE;
        overlay.classList.toggle("through", tool === "paint");
      },
    );
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.dress());
  }

  private waiting = false;

  /** Pose once after all changes of this moment. */
  private soon(): void {
    if (this.waiting) return;
    this.waiting = true;
    queueMicrotask(() => {
      this.waiting = false;
      this.pose();
    });
  }

  private pose(): void {
    const state = store.get();
    const scene = sceneOf(state);
    const { shape } = this;
    if (!shape) {
      this.markers.show([]);
      this.gizmo.hold(null);
      this.stage.invalidate();
      return;
    }
    shape.show(scene);
    shape.useGiven(!state.comparing && state.moment === null);
    this.hold(state);
    this.markers.show(marksOf(state, scene, shape));
    this.markers.showRing(ringOf(state));
    this.stage.invalidate();
  }

  private mark(): void {
    const state = store.get();
    if (this.shape) this.markers.show(marksOf(state, sceneOf(state), this.shape));
  }

  private hold(state: State): void {
    const handle = selectedHandle(state);
    const shown = handle && !state.hidden.has(handle.handle) && state.tool !== "paint" && !state.comparing;
    const { mesh } = state;
    this.gizmo.configure(
      state.gizmo,
      state.space,
      state.snap && mesh ? niceStep(mesh.diagonal / 50) : null,
      state.tool === "pivot",
    );
    if (!handle || !shown || !mesh) {
      this.gizmo.hold(null);
      return;
    }
    const { transform } = present(state, handle);
    this.gizmo.hold({ transform, position: handle.position, center: mesh.center });
  }

  private drawPlanes(state: State, color: Color): void {
    const { edit: known, mesh } = state;
    if (!known || !mesh || !this.shape) {
      this.planes.group.clear();
      return;
    }
    const used = known.symmetry;
    const planes = [...(used ? [used] : []), ...(state.showPlanes ? known.planes : [])];
    this.planes.show(
      planes.map((plane) => ({ mirror: mirrorOf(plane, mesh.center), used: plane === used })),
      this.shape.radius,
      color,
    );
  }

  private askForPositions(): void {
    const { edit: known } = store.get();
    if (known?.posing === "server") tell({ type: "compute" });
    else this.shape?.setGiven(null);
  }

  // --- what a person does on the canvas

  private gizmoEvents() {
    return {
      started: () => {
        const { selected } = store.get();
        if (selected !== null) edit.startDrag(selected);
      },
      moved: edit.dragTo,
      ended: edit.endDrag,
    };
  }

  private click(picked: Pick | null): void {
    const state = store.get();
    if (!picked) {
      edit.select(null);
      return;
    }
    if (!alive(state)) return;
    store.set({ hover: { vertex: picked.vertex, row: picked.row }, probe: null });
    if (state.tool === "fix") edit.fix(picked.vertex);
    else if (state.tool === "hold") edit.hold(picked.vertex);
  }

  private wheel(delta: number): boolean {
    const { selected } = store.get();
    if (selected === null) return false;
    edit.wheelReach(selected, Math.exp(-delta / 900));
    return true;
  }

  private probe(picked: Pick | null): void {
    const state = store.get();
    if (!picked || !alive(state) || state.tool === "paint" || state.tool === "pivot") return;
    tell({ type: "probe", at: { vertex: picked.vertex } });
  }
}

/** 1, 2 or 5 times a power of ten, near `step`. */
export function niceStep(step: number): number {
  const power = 10 ** Math.floor(Math.log10(step));
  const digit = step / power;
  return power * (digit < 1.5 ? 1 : digit < 3.5 ? 2 : digit < 7.5 ? 5 : 10);
}
