// `npm run protocol` writes src/protocol/messages.ts, the types of all messages, from the server's JSON Schema. The
// schema comes from a Python with dfd: DFD_PYTHON if set, otherwise that of .venv in the repository, or `python3`.
import { execFileSync } from "node:child_process";
import { existsSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { compile } from "json-schema-to-typescript";

const place = (path) => fileURLToPath(new URL(path, import.meta.url));
const installed = place("../../../../../.venv/bin/python");
const python = process.env.DFD_PYTHON ?? (existsSync(installed) ? installed : "python3");
const schema = JSON.parse(execFileSync(python, ["-m", "dfd.app.schema"], { encoding: "utf8" }));

/** Return a schema without titles of properties, each of which would become a type. `prefixItems` becomes `items`. */
function simplified(node, keepTitle = false) {
  if (Array.isArray(node)) return node.map((entry) => simplified(entry));
  if (node === null || typeof node !== "object") return node;
  const entries = Object.entries(node).flatMap(([key, value]) => {
    if (key === "title" && typeof value === "string" && !keepTitle) return [];
    if (key === "prefixItems") return [["items", simplified(value)]];
    if (key === "properties" || key === "$defs") {
      const parts = Object.entries(value).map(([name, part]) => [name, simplified(part, key === "$defs")]);
      return [[key, Object.fromEntries(parts)]];
    }
    return [[key, simplified(value)]];
  });
  return Object.fromEntries(entries);
}

// The server writes every key, even a key with its default value, so all keys are required.
for (const [name, definition] of Object.entries(schema.$defs)) {
  if (/Message$|State$/.test(name)) definition.required = Object.keys(definition.properties);
}

const types = await compile(simplified(schema, true), "Protocol", {
  bannerComment: "// Made by `npm run protocol`.",
  additionalProperties: false,
  style: { printWidth: 120 },
});
// Messages are never changed, so their arrays are readonly.
const tuples = types.replace(/\[(?=number,|\s*\[)/g, "readonly [").replace(/(\w+)\[\]/g, "readonly $1[]");
// The fields of a transform and their values at rest.
const motions = Object.entries(schema.$defs.PoseTransform.properties).filter(([name]) => name !== "handle");
const rest = JSON.stringify(Object.fromEntries(motions.map(([name, field]) => [name, field.default])));
const values = `export const REST_VALUES: Required<Omit<PoseTransform, "handle">> = ${rest};\n`;
writeFileSync(place("../src/protocol/messages.ts"), tuples + values);
