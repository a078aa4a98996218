// Play gestures, and count the clicks on proposals until the part is right; see `__main__.py`. The task is read from
// standard input, and the counts are printed as JSON.
import { readFileSync } from "node:fs";

import { launch, openTab, ready, state, until } from "../../python/dfd/app/client/tests/browser/page.mjs";

const { area, gestures, good } = JSON.parse(readFileSync(0, "utf8"));
const FOLLOWERS = ["all", "mirror", "none"];
const BETTER = 0.01; // an IoU is better if it is larger by more than this

const browser = await launch();
const { page } = await openTab(browser);
await ready(page);
await until(page, (s) => s.edit.field.parts.length > 0 && s.edit.field.origin !== "geometry");

const sum = (vertices) => vertices.reduce((total, vertex) => total + area[vertex], 0);

/** Return the IoU of the vertices that follow with these controls, with the set that is nearest. */
async function iou(meant, controls) {
  const held = await page.evaluate((given) => window.dfd.following(given), controls);
  const inside = new Set(held);
  return Math.max(
    ...meant.map((set) => {
      const both = sum(set.filter((vertex) => inside.has(vertex)));
      return both / (sum(held) + sum(set) - both);
    }),
  );
}

/** Move the new handle a little, as a user does, and wait for proposals. Without any, null is returned after 5 s. */
async function proposals() {
  for (let i = 0; i < 100; i++) {
    const found = await state(page, (s) => (s.ahead.size === 0 ? s.proposals?.choices : null));
    if (found) return found.map(({ controls }) => controls);
    await page.waitForTimeout(50);
  }
  return [];
}

const found = [];
for (const { vertex, meant } of gestures) {
  await page.evaluate((at) => window.dfd.ask({ type: "add", at }), vertex);
  await until(page, (s) => s.edit.handles.length === 1 && s.selected !== null);
  const size = await state(page, (s) => s.mesh.diagonal);
  await page.keyboard.type(`gy${(0.05 * size).toFixed(4)}`);
  await page.keyboard.press("Enter");
  await until(page, (s) => s.edit.handles[0].moved && !s.dragging);
  const before = await iou(meant, {});
  let [now, clicks] = [before, 0];
  while (now < good) {
    const choices = await proposals();
    const values = [];
    for (const controls of choices) values.push(await iou(meant, controls));
    const best = values.indexOf(Math.max(...values));
    if (choices.length === 0 || values[best] <= now + BETTER) break;
    await page.evaluate(() => (window.before = window.dfd.store.get().proposals));
    await page.getByRole("region", { name: "Proposals" }).getByRole("button").nth(best).click();
    await until(page, (s) => s.proposals !== window.before);
    clicks++;
    now = await iou(meant, {});
  }
  const { origin } = await state(page, (s) => s.edit.handles[0]);
  const ladder = await until(page, (s, at) => s.ladders.get(at)?.steps, origin);
  let best = now;
  for (const { level } of ladder)
    for (const follow of FOLLOWERS) best = Math.max(best, await iou(meant, { level, follow }));
  found.push({ before, clicks, after: now, best });
  await page.evaluate(() => window.dfd.ask({ type: "clear" }));
  await until(page, (s) => s.edit.handles.length === 0);
}
await browser.close();
console.log(JSON.stringify(found));
