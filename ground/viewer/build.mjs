// Makes dist/: each page's script in one file, pages and styles as they are. `cargo xtask viewer` runs it.

import { copyFileSync } from "node:fs";
import { build } from "esbuild";

const pages = [
  { source: "src", script: "viewer", page: "index", holds: ", with three.js (MIT, three.js authors)" },
  { source: "src/live", script: "live", page: "live", holds: "" },
];
for (const { source, script, page, holds } of pages) {
  await build({
    entryPoints: [`${source}/main.ts`],
    outfile: `dist/${script}.js`,
    bundle: true,
    minify: true,
    format: "iife",
    target: "es2022",
    legalComments: "none",
    banner: { js: `/* Adit (MIT OR Apache-2.0)${holds}. Made by \`cargo xtask viewer\`. */` },
  });
  copyFileSync(`${source}/index.html`, `dist/${page}.html`);
  copyFileSync(`${source}/${script}.css`, `dist/${script}.css`);
}
