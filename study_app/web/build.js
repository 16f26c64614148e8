/** Bundles the page, and the page in jsPsych, into `assets/`: scripts with the licences of what is in them. */
import { build } from "esbuild";
import { copyFile, mkdir, readdir, readFile, writeFile } from "node:fs/promises";
import { argv } from "node:process";

const out = argv[2] ?? "assets";
await mkdir(out, { recursive: true });
const MIT = (await readFile("../../LICENSE", "utf8")).split("\n").slice(4).join("\n").trim();

/** The licence of a package that is in a bundle, as it asks for. */
async function licence(name) {
  const folder = `node_modules/${name}`;
  const { author, license, version } = JSON.parse(await readFile(`${folder}/package.json`, "utf8"));
  const file = (await readdir(folder)).find((one) => /^licen[cs]e/i.test(one));
  if (file) return `${name} ${version} (${license}):\n${(await readFile(`${folder}/${file}`, "utf8")).trim()}\n`;
  // Some say it in their description only, some nowhere: the words of the licence are the same.
  if (license !== "MIT") throw new Error(`${name} must have a file with its licence (${license})`);
  const told = (await readFile(`${folder}/README.md`, "utf8")).match(/^Copyright .*$/m);
  const by = told ? told[0] : `Copyright ${author?.name ?? author}`;
  return `${name} ${version} (${license}):\n${by}\n${MIT}\n`;
}

async function bundle(entry, asset, format = "iife") {
  const { outputFiles, metafile } = await build({
    entryPoints: [entry],
    bundle: true,
    preserveSymlinks: true, // packages may lie elsewhere
    minify: true,
    format,
    target: "es2022",
    legalComments: "inline",
    metafile: true,
    write: false,
  });
  const inside = Object.keys(metafile.inputs).map((path) => /^node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path)?.[1]);
  const names = [...new Set(inside.filter(Boolean))].sort();
  const texts = await Promise.all(names.map(licence));
  const banner = `/* metamerlab (MIT). Contains\n${texts.join("\n").replaceAll("*/", "* /")}*/\n`;
  await writeFile(`${out}/${asset}`, banner + outputFiles[0].text);
}

await bundle("src/page.ts", "metamerlab.js");
await bundle("src/jspsych.ts", "metamerlab-jspsych.js");
await bundle("src/stage/headset.ts", "metamerlab-headset.js", "esm");
for (const name of ["index.html", "metamerlab.css", "lab.html", "lab.js"]) await copyFile(`src/${name}`, `${out}/${name}`);
// Without its fonts, half a megabyte: browsers take one of their own.
const style = await readFile("node_modules/jspsych/css/jspsych.css", "utf8");
await writeFile(`${out}/jspsych.css`, style.replace(/@font-face\s*\{[^}]*\}/g, ""));
