// speed_test.js PROGRAMS PAGE MODEL.spm...: measures how fast the viewer's page opens and draws each model, which two
// HRTCs refine for two users. The picture has 800 x 600 pixels, drawn in software without antialiasing.
// "Alone" means that hosts, HRTCs and users are stopped, and that the page draws as often as it can.
// Prints each figure with its bound. Exit status: 0 all hold, 1 one falls short, 2 a model could not be tried.
"use strict";
const { mkdtempSync, rmSync, writeFileSync } = require("fs");
const { loadavg, tmpdir } = require("os");
const { basename, join } = require("path");
const { Browser } = require("../web/browser.js");
const { check, exitStatus, pause } = require("../web/checks.js");
const { Programs } = require("./programs.js");

const [programFolder, pageFolder, ...models] = process.argv.slice(2);
const kWidth = 800, kHeight = 600;
const kTriangles = 20000;  // min number drawn
const kMeasureMs = 5000;
const kDomain = process.env.TACTUS_TEST_DOMAIN ?? String(1 + 3 * (process.pid % 30));
const kScenario = `name: two users
duration: 900
users:
${["ann", "bob"].map((name, i) => `  - name: ${name}
    hrtc: hrtc-${i + 1}
    repeat: true
    script:
      - approach: {object: "#1", direction: [0, ${i === 0 ? "0, 1" : "-1, 0"}], speed: 0.1, until_force: 0.5}
      - follow: {speed: 0.05, force: 1, seconds: 8, pattern: circle}
      - retreat: {}
`).join("")}`;

const folder = mkdtempSync(join(tmpdir(), "tactus-speed-"));
const programs = new Programs(programFolder);
let isBroken = false;

async function pictureRate(browser) {
  const before = await browser.value("window.tactus.pictures"), began = performance.now();
  await pause(kMeasureMs);
  return (await browser.value("window.tactus.pictures") - before) / (performance.now() - began) * 1e3;
}

async function measure(model, number) {
  const name = basename(model, ".spm"), session = ["--session", `speed-${process.pid}-${number}`, "--domain", kDomain];
  const start = (program, ...options) => programs.start(program, ...session, ...options);
  const others = [start("host", model, "--name", "host"), start("hrtc", "--name", "hrtc-1"), start("hrtc", "--name", "hrtc-2")];
  const { viewer, address } = await programs.startViewer(pageFolder, "0", ...session);
  await programs.printed(viewer, /object \S+ found/, 120);
  await pause(1000);  // until the base mesh has arrived
  const browser = new Browser(process.env.CHROMIUM ?? "chromium-headless-shell");
  try {
    await browser.open(address, kWidth, kHeight);
    await browser.until("window.tactus?.firstPictureMs != null || window.tactus?.error != null", 60);
    const first = await browser.value("window.tactus.firstPictureMs");
    check(`${name}: first picture after the page was opened`, `${(first / 1e3).toFixed(2)} s`, first <= 1000, "<= 1 s");
    others.push(start("sim", "--scenario", join(folder, "users.yaml"), "--name", "users"));
    await browser.until("window.tactus.probes.length === 2 && window.tactus.probes.some(({ status }) => (status & 3) === 3)", 60);
    const drawn = "[...window.tactus.meshes.values()].reduce((sum, { faces }) => sum + faces, 0)";
    await browser.until(`${drawn} >= ${kTriangles}`, 20).catch(() => {});
    const beside = await pictureRate(browser);
    const triangles = await browser.value(drawn);
    check(`${name}: triangles drawn`, triangles, triangles >= kTriangles, `>= ${kTriangles}`);
    check(`${name}: pictures a second beside the session`, beside.toFixed(1), beside >= 20, ">= 20");
    const { usedSize, embedderHeapUsedSize = 0, backingStorageSize = 0 } = await browser.send("Runtime.getHeapUsage");
    const megabytes = (usedSize + embedderHeapUsedSize + backingStorageSize) / 1e6;
    check(`${name}: memory of the page`, `${megabytes.toFixed(0)} MB`, megabytes <= 100, "<= 100 MB");
    for (const program of others) program.kill("SIGSTOP");
    await browser.value("window.tactus.minIntervalMs = 0");
    const alone = await pictureRate(browser);
    check(`${name}: pictures a second alone`, alone.toFixed(1), alone >= 30, ">= 30");
    console.log(`${name}: load of the machine ${loadavg()[0].toFixed(1)}`);
  } finally {
    browser.close();
    await programs.end();
  }
}

async function run() {
  if (models.length === 0) throw new Error("found no model, expected: speed_test.js PROGRAMS PAGE MODEL.spm...");
  writeFileSync(join(folder, "users.yaml"), kScenario);
  for (const [number, model] of models.entries()) await measure(model, number);
}

run().catch((error) => {
  console.error(`speed_test.js: ${error.message}`);
  programs.printAll();
  isBroken = true;
}).finally(async () => {
  await programs.end();
  rmSync(folder, { recursive: true, force: true });
  process.exit(isBroken ? 2 : exitStatus());
});
