import { describe, expect, it } from "vitest";

import { Pace, type Drawing } from "../../src/viewer/pace";
import { Rest, type Easel, type Stop } from "../../src/viewer/rest";

/** A canvas whose frames, pauses and bits come when the test says so. */
class FakeEasel implements Easel {
  revision = 0;
  time = 0;
  hasCoarse = true;
  readonly pixels = 900_000;
  /** Whether the whole is drawn as any frame is. */
  direct = false;
  /** What can be seen, and what was drawn beside it. */
  seen = "nothing";
  private sharp = true;
  private kept = "nothing";
  readonly pending = new Map<"frame" | "pause" | "bits", () => void>();

  key = () => (this.direct ? null : String(this.revision));
  now = () => this.time;
  atNextFrame = (run: () => void) => this.later("frame", run);
  after = (_: number, run: () => void) => this.later("pause", run);

  paint({ level, halvings }: Drawing): void {
    this.sharp = halvings === 0;
    this.seen = level === "full" && halvings === 0 ? `whole ${this.revision}` : `coarse ${this.revision}`;
  }

  keep(): void {
    this.sharp = true; // what is shown next is drawn at once
    this.kept = `whole ${this.revision}`;
  }

  compose(composed: () => void): Stop {
    expect(this.sharp, "a canvas that takes another size is empty").toBe(true);
    const begun = this.revision;
    return this.later("bits", () => {
      this.kept = `whole ${begun}`;
      composed();
    });
  }

  showKept(): void {
    this.seen = this.kept;
  }

  /** Have something that is under way happen; whether there was any. */
  step(what = [...this.pending.keys()].at(0)): boolean {
    const run = what && this.pending.get(what);
    if (!what || !run) return false;
    this.pending.delete(what);
    this.time += what === "pause" ? 200 : 17;
    run();
    return true;
  }

  settle(): void {
    for (let i = 0; this.step(); i++) if (i > 20) throw new Error("It never rests.");
  }

  private later(what: "frame" | "pause" | "bits", run: () => void): Stop {
    expect(this.pending.has(what), `two of ${what}`).toBe(false);
    this.pending.set(what, run);
    return () => {
      if (this.pending.get(what) === run) this.pending.delete(what);
    };
  }
}

/** A stage on which a processor draws, where the whole takes so long. */
function stage(milliseconds: number) {
  const [easel, pace] = [new FakeEasel(), new Pace(true)];
  for (let i = 0; i < 2; i++) pace.measured(milliseconds);
  const rest = new Rest(easel, pace);
  const change = () => {
    easel.revision++;
    rest.ask();
  };
  return { easel, rest, change };
}

describe("Rest", () => {
  it("goes from a change to a coarse picture, and beside that to the whole", () => {
    const { easel, rest, change } = stage(1000);
    change();
    const states = [rest.state];
    while (easel.step()) states.push(rest.state);
    expect(states).toEqual(["asked", "coarse", "composing", "whole"]);
    expect(easel.seen).toBe("whole 1");
  });

  it("draws the whole again from what was kept, and anew after a change under way", () => {
    const { easel, rest, change } = stage(1000);
    change();
    easel.settle();
    rest.ask();
    easel.step("frame");
    expect([rest.state, easel.seen]).toEqual(["whole", "whole 1"]);
    change();
    easel.step("frame");
    easel.step("pause");
    expect(rest.state).toBe("composing");
    change(); // undone, for instance, while the whole is being drawn
    easel.step("bits");
    expect(rest.state).toBe("asked");
    easel.settle();
    expect(easel.seen).toBe("whole 3");
  });

  it("draws anew what changed without a word while it was composed", () => {
    const { easel, change } = stage(1000);
    change();
    easel.step("frame");
    easel.step("pause");
    easel.revision++;
    easel.settle();
    expect(easel.seen).toBe("whole 2");
  });

  it("begins again with graphics that were lost", () => {
    const { easel, rest, change } = stage(1000);
    change();
    easel.step("frame");
    easel.step("pause");
    easel.pending.delete("bits"); // no answer ever comes
    expect(rest.state).toBe("composing");
    rest.renew();
    easel.settle();
    expect([rest.state, easel.seen]).toEqual(["whole", "whole 1"]);
  });

  it("goes on after a frame that failed", () => {
    const { easel, change } = stage(1000);
    const paint = easel.paint.bind(easel);
    easel.paint = () => {
      throw new Error("no memory");
    };
    change();
    expect(() => easel.step("frame")).toThrow("no memory");
    easel.paint = paint;
    change();
    easel.settle();
    expect(easel.seen).toBe("whole 2");
  });

  it.each([10, 100, 1000])("ends with the whole whatever happens in between, drawn in %i ms", (milliseconds) => {
    let seed = milliseconds;
    const random = (below: number) => {
      seed = (seed * 1103515245 + 12345) % 2147483648;
      return Math.floor((seed / 2147483648) * below);
    };
    for (let run = 0; run < 300; run++) {
      const { easel, rest, change } = stage(milliseconds);
      const events = [
        change,
        change,
        () => rest.ask(),
        () => rest.hold(true),
        () => rest.hold(false),
        () => rest.frame(false), // as where the page takes another size
        () => rest.drawWhole(),
        () => rest.renew(),
        () => (easel.direct = !easel.direct) || change(),
        () => easel.step("frame"),
        () => easel.step("pause"),
        () => easel.step("bits"),
      ];
      for (let i = 0; i < 40; i++) {
        events[random(events.length)]();
        const onItsWay = { whole: [], asked: ["frame"], coarse: ["pause"], composing: ["bits"] }[rest.state];
        expect([...easel.pending.keys()]).toEqual(expect.arrayContaining(onItsWay));
      }
      easel.settle();
      expect([rest.state, easel.seen]).toEqual(["whole", `whole ${easel.revision}`]);
    }
  });
});
