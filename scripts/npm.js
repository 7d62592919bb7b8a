// npm.js REGISTRY DIRECTORY [NAME VERSION INTEGRITY]...: fetches npm packages into DIRECTORY/node_modules. Instead of npm
// itself, which brings some 400 Debian packages; dependencies are listed, not resolved.
"use strict";
const { createHash } = require("crypto");
const { execFileSync } = require("child_process");
const { mkdirSync, rmSync, renameSync, writeFileSync } = require("fs");
const { basename, dirname, join } = require("path");

async function fetchPackage(registry, directory, name, version, integrity) {
  const url = `${registry.replace(/\/+$/, "")}/${name}/-/${basename(name)}-${version}.tgz`;
  const answer = await fetch(url, { signal: AbortSignal.timeout(60000) });
  if (!answer.ok) throw new Error(`${url}: ${answer.status}`);
  const archive = Buffer.from(await answer.arrayBuffer());
  const found = "sha512-" + createHash("sha512").update(archive).digest("base64");
  if (found !== integrity) throw new Error(`${url}: found ${found}, expected ${integrity}`);
  const place = join(directory, "node_modules", name);
  const part = `${place}.part`;
  rmSync(part, { recursive: true, force: true });
  mkdirSync(part, { recursive: true });
  writeFileSync(`${part}.tgz`, archive);
  execFileSync("tar", ["-xzf", `${part}.tgz`, "--strip-components=1", "-C", part]);
  rmSync(`${part}.tgz`);
  rmSync(place, { recursive: true, force: true });
  mkdirSync(dirname(place), { recursive: true });
  renameSync(part, place);
}

async function main([registry, directory, ...packages]) {
  for (let i = 0; i + 2 < packages.length; i += 3) await fetchPackage(registry, directory, ...packages.slice(i, i + 3));
}

main(process.argv.slice(2)).catch((error) => {
  console.error(`npm.js: ${error.message}${error.cause ? ` (${error.cause.message})` : ""}`);
  process.exit(1);
});
