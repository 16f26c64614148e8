/** Bundles the page into `assets/`: one script with the licences of what is in it, and no network. */
import { build } from "esbuild";
import { copyFile, mkdir, readFile, writeFile } from "node:fs/promises";
import { argv } from "node:process";

const out = argv[2] ?? "assets";
await mkdir(out, { recursive: true });
const { license, version } = JSON.parse(await readFile("node_modules/@noble/hashes/package.json", "utf8"));
const text = await readFile("node_modules/@noble/hashes/LICENSE", "utf8");
const { outputFiles } = await build({
  entryPoints: ["src/page.ts"],
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  legalComments: "inline",
  write: false,
});
const banner = `/* metamerlab (MIT). Contains @noble/hashes ${version} (${license}):\n${text.trim()}\n*/\n`;
await writeFile(`${out}/metamerlab.js`, banner + outputFiles[0].text);
for (const name of ["index.html", "metamerlab.css"]) await copyFile(`src/${name}`, `${out}/${name}`);
