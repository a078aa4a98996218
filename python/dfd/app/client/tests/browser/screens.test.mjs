// Save pictures of every look in three window sizes and themes, for people to inspect. A blank canvas fails the test.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { drawn, hold, launch, openShape, openTab, PATIENCE, shot, until } from "./page.mjs";

const SIZES = [
  { width: 1280, height: 800 },
  { width: 800, height: 600 },
  { width: 390, height: 844 },
];
let browser;

before(async () => {
  browser = await launch();
});

after(() => browser?.close());

for (const viewport of SIZES) {
  for (const colorScheme of ["light", "dark"]) {
    const size = `${viewport.width}x${viewport.height}-${colorScheme}`;
    test(`pictures at ${size}`, { timeout: 2 * PATIENCE }, async () => {
      const { context, page, problems } = await openTab(browser, { viewport, colorScheme });
      await shot(page, `${size}-start`);
      await openShape(page);
      await hold(page, JSON.parse(process.env.DFD_ALIKE), 1);
      await until(page, (s) => s.similar !== null && s.similar.places.length > 1);
      await page.mouse.move(4, viewport.height - 4);
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
      assert.deepEqual(problems, []);
      await context.close();
    });
  }
}
