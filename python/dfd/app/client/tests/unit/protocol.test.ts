import { execFileSync } from "node:child_process";
import { describe, expect, it } from "vitest";

describe("types of messages", () => {
  it("are what the schema says", () => {
    const tool = new URL("../../tools/protocol.mjs", import.meta.url).pathname;
    expect(() => execFileSync(process.execPath, [tool, "--check"], { stdio: "pipe" })).not.toThrow();
  });
});
