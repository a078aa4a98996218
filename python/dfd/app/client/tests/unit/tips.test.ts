import { readdirSync } from "node:fs";
import { describe, expect, it } from "vitest";

import { CAPTIONS, hasTip } from "../../src/widgets/tips";

describe("the strips of tooltips", () => {
  it("are there for every control that has captions, and for no other", () => {
    const drawn = readdirSync(new URL("../../public/tips", import.meta.url)).map((file) => file.replace(/\.webp$/, ""));
    expect(drawn.sort()).toEqual(Object.keys(CAPTIONS).sort());
    expect(drawn.every(hasTip)).toBe(true);
  });
});
