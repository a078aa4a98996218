import { defineConfig } from "vitest/config";

export default defineConfig({
  // The server serves the page under any address, also behind a notebook's proxy.
  base: "./",
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    outDir: "../static",
    emptyOutDir: true,
    target: "es2022",
    // The Content-Security-Policy allows no data: in scripts and styles.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1200,
  },
  test: { include: ["tests/unit/**/*.test.ts"], environment: "node" },
});
