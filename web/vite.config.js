// One HTML file: the built script and style go into the page itself, so that a report needs no server and no network.
import { defineConfig } from "vite";

function inlineEverything() {
  return {
    name: "inline-everything",
    enforce: "post",
    generateBundle(_options, bundle) {
      const page = bundle["index.html"];
      const take = (name) => {
        const item = bundle[name.replace(/^\.?\//, "")];
        delete bundle[item.fileName];
        return item;
      };
      // Functions as replacements: '$' in the code must not be read as a pattern.
      page.source = String(page.source)
        .replace(/<link rel="stylesheet"[^>]*href="([^"]+)"[^>]*>/g, (_, name) => `<style>${take(name).source}</style>`)
        .replace(/<script type="module"[^>]*src="([^"]+)"[^>]*><\/script>/g, (_, name) => {
          const code = take(name).code.trim().replace(/<\/(script)/gi, "<\\/$1");
          return `<script type="module">${code}</script>`;
        });
      page.fileName = "report.html";
    },
  };
}

export default defineConfig({
  base: "./",
  plugins: [inlineEverything()],
  build: {
    outDir: "built",
    target: "es2022",
    modulePreload: false,
    cssCodeSplit: false,
    chunkSizeWarningLimit: 2000,
  },
});
