import { defineConfig } from "vitest/config";

/** The page of the docs that needs no server, beside its shapes: nothing there is deleted. */
const ALONE = { outDir: "../../../../build/docs/extra/try", emptyOutDir: false };
const names = { entryFileNames: "[name].js", chunkFileNames: "[name].js", assetFileNames: "[name][extname]" };

export default defineConfig(({ mode }) => ({
  // The server gives the page out under any address, also behind a notebook's proxy.
  base: "./",
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
  build: {
    ...(mode === "alone"
      ? { ...ALONE, rolldownOptions: { output: names } }
      : { outDir: "../static", emptyOutDir: true }),
    target: "es2022",
    // The Content-Security-Policy allows no data: in scripts and styles, and pictures are so few that files serve.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1200,
  },
  test: { include: ["tests/unit/**/*.test.ts"], environment: "node" },
}));
