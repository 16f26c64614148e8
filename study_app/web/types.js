/** Writes `src/kernel/formats.ts`: types of what comes from Python and goes home, of the published schemas. */
import { readFileSync, writeFileSync } from "node:fs";
import { argv } from "node:process";

const SHARED = "Sent";
const WORDS = { string: "string", integer: "number", number: "number", boolean: "boolean", null: "null" };
const HEAD = "/** Made of `protocols/schemas/` by `npm run types`: change the models in Python, and make it again. */\n";

/** A schema as a type. */
function typeOf(schema) {
  const either = schema.anyOf ?? schema.oneOf;
  if (schema.$ref) return schema.$ref.split("/").at(-1);
  if (either) return either.map(typeOf).join(" | ");
  if ("const" in schema) return JSON.stringify(schema.const);
  if (schema.enum) return schema.enum.map((value) => JSON.stringify(value)).join(" | ");
  if (schema.prefixItems) return `readonly [${schema.prefixItems.map(typeOf).join(", ")}]`;
  if (schema.type === "array") {
    const item = typeOf(schema.items);
    return /^[\w.]+$/.test(item) ? `readonly ${item}[]` : `readonly (${item})[]`;
  }
  if (schema.type === "object") {
    const [value] = Object.values(schema.patternProperties ?? { all: schema.additionalProperties });
    return `Readonly<Record<string, ${typeOf(value)}>>`;
  }
  const word = WORDS[schema.type];
  if (!word) throw new Error(`no type for ${JSON.stringify(schema)}`);
  return word;
}

/** What a class or key means, in a comment. */
function comment({ description }, end) {
  return description ? `/** ${description.replaceAll("\n", " ")} */${end}` : "";
}

/** A class as an interface; every key is written, also where a reader could do without. */
function declared(name, schema, shared = {}) {
  const keys = Object.entries(schema.properties)
    .filter(([key]) => !(key in shared))
    .map(([key, value]) => `  ${comment(value, " ")}readonly ${key}: ${typeOf(value)};\n`);
  const above = Object.keys(shared).length ? ` extends ${SHARED}` : "";
  return `${comment(schema, "\n")}export interface ${name}${above} {\n${keys.join("")}}\n`;
}

/** The keys that all of several classes have, and mean the same by. */
function common(classes) {
  const [first, ...others] = classes.map(({ properties }) => properties);
  const same = (key, value) => others.every((one) => JSON.stringify(one[key]) === JSON.stringify(value));
  return Object.fromEntries(Object.entries(first).filter(([key, value]) => same(key, value)));
}

const read = (name) => JSON.parse(readFileSync(`../../protocols/schemas/${name}.schema.json`, "utf8"));
const { $defs: parts, ...study } = read("web-study");
const { $defs: lines, oneOf } = read("web-line");
const kinds = oneOf.map(typeOf);
const shared = common(kinds.map((kind) => lines[kind]));
const found = [
  declared("WebStudy", study),
  ...Object.entries(parts).map(([name, part]) => declared(name, part)),
  declared(SHARED, { description: "Keys of every line.", properties: shared }),
  ...Object.entries(lines).map(([name, line]) => declared(name, line, kinds.includes(name) ? shared : {})),
  `export type WebLine = ${typeOf({ oneOf })};\n`,
];
writeFileSync(argv[2] ?? "src/kernel/formats.ts", HEAD + found.map((text) => `\n${text}`).join(""));
