// Pictures of every look, size and theme, to be looked at; a blank one fails.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { alive, drawn, launch, learn, openTab, PATIENCE, shot, state, until, visibleVertex } from "./page.mjs";

const SIZES = [
  { width: 1440, height: 900 },
  { width: 800, height: 600 },
];
let browser;

before(async () => {
  browser = await launch();
});

after(() => browser?.close());

for (const viewport of SIZES) {
  for (const colorScheme of ["light", "dark"]) {
    const size = `${viewport.width}x${viewport.height}-${colorScheme}`;
    test(`looks at ${size}`, { timeout: 4 * PATIENCE }, async () => {
      const { context, page, problems } = await openTab(browser, { viewport, colorScheme });
      if ((await state(page, (s) => s.page)) === "start") {
        await shot(page, `${size}-start`);
        const [chooser] = await Promise.all([page.waitForEvent("filechooser"), page.click(".drop")]);
        await chooser.setFiles(process.env.DFD_MESH);
        await until(page, (s) => s.page === "shape" && s.edit);
      }
      await shot(page, `${size}-opened`);
      await learn(page);
      await alive(page);
      const { at } = await visibleVertex(page);
      await page.mouse.click(...at);
      await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
      await page.mouse.move(4, viewport.height - 4);
      for (const look of ["texture", "clay", "features", "heat"]) {
        await page.evaluate((name) => window.dfd.store.set({ look: name }), look);
        await page.waitForTimeout(800);
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
