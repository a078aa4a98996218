/** Prints the errors and warnings of the Khronos glTF validator for each file on the command line, as JSON. */

import { readFileSync } from "node:fs";
import validator from "gltf-validator";

const found = {};
for (const path of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(path)), { uri: path, maxIssues: 0 });
  found[path] = report.issues.messages.filter((message) => message.severity <= 1);
}
console.log(JSON.stringify(found));
