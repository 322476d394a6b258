// Bundles the viewer with three.js into one script, and copies the license of three.js beside it.
import { createHash } from "node:crypto";
import { copyFileSync, readdirSync, readFileSync } from "node:fs";
import { build } from "esbuild";

const target = "../topokit/pages/static/";
const sources = readdirSync("src").sort().map((name) => readFileSync(`src/${name}`));
const digest = createHash("sha256").update(Buffer.concat(sources)).digest("hex");

await build({
  entryPoints: ["src/main.js"],
  outfile: `${target}viewer.min.js`,
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "ascii",
  legalComments: "inline",
  banner: { js: `/* topokit viewer, MIT; sources ${digest}; contains three.js, MIT, see THREE-LICENSE */` },
});
copyFileSync("node_modules/three/LICENSE", `${target}THREE-LICENSE`);
