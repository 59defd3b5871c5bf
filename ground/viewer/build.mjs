// Makes dist/: the script in one file, page and style as they are. `cargo xtask viewer` runs it.

import { copyFileSync } from "node:fs";
import { build } from "esbuild";

await build({
  entryPoints: ["src/main.ts"],
  outfile: "dist/viewer.js",
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  legalComments: "none",
  banner: { js: "/* Adit (MIT OR Apache-2.0), with three.js (MIT, three.js authors). Made by `cargo xtask viewer`. */" },
});
for (const file of ["index.html", "viewer.css"]) copyFileSync(`src/${file}`, `dist/${file}`);
