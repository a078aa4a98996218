/** How finely the next frame is drawn: decided from how long frames took, never from how large a shape is. */

import type { Level, Quality } from "../store/state";

export interface Drawing {
  readonly level: Level;
  /** How often the number of pixels is halved. */
  readonly halvings: number;
}

export const WHOLE: Drawing = { level: "full", halvings: 0 };
export const COARSE: Drawing = { level: "coarse", halvings: 0 };

/** Milliseconds that a frame of a movement may take. */
const SLOW = 50;
/** What takes less than this at rest is also drawn while something moves. */
const FAST = 25;
/** What takes longer is drawn in bits, when the page rests. */
const LONG = 250;
/** How much the newest frame counts against those before. */
const NEWEST_WEIGHT = 0.3;
const MOST_HALVINGS = 3;
const PROCESSORS_PIXELS = 160_000;

export class Pace {
  quality: Quality = "auto";
  /** Milliseconds that the newest whole drawing took. */
  wholeTime: number | null = null;
  private slow: boolean;
  private slowDrawings = 0;
  private begun = -Infinity;
  private slowness = 0;
  private moving = false;
  private halvings = 0;
  /** How many halvings the newest movement needed. */
  private usual: number | null;

  /** `software` is what is assumed until something was measured: that a processor draws. */
  constructor(private readonly software: boolean) {
    this.slow = software;
    this.usual = software ? null : 0;
  }

  /** Another shape is shown. */
  forget(): void {
    this.wholeTime = null;
    this.slow = this.software;
    this.slowDrawings = 0;
  }

  /** Whether the whole is known to take no longer than a person waits without noticing. */
  get short(): boolean {
    return this.wholeTime !== null && this.wholeTime < LONG;
  }

  /** What is drawn now; `moves` tells whether the frame goes on with a movement, `pixels` how many the view has. */
  next(now: number, moves: boolean, hasCoarse: boolean, pixels: number): Drawing {
    const gone = now - this.begun;
    this.begun = now;
    if (this.quality === "full") return WHOLE;
    if (!moves) {
      this.moving = false;
      return this.slow && hasCoarse && !this.short ? COARSE : WHOLE;
    }
    if (!this.moving) {
      this.moving = true;
      this.slowness = 0;
      this.halvings = this.usual ?? usualHalvings(pixels);
    } else {
      // One that was held up, by the page or by another program, says little.
      this.slowness += NEWEST_WEIGHT * (Math.min(gone, 2 * SLOW) - this.slowness);
      if (this.slowness > SLOW) this.ease(hasCoarse);
    }
    return { level: this.slow && hasCoarse ? "coarse" : "full", halvings: this.halvings };
  }

  /** The movement has ended. */
  rest(): void {
    if (!this.moving) return;
    this.moving = false;
    // One that was easy may be finer next time.
    this.usual = Math.max(this.halvings - (this.slowness < SLOW / 2 ? 1 : 0), 0);
  }

  /** A whole drawing took so many milliseconds; one alone may have waited for something else. */
  measured(milliseconds: number): void {
    this.wholeTime = milliseconds;
    this.slowDrawings = milliseconds > SLOW ? this.slowDrawings + 1 : 0;
    if (milliseconds < FAST) this.slow = false;
    else if (this.slowDrawings > 1) this.slow = true;
  }

  /** Fewer faces first, then fewer pixels. */
  private ease(hasCoarse: boolean): void {
    this.slowness = 0;
    if (hasCoarse && !this.slow) this.slow = true;
    else this.halvings = Math.min(this.halvings + 1, MOST_HALVINGS);
  }
}

/** As many as leave what a processor is likely to draw. */
function usualHalvings(pixels: number): number {
  return Math.min(Math.max(Math.round(Math.log2(pixels / PROCESSORS_PIXELS)), 0), MOST_HALVINGS);
}
