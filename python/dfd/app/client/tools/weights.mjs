// What the page's own bind gives, for tests: from a folder with `dfd.wasm`, `features.bin` and `asked.json`, the vertices
// and what to bind of them, to `weights.bin`, as float32, one after the other.
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { fileURLToPath } from "node:url";
import { runnerImport } from "vite";

const folder = process.argv[2];
const read = (name) => readFileSync(join(folder, name));
const bind = fileURLToPath(new URL("../src/alone/bind.ts", import.meta.url));
const { Features, loadCore } = (await runnerImport(bind)).module;
const { vertices, asked, refused } = JSON.parse(read("asked.json"));
const file = new Uint8Array(read("features.bin")).buffer;
const features = new Features(await loadCore(read("dfd.wasm")), vertices, file);
const weights = asked.flatMap(({ handles, reach, falloff, fixed }) => [
  ...features.bind(handles, reach, falloff, fixed),
]);
writeFileSync(join(folder, "weights.bin"), Float32Array.from(weights));
for (const handles of refused) {
  try {
    features.bind(handles);
  } catch (error) {
    console.log(error.message);
  }
}
