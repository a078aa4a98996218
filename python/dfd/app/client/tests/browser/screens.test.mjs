// Save pictures of every look in three window sizes and themes, for people to inspect. A blank canvas fails the test.
import assert from "node:assert/strict";

import { ALIKE, drawn, hold, openShape, shot, story, test, until } from "./page.mjs";

const SIZES = [
  { width: 1280, height: 800 },
  { width: 800, height: 600 },
  { width: 390, height: 844 },
];

let page;
story((tab) => ({ page } = tab), { shape: false, viewport: SIZES[0] });

/** Show the page in a size and a theme. Return the beginning of the names of its pictures. */
async function resize(viewport, colorScheme) {
  await page.setViewportSize(viewport);
  await page.emulateMedia({ colorScheme });
  await page.waitForTimeout(300);
  return `${viewport.width}x${viewport.height}-${colorScheme}`;
}

const LOOKS = SIZES.flatMap((viewport) => ["light", "dark"].map((scheme) => [viewport, scheme]));

test("pictures of every size and theme", async () => {
  for (const [viewport, scheme] of LOOKS) {
    const size = await resize(viewport, scheme);
    await shot(page, `${size}-start`);
  }
  await resize(SIZES[0], "light");
  await openShape(page);
  await hold(page, ALIKE, 1);
  await until(page, (s) => s.similar !== null && s.similar.places.length > 1);
  for (const [viewport, scheme] of LOOKS) {
    const size = await resize(viewport, scheme);
    await page.mouse.move(4, viewport.height - 4);
    await page.evaluate(() => window.dfd.store.set({ wireframe: false, timeline: false }));
    for (const look of ["texture", "clay", "features", "heat"]) {
      await page.evaluate((name) => window.dfd.store.set({ look: name }), look);
      await page.waitForTimeout(300);
      const seen = await drawn(page);
      assert.ok(seen.covered > 0.03 && seen.shades > 50, `${look} is blank: ${JSON.stringify(seen)}`);
      await shot(page, `${size}-${look}`);
    }
    await page.evaluate(() => window.dfd.store.set({ look: "clay", wireframe: true, timeline: true }));
    await page.waitForTimeout(500);
    await shot(page, `${size}-wireframe`);
    await page.keyboard.press("?");
    await page.waitForTimeout(300);
    await shot(page, `${size}-keys`);
    await page.keyboard.press("Escape");
  }
});
