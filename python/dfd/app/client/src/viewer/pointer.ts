/** Mouse, pen and touch on the canvas: hover, clicks, brush strokes, boxes, and the wheel during a drag. */

import { changePart, hold, preview, resize, resizeDragged, select, showWeights, toggleFixed } from "../actions/edit";
import { dragMark, dropMark, placeMark, startMark } from "../actions/marks";
import { add, subtract } from "../posing/affine";
import { draws, ready, store, type Picked } from "../store/state";
import { paint } from "./overlays/brush";
import type { Viewer } from "./viewer";

const CLICK_DISTANCE = 5; // pixels; a longer motion is no click
const NOTCH = 40; // pixels of scrolling that count as one notch of the wheel
const ZOOM_MILLISECONDS = 400; // the wheel goes on to zoom if less than this time has passed since it zoomed
const REST_MILLISECONDS = 100; // the weights are shown after the pointer has rested for this time

export class Pointer {
  private down: { x: number; y: number; id: number; moved: boolean } | null = null;
  /** The stroke or box that the pointer draws while it is down. */
  private drawing: "paint" | "box" | null = null;
  /** Pixels from the pointer to the target of the dragged mark. */
  private offset: readonly [number, number] = [0, 0];
  private scrolled = 0;
  private zoomed = -Infinity;
  private frame = 0;
  private timer = 0;
  private last: PointerEvent | null = null;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly viewer: Viewer,
  ) {
    // This listener must run before the listener of the orbit controls, which would also use the press.
    canvas.addEventListener("pointerdown", (event) => this.takeMark(event), { capture: true });
    canvas.addEventListener("pointerdown", (event) => this.pressed(event));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerup", (event) => this.released(event));
    canvas.addEventListener("pointercancel", () => this.forget());
    canvas.addEventListener("pointerleave", () => this.unhover());
    // The style sheet hides the focus outline of a canvas that was clicked.
    canvas.addEventListener("pointerdown", () => (canvas.dataset.pointed = ""));
    canvas.addEventListener("blur", () => delete canvas.dataset.pointed);
    // This listener must run before the listener of the orbit controls, which zooms.
    canvas.addEventListener("wheel", (event) => this.wheeled(event), { capture: true, passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /** Begin to drag the mark under the pointer. */
  private takeMark(event: PointerEvent): void {
    const [x, y] = this.at(event);
    const found = event.isPrimary && event.button === 0 ? this.viewer.markAt(x, y) : null;
    if (!found) return;
    event.stopImmediatePropagation();
    this.canvas.setPointerCapture(event.pointerId);
    this.offset = [found.at[0] - x, found.at[1] - y];
    this.unhover();
    startMark(found.index);
  }

  private moveMark(event: PointerEvent): void {
    const { marked, mesh } = store.get();
    if (!marked || !mesh) return;
    const [x, y] = this.at(event);
    const [dx, dy] = this.offset;
    const goal = this.viewer.stage.beside(subtract(marked.target, mesh.center), x + dx, y + dy);
    void dragMark(add(goal, mesh.center));
  }

  private pressed(event: PointerEvent): void {
    if (!event.isPrimary) {
      // A second finger zooms, so the first finger must not click.
      if (this.down) this.down.moved = true;
      return;
    }
    if (event.button !== 0 || this.viewer.gizmo.busy) return;
    const [x, y] = this.at(event);
    this.down = { x, y, id: event.pointerId, moved: false };
    const { tool } = store.get();
    if (!draws(tool)) return;
    this.drawing = tool;
    this.canvas.setPointerCapture(event.pointerId);
    this.stroke(event);
  }

  private moved(event: PointerEvent): void {
    this.last = event;
    const [x, y] = this.at(event);
    if (this.down && Math.hypot(x - this.down.x, y - this.down.y) > CLICK_DISTANCE) this.down.moved = true;
    this.frame ||= requestAnimationFrame(() => {
      this.frame = 0;
      if (!this.last) return;
      if (store.get().marked) this.moveMark(this.last);
      else if (this.drawing) this.stroke(this.last);
      else if (!this.down && this.last.buttons === 0) this.hover(this.last);
    });
  }

  /** After a press, the hover mark would cover the gizmo. It comes back when the pointer moves. */
  private released(event: PointerEvent): void {
    const { down, drawing } = this;
    if (dropMark()) return;
    if (down?.id !== event.pointerId) return;
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    if (drawing === "box") this.stroke(event, true);
    if (drawing) store.set({ stroked: [event.clientX, event.clientY] });
    this.forget();
    if (!drawing && !down.moved && !this.viewer.stage.pressCompass(event))
      click(this.viewer.pick(...this.at(event)), event);
  }

  private stroke(event: PointerEvent, done = false): void {
    const [x, y] = this.at(event);
    if (this.drawing === "box" && this.down) {
      const box = [Math.min(x, this.down.x), Math.min(y, this.down.y)] as const;
      this.viewer.selectBox(
        new DOMRect(...box, Math.abs(x - this.down.x), Math.abs(y - this.down.y)),
        done,
        event.shiftKey,
      );
      return;
    }
    const picked = this.viewer.pick(x, y);
    if (picked && this.viewer.shape) paint(this.viewer.shape, picked, event.shiftKey);
  }

  private hover(event: PointerEvent): void {
    clearTimeout(this.timer);
    const { busy } = this.viewer.gizmo;
    const picked = busy ? null : this.viewer.pick(...this.at(event));
    const grips = busy || this.viewer.markAt(...this.at(event));
    this.canvas.dataset.cursor = grips ? "gizmo" : picked && ready(store.get()) ? "part" : "";
    if (!picked) {
      this.unhover();
      return;
    }
    const { probe, level } = store.get();
    const same = probe?.vertex === picked.vertex && probe.level === level;
    store.set({ hover: picked, probe: same ? probe : null });
    if (!same) this.timer = window.setTimeout(() => showWeights(picked.vertex), REST_MILLISECONDS);
  }

  private wheeled(event: WheelEvent): void {
    const { dragging, probe, selected } = store.get();
    const onPoint = typeof probe?.vertex === "number";
    const onHandle = selected !== null && this.viewer.gizmo.busy;
    const zooms = event.ctrlKey || event.timeStamp - this.zoomed < ZOOM_MILLISECONDS;
    if (!dragging && (zooms || !(onHandle || onPoint))) {
      this.zoomed = event.timeStamp;
      return;
    }
    event.preventDefault();
    event.stopImmediatePropagation();
    this.scrolled += event.deltaY || event.deltaX;
    if (Math.abs(this.scrolled) < NOTCH) return;
    const by = this.scrolled > 0 ? -1 : 1;
    this.scrolled = 0;
    if (dragging) resizeDragged(by);
    else if (onHandle) resize(by);
    else if (onPoint) preview(probe.vertex, by);
  }

  private unhover(): void {
    clearTimeout(this.timer);
    this.last = null;
    if (store.get().hover ?? store.get().probe) store.set({ hover: null, probe: null, level: 0 });
  }

  private forget(): void {
    dropMark();
    this.down = null;
    this.drawing = null;
  }

  private at(event: PointerEvent): [number, number] {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }
}

function click(picked: Picked | null, { shiftKey, ctrlKey, metaKey }: PointerEvent): void {
  const state = store.get();
  if (!picked) select(null);
  if (!picked || !ready(state)) return;
  const { vertex } = picked;
  store.set({ hover: null, probe: null });
  if (shiftKey || ctrlKey || metaKey) void changePart(shiftKey ? "add" : "remove", vertex);
  else if (state.tool === "fix") toggleFixed(vertex);
  else if (state.tool === "marks") placeMark(vertex);
  else if (state.tool === "hold") hold(vertex);
}
