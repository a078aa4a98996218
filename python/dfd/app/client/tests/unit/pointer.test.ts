import { afterEach, beforeEach, expect, it, vi } from "vitest";

import { Pointer, type PointerEvents } from "../../src/viewer/pointer";

type Listener = (event: object) => void;

/** What the listeners of one element hear. */
class FakeTarget {
  private readonly listeners = new Map<string, Listener[]>();
  addEventListener = (type: string, listener: Listener) =>
    this.listeners.set(type, [...(this.listeners.get(type) ?? []), listener]);
  say = (type: string, event: object) => this.listeners.get(type)?.forEach((listener) => listener({ type, ...event }));
}

const page = new FakeTarget();
const canvas = Object.assign(new FakeTarget(), { getBoundingClientRect: () => ({ left: 0, top: 0 }), dataset: {} });
const move = { clientX: 5, clientY: 5, buttons: 0, altKey: false };
const alt = { key: "Alt", repeat: false, preventDefault: () => undefined };
const frames: (() => void)[] = [];
const rest = vi.fn<PointerEvents["rest"]>();

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("window", globalThis);
  vi.stubGlobal("addEventListener", page.addEventListener);
  vi.stubGlobal("requestAnimationFrame", (run: () => void) => frames.push(run));
});
afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("shows the part where Alt is pressed between a move of the pointer and its frame", () => {
  const pick = () => ({ vertex: 3, row: 3 }) as ReturnType<PointerEvents["pick"]>;
  const events = { busy: () => false, dragging: () => false, pick, rest } as unknown as PointerEvents;
  new Pointer(canvas as unknown as HTMLCanvasElement, events);
  const pass = () => {
    frames.splice(0).forEach((run) => run());
    vi.runAllTimers();
    return rest.mock.lastCall?.[1];
  };

  canvas.say("pointermove", move);
  expect(pass()).toBe(false);
  canvas.say("pointermove", move);
  page.say("keydown", alt);
  expect(pass()).toBe(true);
  canvas.say("pointermove", { ...move, altKey: true });
  page.say("keyup", alt);
  expect(pass()).toBe(false);
});
