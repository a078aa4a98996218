// The types of all messages, made from the JSON Schema that the server writes; with --check only says whether they are
// current.
import { readFile, writeFile } from "node:fs/promises";
import { compile } from "json-schema-to-typescript";

const source = new URL("../src/protocol.schema.json", import.meta.url);
const target = new URL("../src/protocol/messages.ts", import.meta.url);

const schema = JSON.parse(await readFile(source, "utf8"));

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
  if (name.endsWith("Message")) definition.required = Object.keys(definition.properties);
}

const types = await compile(readable(schema, true), "Protocol", {
  bannerComment: "// Made by `npm run protocol` from protocol.schema.json.",
  additionalProperties: false,
  style: { printWidth: 120 },
});

if (process.argv.includes("--check")) {
  const present = await readFile(target, "utf8");
  if (present !== types) {
    console.error("src/protocol/messages.ts is not what protocol.schema.json says: run `npm run protocol`");
    process.exit(1);
  }
} else {
  await writeFile(target, types);
}
