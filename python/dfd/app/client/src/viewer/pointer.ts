/** Mouse, pen and touch on the canvas: hover, clicks, orbits, the wheel during a drag, and brush strokes. */

import { store } from "../store/state";
import type { Pick } from "./picker";

export interface PointerEvents {
  /** Whether the gizmo uses the pointer. */
  busy(): boolean;
  dragging(): boolean;
  pick(x: number, y: number): Pick | null;
  click(picked: Pick | null, event: PointerEvent): void;
  /** Return whether the wheel event was used. */
  wheel(delta: number): boolean;
  paint(picked: Pick, erase: boolean): void;
  /** Called while a box is drawn, at last with `done`. */
  box(box: DOMRect, done: boolean, erase: boolean): void;
  /** Called when the pointer rests on a point. */
  rest(picked: Pick): void;
}

const CLICK_DISTANCE = 5;
const REST_MILLISECONDS = 100;

export class Pointer {
  private down: { x: number; y: number; id: number; moved: boolean } | null = null;
  /** The stroke or box that the pointer draws while it is down. */
  private drawing: "paint" | "box" | null = null;
  private frame = 0;
  private timer = 0;
  private last: PointerEvent | null = null;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly events: PointerEvents,
  ) {
    canvas.addEventListener("pointerdown", (event) => this.pressed(event));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerup", (event) => this.released(event));
    canvas.addEventListener("pointercancel", () => this.forget());
    canvas.addEventListener("pointerleave", () => this.unhover());
    // The focus ring is only shown for keyboard users.
    canvas.addEventListener("pointerdown", () => (canvas.dataset.pointed = ""));
    canvas.addEventListener("blur", () => delete canvas.dataset.pointed);
    // Listen before the orbit controls, which would zoom.
    canvas.addEventListener("wheel", (event) => this.turned(event), { capture: true, passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  private pressed(event: PointerEvent): void {
    if (!event.isPrimary) {
      // A second finger zooms, so this is no click.
      if (this.down) this.down.moved = true;
      return;
    }
    if (event.button !== 0 || this.events.busy()) return;
    const [x, y] = this.at(event);
    this.down = { x, y, id: event.pointerId, moved: false };
    const { tool } = store.get();
    if (tool !== "paint" && tool !== "box") return;
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
      if (this.drawing) this.stroke(this.last);
      else if (!this.down && this.last.buttons === 0) this.hover(this.last);
    });
  }

  private released(event: PointerEvent): void {
    const { down, drawing } = this;
    if (down?.id !== event.pointerId) return;
    if (drawing === "box") this.stroke(event, true);
    this.forget();
    if (drawing || down.moved || this.events.dragging()) return;
    this.events.click(this.events.pick(...this.at(event)), event);
  }

  private stroke(event: PointerEvent, done = false): void {
    const [x, y] = this.at(event);
    if (this.drawing === "box" && this.down) {
      const box = [Math.min(x, this.down.x), Math.min(y, this.down.y)] as const;
      this.events.box(new DOMRect(...box, Math.abs(x - this.down.x), Math.abs(y - this.down.y)), done, event.shiftKey);
      return;
    }
    const picked = this.events.pick(x, y);
    if (picked) this.events.paint(picked, event.shiftKey);
  }

  private hover(event: PointerEvent): void {
    clearTimeout(this.timer);
    const picked = this.events.busy() ? null : this.events.pick(...this.at(event));
    if (!picked) {
      this.unhover();
      return;
    }
    const { probe } = store.get();
    const same = probe?.vertex === picked.vertex;
    store.set({ hover: { vertex: picked.vertex, row: picked.row }, probe: same ? probe : null });
    if (!same) this.timer = window.setTimeout(() => this.events.rest(picked), REST_MILLISECONDS);
  }

  private turned(event: WheelEvent): void {
    if (!this.events.dragging() || !this.events.wheel(event.deltaY || event.deltaX)) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }

  private unhover(): void {
    clearTimeout(this.timer);
    this.last = null;
    if (store.get().hover ?? store.get().probe) store.set({ hover: null, probe: null });
  }

  private forget(): void {
    this.down = null;
    this.drawing = null;
  }

  private at(event: PointerEvent): [number, number] {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }
}
