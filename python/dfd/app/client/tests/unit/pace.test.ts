import { describe, expect, it } from "vitest";

import { COARSE, Pace, WHOLE, type Drawing } from "../../src/viewer/pace";

const PIXELS = 900_000;

/** A page whose frames take as long as `cost` says, frame after frame. */
class Page {
  now = 0;

  constructor(
    readonly pace: Pace,
    readonly cost: (drawing: Drawing) => number,
    readonly hasCoarse = true,
  ) {}

  /** What each of `count` frames of a movement is. */
  move(count: number): Drawing[] {
    const shown: Drawing[] = [];
    for (let i = 0; i < count; i++) {
      const drawing = this.pace.next(this.now, true, this.hasCoarse, PIXELS);
      shown.push(drawing);
      this.now += Math.max(this.cost(drawing), 16.7);
    }
    return shown;
  }

  /** The movement ends, and the whole is drawn and timed. */
  rest(): Drawing {
    this.pace.rest();
    this.now += 1000;
    const drawing = this.pace.next(this.now, false, this.hasCoarse, PIXELS);
    this.pace.measured(this.cost(WHOLE));
    return drawing;
  }
}

const levels = (shown: Drawing[]) => shown.map(({ level }) => level);

describe("Pace", () => {
  it("never lowers anything where the whole is drawn at the screen's rate", () => {
    const page = new Page(new Pace(false), () => 5);
    for (let i = 0; i < 5; i++) {
      expect(page.move(100).every((drawing) => drawing.level === "full" && drawing.halvings === 0)).toBe(true);
      expect(page.rest()).toBe(WHOLE);
    }
  });

  it("is not misled by single frames that were held up", () => {
    let count = 0;
    const page = new Page(new Pace(false), () => (++count % 20 === 7 ? 900 : 6));
    expect(levels(page.move(200))).not.toContain("coarse");
    const pace = new Pace(false);
    pace.measured(600);
    pace.measured(6);
    pace.measured(600);
    expect(pace.next(0, true, true, PIXELS).level).toBe("full");
  });

  it("takes the coarse level after some slow frames, keeps it, and the pixels with it", () => {
    const page = new Page(new Pace(false), ({ level }) => (level === "full" ? 120 : 10));
    const shown = page.move(60);
    const first = levels(shown).indexOf("coarse");
    expect(first).toBeGreaterThan(1);
    expect(first).toBeLessThan(8);
    expect(levels(shown.slice(first))).not.toContain("full");
    expect(shown.every(({ halvings }) => halvings === 0)).toBe(true);
    page.rest();
    expect(levels(page.move(30))).not.toContain("full");
  });

  it("gives pixels away only where the coarse level is slow too, or there is none", () => {
    const slow = new Page(new Pace(false), ({ level, halvings }) => (level === "full" ? 400 : 160 / 2 ** halvings));
    const shown = slow.move(60);
    expect(shown.at(-1)).toEqual({ level: "coarse", halvings: 2 });
    slow.rest();
    expect(slow.move(1)[0], "the next movement begins where this one ended").toEqual({ level: "coarse", halvings: 2 });
    const plain = new Page(new Pace(false), ({ halvings }) => 160 / 2 ** halvings, false);
    expect(plain.move(60).at(-1)).toEqual({ level: "full", halvings: 2 });
  });

  it("does not flicker where the whole takes about as long as it may", () => {
    const page = new Page(new Pace(false), ({ level }) => (level === "full" ? 45 : 10));
    const shown: string[] = [];
    for (let i = 0; i < 10; i++) {
      shown.push(...levels(page.move(30)));
      page.rest();
    }
    const changes = shown.filter((level, i) => i > 0 && level !== shown[i - 1]).length;
    expect(changes).toBe(0);
  });

  it("takes a processor for slow until the whole was measured to be fast", () => {
    const pace = new Pace(true);
    expect(pace.next(0, true, true, PIXELS)).toEqual({ level: "coarse", halvings: 2 });
    pace.rest();
    expect(pace.next(1000, false, true, PIXELS)).toBe(COARSE);
    pace.measured(100);
    expect(pace.next(2000, false, true, PIXELS), "at rest the whole is drawn at once").toBe(WHOLE);
    expect(pace.next(3000, true, true, PIXELS).level).toBe("coarse");
    pace.measured(10);
    expect(pace.next(4000, true, true, PIXELS).level).toBe("full");
    pace.forget();
    expect(pace.next(5000, true, true, PIXELS).level, "another shape is another matter").toBe("coarse");
  });

  it("leaves what takes long to the rest", () => {
    const pace = new Pace(true);
    pace.measured(1500);
    expect(pace.next(0, false, true, PIXELS)).toBe(COARSE);
    expect(pace.next(1000, false, false, PIXELS), "but shows what there is").toBe(WHOLE);
  });

  it("lowers nothing where full quality is wanted", () => {
    const page = new Page(new Pace(true), () => 500);
    page.pace.quality = "full";
    expect(page.move(30).every((drawing) => drawing === WHOLE)).toBe(true);
    expect(page.rest()).toBe(WHOLE);
  });
});
