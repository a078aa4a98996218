/** Sliders under way: told in passing, and one gesture is one step of undo. */

/** Often enough to follow a hand, seldom enough for any line. */
const INTERVAL = 80;
/** What follows later than this is another gesture. */
const GESTURE = 1000;

interface Gesture {
  timer: number;
  told: number;
  send: (merge: boolean) => void;
}

const gestures = new Map<string, Gesture>();

/** Send the newest of what a slider says; `merge` tells whether it goes on with what was sent before of this `key`. */
export function gently(key: string, send: (merge: boolean) => void): void {
  const known = gestures.get(key) ?? { timer: 0, told: -Infinity, send };
  gestures.set(key, known);
  known.send = send;
  if (known.timer !== 0) return;
  known.timer = window.setTimeout(() => {
    const now = performance.now();
    const merge = now - known.told < GESTURE;
    known.timer = 0;
    known.told = now;
    known.send(merge);
  }, INTERVAL);
}
