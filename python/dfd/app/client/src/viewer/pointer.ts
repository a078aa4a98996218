/** Mouse, pen and touch on the canvas: hovering, clicks apart from orbits, the wheel in a drag, strokes of the brush. */

import { store } from "../store/state";
import type { Pick } from "./picker";

export interface PointerEvents {
  /** Whether the gizmo has the pointer. */
  busy(): boolean;
  dragging(): boolean;
  pick(x: number, y: number): Pick | null;
  click(picked: Pick | null, event: PointerEvent): void;
  /** Whether the wheel was used up. */
  wheel(delta: number): boolean;
  paint(picked: Pick, erase: boolean): void;
  /** A box is drawn, and at last it is `done`. */
  box(box: DOMRect, done: boolean, erase: boolean): void;
  /** The pointer has rested on a point, or with Alt come to another part. */
  rest(picked: Pick, part: boolean): void;
}

const CLICK_DISTANCE = 5;
const REST_MILLISECONDS = 100;
/** A pick that takes longer than this is made only where the pointer rests. */
const SLOW_MILLISECONDS = 40;

export class Pointer {
  private down: { x: number; y: number; id: number; moved: boolean } | null = null;
  /** What the pointer draws while it is down. */
  private drawing: "paint" | "box" | null = null;
  private frame = 0;
  private timer = 0;
  private last: PointerEvent | null = null;
  /** As of the last event, of mouse or keyboard: Alt may be pressed between a move and its frame. */
  private alt = false;
  private slowness = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly events: PointerEvents,
  ) {
    canvas.addEventListener("pointerdown", (event) => this.pressed(event));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerup", (event) => this.released(event));
    canvas.addEventListener("pointercancel", () => this.forget());
    canvas.addEventListener("pointerleave", () => this.unhover());
    // A frame around the view is for those who came by the keyboard.
    canvas.addEventListener("pointerdown", () => (canvas.dataset.pointed = ""));
    canvas.addEventListener("blur", () => delete canvas.dataset.pointed);
    // Before the orbit's own listener, which would zoom.
    canvas.addEventListener("wheel", (event) => this.turned(event), { capture: true, passive: false });
    for (const type of ["keydown", "keyup"] as const) addEventListener(type, (event) => this.altered(event));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  private pressed(event: PointerEvent): void {
    if (!event.isPrimary) {
      // A second finger zooms: that was no click.
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
    this.alt = event.altKey;
    const [x, y] = this.at(event);
    if (this.down && Math.hypot(x - this.down.x, y - this.down.y) > CLICK_DISTANCE) this.down.moved = true;
    if (this.frame !== 0) return;
    this.frame = requestAnimationFrame(() => {
      this.frame = 0;
      if (!this.last) return;
      if (this.drawing) this.stroke(this.last);
      else if (!this.down && this.last.buttons === 0) this.hover(this.last);
    });
  }

  private released(event: PointerEvent): void {
    const { down } = this;
    if (down?.id !== event.pointerId) return;
    const { drawing } = this;
    if (drawing === "box") this.stroke(event, true);
    this.forget();
    if (drawing || down.moved || this.events.dragging()) return;
    const [x, y] = this.at(event);
    this.events.click(this.events.pick(x, y), event);
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
    if (this.events.busy()) this.unhover();
    else if (this.slowness < SLOW_MILLISECONDS) this.point(event);
    else this.timer = window.setTimeout(() => this.point(event), REST_MILLISECONDS);
  }

  /** Alt shows parts, also where the pointer rests. */
  private altered(event: KeyboardEvent): void {
    if (event.key !== "Alt" || event.repeat) return;
    this.alt = event.type === "keydown";
    if (!this.last) return;
    event.preventDefault();
    clearTimeout(this.timer);
    if (!this.down && !this.events.busy()) this.point(this.last);
  }

  private point(event: PointerEvent): void {
    const part = this.alt;
    const begun = performance.now();
    const [x, y] = this.at(event);
    const picked = this.events.pick(x, y);
    this.slowness = 0.5 * (this.slowness + performance.now() - begun);
    const { hover, probe } = store.get();
    if (!picked) {
      if (hover || probe) store.set({ hover: null, probe: null });
      return;
    }
    const ofPart = part && probe !== null && probe.part > 0;
    const same = ofPart
      ? probe.layer.values[picked.vertex] > 0
      : probe?.vertex === picked.vertex && !part && !probe.part;
    // A part stays in sight until the next one comes.
    store.set({ hover: { vertex: picked.vertex, row: picked.row }, probe: same || ofPart ? probe : null });
    if (!same) this.timer = window.setTimeout(() => this.events.rest(picked, part), part ? 0 : REST_MILLISECONDS);
  }

  private turned(event: WheelEvent): void {
    if (!(this.events.dragging() || event.altKey)) return;
    if (!this.events.wheel(event.deltaY || event.deltaX)) return;
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
