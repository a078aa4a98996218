import { defineConfig } from "vitest/config";

export default defineConfig({
  // Addresses are relative, because the page may have any path, for example behind the proxy of a notebook.
  base: "./",
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    outDir: "../static",
    emptyOutDir: true,
    target: "es2022",
    // The server's Content-Security-Policy does not allow data: addresses in scripts and styles.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1200,
  },
  test: { include: ["tests/unit/**/*.test.ts"], environment: "node" },
});
