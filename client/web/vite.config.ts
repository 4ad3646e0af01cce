// Builds the page into the Python package, which the gateway serves. The licences of what is bundled go beside it.
import { defineConfig } from "vite";

export default defineConfig({
  build: {
    outDir: "../python/usdlive/page/static",
    emptyOutDir: true,
    target: "es2022",
    license: { fileName: "licences.md" },
    // The browser would refuse a picture in a data: URL, because of the policy that the gateway sends.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1200,
  },
  oxc: { jsx: { runtime: "automatic", importSource: "preact" } },
});
