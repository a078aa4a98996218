/**
 * From a change to the whole picture of it. In every state but "whole" one thing is under way that leads on, and a state
 * that is left calls its own off: no picture at rest is coarse, and none is missing.
 *
 *     any ── ask ──► asked ── frame ──► whole, coarse or composing
 *     coarse ── pause ──► whole or composing
 *     composing ── composed ──► whole
 */

import { COARSE, type Pace, WHOLE, type Drawing } from "./pace";

/** Milliseconds: a frame that is asked for this soon after another goes on with its movement. */
const SOON = 100;
/** Milliseconds without a new frame, after which nothing moves, and the same while somebody holds on. */
const STILL = 150;
const HELD = 400;

/** Calls off what was begun. */
export type Stop = () => void;

/** What draws, and tells when. */
export interface Easel {
  /** What the whole looks like, as a text; null where the whole is drawn as any frame is. */
  key(): string | null;
  readonly hasCoarse: boolean;
  readonly pixels: number;
  now(): number;
  atNextFrame(run: () => void): Stop;
  after(milliseconds: number, run: () => void): Stop;
  /** Draw on the canvas. */
  paint(drawing: Drawing): void;
  /** Draw the whole at once, and keep it. */
  keep(): void;
  /** Draw the whole bit by bit beside what is seen; `composed` is called unless the graphics are lost. */
  compose(composed: () => void): Stop;
  /** Draw what was kept or composed on the canvas. */
  showKept(): void;
}

export class Rest {
  state: "whole" | "asked" | "coarse" | "composing" = "whole";
  /** Whether somebody has hold of the camera or a handle. */
  private held = false;
  private kept: string | null = null;
  private composition: { readonly key: string; readonly stop: Stop } | null = null;
  private leave: Stop = nothing;
  private asked = 0;
  private ended = 0;
  /** The newest that was drawn. */
  private seen: Drawing | null = null;

  constructor(
    private readonly easel: Easel,
    private readonly pace: Pace,
  ) {}

  /** Something looks another way: draw it at the screen's next frame. */
  ask(): void {
    if (this.state === "asked") return;
    this.asked = this.easel.now();
    this.enter(
      "asked",
      this.easel.atNextFrame(() => this.frame()),
    );
  }

  /** Draw now what has been asked for. */
  frame(moves = this.held || this.asked - this.ended < SOON): void {
    this.enter("whole");
    const key = this.easel.key();
    if (key !== null && key === this.kept) {
      this.showKept();
      return;
    }
    if (this.composition?.key !== key) this.forget();
    const drawing = this.pace.next(this.easel.now(), moves, this.easel.hasCoarse, this.easel.pixels);
    this.seen = null;
    if (drawing === WHOLE) this.settle();
    else this.drawCoarse(drawing);
  }

  /** Draw the whole now, however long that takes. */
  drawWhole(): void {
    this.enter("whole");
    this.draw(WHOLE);
  }

  hold(on: boolean): void {
    this.held = on;
    if (!on && this.state === "coarse") this.pause();
  }

  /** What was kept is gone, as with graphics that were lost. */
  renew(): void {
    this.forget();
    this.ask();
  }

  private enter(state: Rest["state"], leave: Stop = nothing): void {
    this.leave();
    this.state = state;
    this.leave = leave;
  }

  private draw(drawing: Drawing): void {
    this.easel.paint(drawing);
    this.seen = drawing;
    this.ended = this.easel.now();
  }

  private showKept(): void {
    this.easel.showKept();
    this.ended = this.easel.now();
  }

  private drawCoarse(drawing: Drawing): void {
    this.draw(drawing);
    // Of a coarser picture of the same the whole is on its way already.
    if (this.composition) this.enter("composing");
    else if (drawing.level !== "full" || drawing.halvings > 0) this.pause();
  }

  /** Draw the whole unless something moves soon. */
  private pause(): void {
    this.enter("whole");
    const stop = this.easel.after(this.held ? HELD : STILL, () => {
      this.pace.rest();
      this.settle();
    });
    this.enter("coarse", stop);
  }

  /** Draw the whole, at once or as soon as it can be had without keeping anybody waiting. */
  private settle(): void {
    this.enter("whole");
    const key = this.easel.key();
    if (key === null) {
      this.draw(WHOLE);
      return;
    }
    if (this.pace.short) {
      this.forget();
      this.easel.keep();
      this.kept = key;
      this.showKept();
      return;
    }
    if (this.seen?.level !== "coarse" || this.seen.halvings > 0) this.draw(COARSE);
    this.enter("composing");
    if (this.composition?.key === key) return;
    this.forget();
    const stop = this.easel.compose(() => {
      this.composition = null;
      this.kept = key;
      this.pace.rest();
      // What was asked for meanwhile is drawn by its own frame.
      if (this.state === "composing") this.frame(false);
    });
    this.composition = { key, stop };
  }

  private forget(): void {
    this.composition?.stop();
    this.composition = null;
    this.kept = null;
  }
}

function nothing(): void {
  // There is nothing to call off.
}
