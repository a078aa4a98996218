// The page in a browser, timed from within. From the environment, besides what `page.mjs` of the tests reads: DFD_GL,
// "swiftshader" or "gl" (llvmpipe, where there is a display); DFD_DRAG, whether to measure frames. Prints JSON.
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const client = process.env.DFD_CLIENT;
const from = (path) => import(pathToFileURL(join(client, path)).href);
const { chromium } = await from("node_modules/playwright-core/index.mjs");
const { alive, openTab, until, visibleVertex } = await from("tests/browser/page.mjs");

const SECONDS = 4;
const CLICKS = 5;
const software = process.env.DFD_GL !== "gl";
const args = ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"];
args.push(
  ...(software
    ? ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    : ["--use-angle=gl", "--ignore-gpu-blocklist"]),
);
const browser = await chromium.launch({ executablePath: process.env.DFD_CHROMIUM, args, headless: software });

/** A context that notes when the page's messages come. */
const noting = {
  newContext: async (options) => {
    const context = await browser.newContext(options);
    await context.addInitScript(() => {
      window.heard = [];
      const told = Object.getOwnPropertyDescriptor(WebSocket.prototype, "onmessage");
      Object.defineProperty(WebSocket.prototype, "onmessage", {
        set(listener) {
          told.set.call(this, (event) => {
            const { data } = event;
            const text = typeof data === "string" ? data : new TextDecoder().decode(new Uint8Array(data, 4, 200));
            window.heard.push({ at: performance.now(), text: text.slice(0, 200) });
            listener.call(this, event);
          });
        },
      });
    });
    return context;
  },
};

/** The processes of this browser, with their kind. */
function processes() {
  const parent = new Map();
  const kind = new Map();
  for (const pid of readdirSync("/proc").filter((name) => /^\d+$/.test(name))) {
    try {
      const stat = readFileSync(`/proc/${pid}/stat`, "utf8");
      parent.set(Number(pid), Number(stat.slice(stat.lastIndexOf(")") + 2).split(" ")[1]));
      kind.set(Number(pid), /--type=([\w-]+)/.exec(readFileSync(`/proc/${pid}/cmdline`, "utf8"))?.[1] ?? "browser");
    } catch {
      // It has ended.
    }
  }
  const ours = (pid) => pid === process.pid || (pid > 1 && parent.has(pid) && ours(parent.get(pid)));
  return [...kind].filter(([pid]) => pid !== process.pid && ours(pid));
}

/** Seconds of processor time by kind of process. */
function processorTime() {
  const total = {};
  for (const [pid, kind] of processes()) {
    try {
      const stat = readFileSync(`/proc/${pid}/stat`, "utf8");
      const fields = stat.slice(stat.lastIndexOf(")") + 2).split(" ");
      total[kind] = (total[kind] ?? 0) + (Number(fields[11]) + Number(fields[12])) / 100;
    } catch {
      // It has ended.
    }
  }
  return total;
}

/** Resident megabytes of the tab's process and of the one that draws. */
function memory() {
  const found = {};
  for (const [pid, kind] of processes()) {
    if (kind !== "renderer" && kind !== "gpu-process") continue;
    const size = /^Rss:\s+(\d+)/m.exec(readFileSync(`/proc/${pid}/smaps_rollup`, "utf8"))?.[1] ?? 0;
    found[kind] = Math.max(found[kind] ?? 0, Number(size) / 1024);
  }
  return found;
}

const empty = memory();
const { context, page } = await openTab(noting, {});
const result = { load: Number(readFileSync("/proc/loadavg", "utf8").split(" ")[0]) };
await until(page, (s) => s.mesh !== null);
/** Wait until what was asked of the graphics is drawn: Chromium's `finish` only sends it. */
await page.evaluate(() => {
  window.pixels = () => {
    const gl = document.querySelector("canvas").getContext("webgl2");
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  };
  const opened = window.heard.find(({ text }) => text.includes('"open"') && text.includes('"done"'));
  // A small shape may be there before the page is.
  window.since = () => performance.now() - (opened ?? window.heard[0]).at;
});
[result.shown, result.answered] = await page.evaluate(async () => {
  await new Promise(requestAnimationFrame); // the shape's first frame was asked for before
  window.pixels();
  const shown = window.since();
  window.dfd.pick(innerWidth / 2, innerHeight / 2);
  return [shown, window.since()];
});
await alive(page);
await until(page, (s) => s.seen === "full");
result.whole = await page.evaluate(() => {
  window.pixels();
  return window.since();
});

/** From a click to its heat map: until its column is there, and until it is drawn. */
async function click() {
  const { at } = await visibleVertex(page);
  await page.evaluate(() => {
    window.click = new Promise((resolve) => {
      const count = window.dfd.store.get().edit.handles.length;
      let begun = 0;
      document
        .querySelector("canvas")
        .addEventListener("pointerup", () => (begun = performance.now()), { once: true, capture: true });
      const stop = window.dfd.store.watch(
        (s) => s.edit.handles.length > count && s.columns.has(s.edit.handles.at(-1).column),
        () => {
          stop();
          const there = performance.now();
          requestAnimationFrame(() => {
            window.dfd.drawNext();
            window.pixels();
            resolve({ there: there - begun, drawn: performance.now() - begun });
          });
        },
      );
    });
  });
  await page.mouse.click(...at);
  const took = await page.evaluate(() => window.click);
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.handles.length === 0);
  await page.waitForTimeout(1500);
  return took;
}

if (process.env.DFD_DRAG === "yes") {
  const cdp = await context.newCDPSession(page);
  await cdp.send("Network.enable");
  let bytes = 0;
  cdp.on("Network.webSocketFrameSent", ({ response }) => (bytes += response.payloadData.length));
  cdp.on("Network.webSocketFrameReceived", ({ response }) => (bytes += response.payloadData.length));
  const frames = async () => {
    const before = processorTime();
    const fps = await page.evaluate((seconds) => window.dfd.framesPerSecond(seconds), SECONDS);
    const after = processorTime();
    const spent = Object.keys(after).reduce((sum, kind) => sum + after[kind] - (before[kind] ?? 0), 0);
    return { fps, milliseconds: (1000 * spent) / (fps * SECONDS) };
  };
  await page.evaluate(() => window.dfd.store.set({ look: "clay" }));
  await frames();
  result.rest = await frames();
  const { at, vertex } = await visibleVertex(page);
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
  await page.waitForTimeout(3000);
  const [x, y] = await page.evaluate((wanted) => window.dfd.project(wanted), vertex);
  await page.mouse.move(x, y - 46);
  await page.mouse.move(x, y - 50);
  await page.waitForTimeout(300);
  await page.mouse.down();
  let dragging = true;
  const pulling = (async () => {
    for (let i = 0; dragging; i++) await page.mouse.move(x, y - 70 - 40 * Math.sin(i / 9));
  })();
  await page.waitForTimeout(1500); // compile, and find a resolution
  bytes = 0;
  result.drag = await frames();
  result.bytes = bytes / (result.drag.fps * SECONDS);
  dragging = false;
  await pulling;
  result.moved = await page.evaluate(() => window.dfd.store.get().ahead.size > 0);
  await page.mouse.up();
} else {
  await page.waitForTimeout(4000);
  result.clicks = [];
  for (let i = 0; i < CLICKS; i++) result.clicks.push(await click());
  const cdp = await context.newCDPSession(page);
  await cdp.send("HeapProfiler.collectGarbage");
  result.heap = (await cdp.send("Runtime.getHeapUsage")).usedSize / 2 ** 20;
  result.memory = memory();
  result.empty = empty;
}
console.log(JSON.stringify(result));
await browser.close();
