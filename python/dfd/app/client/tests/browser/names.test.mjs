// Names that are markup: of files, of poses, and in what is said of them. They are shown as they are written.
import assert from "node:assert/strict";
import { copyFile, mkdtemp, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";

import { hold, launch, open, openTab, PATIENCE, shot, state, until } from "./page.mjs";

const MARKUP = `"><img src=x onerror=alert(1)><svg onload=alert(2)>'&lt;{{7*7}}`;
const dialogs = [];
let browser, page, problems, folder;

before(async () => {
  browser = await launch();
  ({ page, problems } = await openTab(browser));
  page.on("dialog", (dialog) => {
    dialogs.push(dialog.message());
    return dialog.dismiss();
  });
  folder = await mkdtemp(join(process.env.DFD_OUT ?? tmpdir(), "names-"));
});

after(() => browser?.close());

/** Nothing was taken for markup: no element of it is there, and the page's policy had nothing to refuse. */
async function assertOnlyText() {
  assert.equal(await page.evaluate(() => document.querySelectorAll("[src=x], [onerror], [onload]").length), 0);
  assert.deepEqual(dialogs, []);
  assert.deepEqual(problems, []);
}

test("what a broken file is called is said as it is written", { timeout: PATIENCE }, async () => {
  const broken = join(folder, `broken ${MARKUP}.obj`);
  await writeFile(broken, `v 0 0 0\nf 1 2 ${MARKUP}\n`);
  const [chooser] = await Promise.all([page.waitForEvent("filechooser"), page.click(".drop")]);
  await chooser.setFiles(broken);
  await page.getByRole("alert").first().waitFor();
  assert.match(await page.getByRole("alert").first().innerText(), /onerror=alert/);
  await shot(page, "names-broken");
  await assertOnlyText();
});

test("so is what a shape is called", { timeout: PATIENCE }, async () => {
  const shape = join(folder, `${MARKUP}.glb`);
  const field = join(folder, `${MARKUP}.field.safetensors`);
  await copyFile(process.env.DFD_MESH, shape);
  await copyFile(process.env.DFD_FIELD, field);
  await page.reload();
  await until(page, (s) => s.page === "start");
  await open(page, [shape, field]);
  assert.match(await page.locator("h1.name").innerText(), /onerror=alert/);
  assert.match(await page.locator("h1.name").getAttribute("title"), /onerror=alert/);
  await shot(page, "names-shape");
  await assertOnlyText();
});

test("so is what a person calls a pose", { timeout: 2 * PATIENCE }, async () => {
  await until(page, (s) => s.edit?.field.status === "ready");
  await hold(page, null, 1);
  await page.keyboard.press("t");
  await page.keyboard.press("k");
  await until(page, (s) => s.edit.poses.length === 1);
  const name = page.getByLabel("Name of the pose");
  await name.fill(MARKUP);
  await name.press("Enter");
  await until(page, (s, wanted) => s.edit.poses[0].name === wanted, MARKUP);
  await page.getByRole("button", { name: `Remove ${MARKUP}` }).waitFor();
  assert.equal(await state(page, (s) => s.edit.poses.length), 1);
  await shot(page, "names-pose");
  await assertOnlyText();
});
