// The app keeps the edit: after the tab is closed, after another file is opened, and after the server stops.
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { mkdtemp, writeFile, readFile } from "node:fs/promises";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { after, before } from "node:test";

import {
  ALIKE,
  choose,
  drag,
  eventually,
  hold,
  launch,
  openTab,
  ready,
  shapeSentAgain,
  shot,
  state,
  test,
  until,
} from "./page.mjs";

let browser, server, url, port;
/** A data folder of its own, so that no other test changes the kept edits. */
const data = await mkdtemp(join(tmpdir(), "dfd-kept-"));

/** Start `dfd app` at the same port as before, and return its process. */
async function serve(...files) {
  const command = ["-m", "dfd", "app", ...files, "--no-browser", "--port", String(port)];
  const child = spawn(process.env.DFD_PYTHON, command, { env: { ...process.env, DFD_DATA: data } });
  for await (const line of createInterface(child.stdout)) {
    url = /http:\S+/.exec(line)?.[0];
    if (url) break;
  }
  return child;
}

async function stop() {
  server.kill("SIGTERM");
  await once(server, "exit");
}

before(async () => {
  const free = createServer().listen(0, "127.0.0.1");
  await once(free, "listening");
  ({ port } = free.address());
  free.close();
  browser = await launch();
  server = await serve(process.env.DFD_MESH, "--field", process.env.DFD_FIELD);
});

after(async () => {
  await browser?.close();
  server?.kill();
});

const translations = (page) => state(page, (s) => s.edit.handles.map(({ translation }) => translation));
const saved = (page) => until(page, (s) => s.saved && s.ahead.size === 0);

/** Open the address, move a handle, and wait until the page says “Saved”. Return the tab and the handle's motion. */
async function edited() {
  const tab = await openTab(browser, {}, url);
  await ready(tab.page);
  assert.equal(await state(tab.page, (s) => s.edit.step > 0), false);
  await hold(tab.page, ALIKE, 1);
  await drag(tab.page, [0, -50], -60);
  await saved(tab.page);
  return { ...tab, moved: await translations(tab.page) };
}

test("the edit is there when the same address is opened again", async () => {
  const first = await edited();
  assert.ok(Math.hypot(...first.moved[0]) > 0);
  await first.page.locator(".status .link", { hasText: "Saved" }).waitFor();
  await first.context.close();
  const second = await openTab(browser, {}, url);
  await until(second.page, (s) => s.edit?.handles.length === 1);
  assert.deepEqual(await translations(second.page), first.moved);

  // The server stops: the page says so at once. It goes on when the server is back, at the same address.
  const address = url;
  await stop();
  await second.page.getByRole("alertdialog", { name: "The server has stopped" }).waitFor();
  await shot(second.page, "stopped");
  await shapeSentAgain(second.page, async () => {
    server = await serve(process.env.DFD_MESH, "--field", process.env.DFD_FIELD);
    // The page also tries by itself, so the dialog may have gone.
    await second.page
      .getByRole("button", { name: "Try again" })
      .click({ timeout: 2000 })
      .catch(() => undefined);
  });
  assert.equal(url, address);
  await until(second.page, (s) => s.link === "open" && s.ended === null && s.edit?.handles.length === 1);
  assert.deepEqual(await translations(second.page), first.moved);

  // A second tab with the same mesh has a copy and says so.
  const third = await openTab(browser, {}, url);
  await until(third.page, (s) => s.edit?.handles.length === 1);
  await third.page.getByText("This shape is open in another tab. This tab edits a copy.").waitFor();
  await shot(third.page, "copy");
  await third.context.close();

  // Closing the shape and opening another file lose nothing.
  await choose(second.page, "File", "Close");
  const recent = second.page.getByRole("region", { name: "Recent" }).getByRole("button").first();
  await recent.waitFor();
  await shot(second.page, "recent");
  await recent.click();
  await until(second.page, (s) => s.edit?.handles.length === 1);
  assert.deepEqual(await translations(second.page), first.moved);
  const dropped = join(data, "other.obj");
  await writeFile(dropped, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n");
  const bytes = [...(await readFile(dropped))];
  await second.page.evaluate((content) => {
    const files = new window.DataTransfer();
    files.items.add(new window.File([new Uint8Array(content)], "other.obj"));
    window.dispatchEvent(new window.DragEvent("drop", { dataTransfer: files, cancelable: true }));
  }, bytes);
  await until(second.page, (s) => s.mesh?.name === "other.obj");
  await second.page.getByRole("button", { name: "File" }).click();
  await shot(second.page, "file_menu");
  const earlier = second.page.getByRole("menuitem", { name: "1 handle" });
  await eventually(async () => assert.equal(await earlier.count(), 1));
  await earlier.click();
  await until(second.page, (s) => s.edit?.handles.length === 1);
  assert.deepEqual(await translations(second.page), first.moved);
});
