/** Prints the errors and warnings of the Khronos glTF validator for each file on the command line, as JSON. */

import { readFileSync } from "node:fs";
import { dirname, resolve } from "node:path";
import validator from "gltf-validator";

const found = {};
for (const path of process.argv.slice(2)) {
  const options = {
    uri: path,
    maxIssues: 0,
    externalResourceFunction: async (uri) => new Uint8Array(readFileSync(resolve(dirname(path), decodeURIComponent(uri)))),
  };
  try {
    const report = await validator.validateBytes(new Uint8Array(readFileSync(path)), options);
    found[path] = report.issues.messages.filter((message) => message.severity <= 1);
  } catch (error) {
    // The validator stops at a file that is no glTF at all.
    found[path] = [{ code: "UNREADABLE", message: String(error), severity: 0, pointer: "" }];
  }
}
console.log(JSON.stringify(found));
