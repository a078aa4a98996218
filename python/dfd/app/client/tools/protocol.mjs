// Makes the types of all messages, src/protocol/messages.ts, from the server's own: `npm run protocol`. The Python that
// has dfd installed is that of DFD_PYTHON, of .venv beside the sources, or `python3`.
import { execFileSync } from "node:child_process";
import { existsSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { compile } from "json-schema-to-typescript";

const place = (path) => fileURLToPath(new URL(path, import.meta.url));
const own = place("../../../../../.venv/bin/python");
const python = process.env.DFD_PYTHON ?? (existsSync(own) ? own : "python3");
const schema = JSON.parse(execFileSync(python, ["-m", "dfd.app.schema"], { encoding: "utf8" }));

/** Without the titles of single keys, which would make a type of each, and with tuples as older drafts wrote them. */
function readable(node, named = false) {
  if (Array.isArray(node)) return node.map((entry) => readable(entry));
  if (node === null || typeof node !== "object") return node;
  const entries = Object.entries(node).flatMap(([key, value]) => {
    if (key === "title" && typeof value === "string" && !named) return [];
    if (key === "prefixItems") return [["items", readable(value)]];
    if (key === "properties" || key === "$defs") {
      const parts = Object.entries(value).map(([name, part]) => [name, readable(part, key === "$defs")]);
      return [[key, Object.fromEntries(parts)]];
    }
    return [[key, readable(value)]];
  });
  return Object.fromEntries(entries);
}

// The server writes every key, those with a default too.
for (const [name, definition] of Object.entries(schema.$defs)) {
  if (/Message$|State$/.test(name)) definition.required = Object.keys(definition.properties);
}

const types = await compile(readable(schema, true), "Protocol", {
  bannerComment: "// Made by `npm run protocol`.",
  additionalProperties: false,
  style: { printWidth: 120 },
});
// Nobody changes a message.
const tuples = types.replace(/\[(?=number,|\s*\[)/g, "readonly [").replace(/(\w+)\[\]/g, "readonly $1[]");
writeFileSync(place("../src/protocol/messages.ts"), tuples);
