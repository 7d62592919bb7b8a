// fetch-npm.js REGISTRY LOCK DIRECTORY: fetches the packages of the lock file LOCK into DIRECTORY/node_modules. For machines
// with Node.js but without npm: Debian's npm depends on 384 packages (43 MB), and the tests need fourteen small ones.
"use strict";
const { createHash } = require("crypto");
const { execFileSync } = require("child_process");
const { mkdirSync, readFileSync, rmSync, renameSync, writeFileSync } = require("fs");
const { basename, dirname, join } = require("path");

async function fetchPackage(registry, directory, folder, { version, integrity }) {
  const name = folder.replace(/^.*node_modules\//, "");
  const url = `${registry.replace(/\/+$/, "")}/${name}/-/${basename(name)}-${version}.tgz`;
  const answer = await fetch(url, { signal: AbortSignal.timeout(60000) });
  if (!answer.ok) throw new Error(`${url}: status ${answer.status}`);
  const archive = Buffer.from(await answer.arrayBuffer());
  const found = "sha512-" + createHash("sha512").update(archive).digest("base64");
  if (found !== integrity) throw new Error(`${url}: found ${found}, expected ${integrity}`);
  const target = join(directory, folder);
  const part = `${target}.part`;
  rmSync(part, { recursive: true, force: true });
  mkdirSync(part, { recursive: true });
  writeFileSync(`${part}.tgz`, archive);
  execFileSync("tar", ["-xzf", `${part}.tgz`, "--strip-components=1", "-C", part]);
  rmSync(`${part}.tgz`);
  rmSync(target, { recursive: true, force: true });
  mkdirSync(dirname(target), { recursive: true });
  renameSync(part, target);
}

async function main([registry, lock, directory]) {
  const packages = JSON.parse(readFileSync(lock, "utf8")).packages;
  for (const [folder, entry] of Object.entries(packages)) {
    if (folder !== "") await fetchPackage(registry, directory, folder, entry);
  }
}

main(process.argv.slice(2)).catch((error) => {
  console.error(`fetch-npm.js: ${error.message}${error.cause ? ` (${error.cause.message})` : ""}`);
  process.exit(1);
});
