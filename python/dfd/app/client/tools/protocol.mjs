// `npm run protocol` writes src/protocol/messages.ts, the types of all messages, from the server's JSON Schema. The
// schema comes from a Python with dfd: DFD_PYTHON if set, otherwise that of .venv in the repository, or `python3`.
import { execFileSync } from "node:child_process";
import { existsSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";

const place = (path) => fileURLToPath(new URL(path, import.meta.url));
const installed = place("../../../../../.venv/bin/python");
const python = process.env.DFD_PYTHON ?? (existsSync(installed) ? installed : "python3");
const schema = JSON.parse(execFileSync(python, ["-m", "dfd.app.schema"], { encoding: "utf8" }));

/** Return the TypeScript type of a schema. Messages are never changed, so their arrays and fields are readonly. */
function typeOf(node) {
  if (node.$ref) return node.$ref.split("/").at(-1);
  if ("const" in node) return JSON.stringify(node.const);
  if (node.enum) return node.enum.map((value) => JSON.stringify(value)).join(" | ");
  const choices = node.anyOf ?? node.oneOf;
  if (choices) return choices.map((each) => `(${typeOf(each)})`).join(" | ");
  if (node.prefixItems) return `readonly [${node.prefixItems.map(typeOf).join(", ")}]`;
  if (node.type === "array") return `readonly (${typeOf(node.items)})[]`;
  if (node.type === "object") return `Readonly<Record<string, ${typeOf(node.additionalProperties)}>>`;
  return { integer: "number" }[node.type] ?? node.type;
}

const types = Object.entries(schema.$defs).map(([name, { description, properties, required = [] }]) => {
  // The server writes every key, even a key with its default value.
  const whole = /Message$|State$/.test(name);
  const fields = Object.entries(properties).map(
    ([key, field]) => `  readonly ${key}${whole || required.includes(key) ? "" : "?"}: ${typeOf(field)};`,
  );
  return `/** ${(description ?? name).replaceAll("\n", "\n * ")} */\nexport interface ${name} {\n${fields.join("\n")}\n}\n`;
});
// The fields of a transform and their values at rest.
const motions = Object.entries(schema.$defs.PoseTransform.properties).filter(([name]) => name !== "handle");
const rest = JSON.stringify(Object.fromEntries(motions.map(([name, field]) => [name, field.default])));
const values = `export const REST_VALUES: Required<Omit<PoseTransform, "handle">> = ${rest};\n`;
writeFileSync(place("../src/protocol/messages.ts"), ["// Made by `npm run protocol`.\n", ...types, values].join("\n"));
