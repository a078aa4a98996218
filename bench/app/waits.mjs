// Time the steps of a user on a sample; see `__main__.py`. The sample's name is read from standard input, and the times
// are printed as JSON.
import { readFileSync } from "node:fs";

import { launch, openTab, until, visibleVertex } from "../../python/dfd/app/client/tests/browser/page.mjs";

const sample = JSON.parse(readFileSync(0, "utf8"));
const browser = await launch();
const { page } = await openTab(browser);
const found = [];

/**
 * Do something with the pointer or the keys, and record the milliseconds from the first event in the page until a sign
 * (a bar, the word "Working…", or what `sign` finds in the state), and until `done` is true of the state.
 */
async function step(name, act, done, sign = () => false) {
  await page.evaluate(`(${record})(${done}, ${sign})`);
  const acting = act();
  await page.waitForFunction(() => window.times.done !== null);
  await acting;
  await page.waitForTimeout(400);
  found.push({ step: name, ...(await page.evaluate(() => window.times)) });
}

/** Record the times of a step in `window.times`. Runs in the page. */
function record(done, sign) {
  const times = { began: null, sign: null, drawn: null, done: null, task: 0 };
  const begin = (event) => (times.began ??= event.timeStamp);
  const kinds = ["pointerdown", "pointermove", "keydown"];
  kinds.forEach((kind) => window.addEventListener(kind, begin, { capture: true }));
  const tasks = new window.PerformanceObserver((list) => {
    for (const { duration } of list.getEntries()) times.task = Math.max(times.task, duration);
  });
  tasks.observe({ type: "longtask" });
  const look = () => {
    const s = window.dfd.store.get();
    const over = times.began !== null && done(s);
    const now = performance.now() - times.began;
    if (times.began !== null && (over || s.busy || s.progress || sign(s))) times.sign ??= now;
    if (s.drawn) times.drawn ??= now;
    if (!over) setTimeout(look, 4);
    else {
      times.done = now;
      kinds.forEach((kind) => window.removeEventListener(kind, begin, { capture: true }));
      setTimeout(() => tasks.disconnect(), 100);
    }
  };
  look();
  window.times = times;
}

const title = sample[0].toUpperCase() + sample.slice(1);
const press = (name) => page.getByRole("button", { name, exact: true }).click();
await step(
  "open, until the first color",
  async () => {
    await page.getByRole("region", { name: "Samples" }).getByRole("button", { name: title }).click();
    await until(page, (s) => s.drawn);
    const { at } = await visibleVertex(page);
    for (let i = 0; !(await page.evaluate(() => window.times.done)); i++) {
      await page.mouse.move(at[0] + (i % 2), at[1]);
      await page.waitForTimeout(150);
    }
  },
  (s) => s.probe !== null,
);
const { drawn, sign, task } = found[0];
found.unshift({ step: "open, until it is drawn", sign, done: drawn, task });

const { at } = await visibleVertex(page);
await step(
  "point, until the color",
  () => page.mouse.move(...at),
  (s) => s.probe !== null,
);
await step(
  "click, until the colors of the handle",
  () => page.mouse.click(...at),
  (s) => s.edit.handles.length === 1 && s.edit.handles[0].columns.every(({ column }) => s.columns.has(column)),
);
await step(
  "type a motion",
  () => page.keyboard.type("gy0.05"),
  (s) => s.edit.handles[0].moved || s.ahead.get(s.selected)?.transform?.translation[1] === 0.05,
  (s) => s.typed !== null,
);
await step(
  "keep it, until the report",
  () => page.keyboard.press("Enter"),
  (s) => s.edit.handles[0].moved && s.report !== null && s.ahead.size === 0,
  (s) => s.ahead.size > 0,
);
await step(
  "smaller part",
  () => page.keyboard.press("["),
  (s) => s.edit.steps.length > 2,
);
await step(
  "only this one",
  () => press("Only this"),
  (s) => s.edit.handles[0].follow === "none",
);
await step(
  "bend",
  () => press("Bend"),
  (s) => s.gizmo === "bend" && s.axis !== null,
);
await step(
  "suggest handles",
  () => press("Suggest handles"),
  (s) => s.suggestions.length > 0,
);
await step(
  "colors of the features",
  () => press("Features"),
  (s) => s.featureColors !== null,
);
await step(
  "undo",
  () => press("Undo"),
  (s) => s.edit.can_redo,
);
await browser.close();
console.log(JSON.stringify(found));
