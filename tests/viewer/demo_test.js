// demo_test.js PROGRAMS PAGE SCREENSHOT: runs the demo and looks at it in the viewer's page in a headless browser. What the
// page shows has to equal the samples of the session's topics, which tactus-watch prints.
// Prints each check with value and bound. Exit status: 0 all hold, 1 one falls short, 2 the page could not be tried.
"use strict";
const { writeFileSync } = require("fs");
const { cpus } = require("os");
const { join, resolve } = require("path");
const { Browser } = require("../web/browser.js");
const { check, exitStatus, pause, report } = require("../web/checks.js");
const { checkContacts, kWatchContacts } = require("./contacts.js");
const { Programs } = require("./programs.js");

const [programFolder, pageFolder, screenshot] = process.argv.slice(2);
const kSeconds = 90;  // of touching
const kMaxCompareSeconds = 40, kMinProbes = 20, kMinFigures = 4;
const kMaxLost = 0.15;  // share of samples that one reader loses and another receives
const kUser = "ann";
// With fewer processors, demo and browser have too little time for bounds of times.
const kIsFast = cpus().length >= 4;
const kScripts = join(__dirname, "../../scripts");
// Runs scripts/demo.sh with programs that are built.
const kDemo = 'scripts=$1 bin=$2 command="the demo"; programs() { :; }; shift 2; source "$scripts/children.sh"; source "$scripts/demo.sh"';
const programs = new Programs(programFolder);
let isBroken = false;

/// Statements for the page, which begin to collect what it shows: probes of a user, and figures of HRTCs.
const collect = (user) => `{
  window.shown = { probes: [], figures: [], delays: [] };
  let { probes, figures } = window.tactus;  // these may be older than the samples
  setInterval(() => {
    const { tactus, shown } = window;
    if (tactus.probes !== probes) {
      probes = tactus.probes;
      shown.delays.push(performance.now() - 1e3 * tactus.sessionTime);
      const { id } = tactus.scene.users.find(({ name }) => name === "${user}") ?? {};
      for (const { user, device, proxy, force } of probes)
        if (user === id) shown.probes.push({ at: tactus.sessionTime, view: [...device, ...proxy, ...force] });
    }
    if (tactus.figures !== null && tactus.figures !== figures)
      for (const [name, each] of Object.entries(figures = tactus.figures))
        if ("hrtc.cycles" in each) shown.figures.push({ name, figures: each });
  }, 4);
}`;

/// Samples that a tactus-watch has printed, without those that only HRTCs of a group receive.
const samplesOf = (program) => program.text.split("\n").filter((line) => /^{.*}$/.test(line)).map((line) => JSON.parse(line))
  .filter(({ group }) => !group).map(({ sample }) => sample);

/// Device, proxy and force of a probe state at a later time, s, as receivers extrapolate them (session/probe_coding.hpp).
function extrapolate({ session_time_ns: from, device, proxy, velocity, force, stiffness, status }, at) {
  const kFull = 0.04, kDecay = 0.02;
  const passed = at - from / 1e9, t = passed <= kFull ? passed : kFull + kDecay * (1 - Math.exp((kFull - passed) / kDecay));
  const along = (from, direction, amount) => from.map((value, k) => value + amount * direction[k]);
  const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);
  const spring = along(proxy, device.position, -1), depth = Math.hypot(...spring), later = along(device.position, velocity, t);
  if (!status.includes("kInContact") || depth === 0) return [...later, ...along(proxy, velocity, t), ...force];
  const outwards = dot(velocity, spring) / depth;
  const isOff = force.every((value) => value === 0);
  return [...later, ...along(proxy, along(velocity, spring, -outwards / depth), t),
          ...isOff ? force : along(force, spring, stiffness * Math.max(-depth, -outwards * t) / depth)];
}

/// Compares what the page shows with the samples of the topics.
async function compareWithTopics(browser, session) {
  const watch = (topic, ...options) =>
    programs.start("watch", topic, "--json", "--for", String(2 * kMaxCompareSeconds), ...options, ...session);
  const states = watch("probe_state", "--user", kUser), metrics = watch("metrics");
  await programs.printed(states, /"sample"/);
  for (const hrtc of ["hrtc-1", "hrtc-2"]) await programs.printed(metrics, new RegExp(`"participant":"${hrtc}"`));
  await browser.value(collect(kUser));
  await browser.until(`window.shown.probes.length >= ${kMinProbes} && window.shown.figures.length >= ${kMinFigures}`,
                      kMaxCompareSeconds).catch(() => {});
  const shown = await browser.value("window.shown");
  for (const program of [states, metrics]) program.kill("SIGINT");
  await Promise.all([states.ended, metrics.ended]);
  // The viewer and tactus-watch receive samples at different times, so any of the nearest states can be the shown one.
  const published = samplesOf(states), kNearest = 50;
  const isSame = (a, b) => a.every((value, k) => Math.abs(value - b[k]) < 2e-6 * (1 + Math.abs(b[k])));  // single precision
  const others = shown.probes.filter(({ at, view }) => {
    const end = published.findIndex(({ session_time_ns: time }) => time / 1e9 > at);
    return !published.slice(Math.max(0, end - kNearest), end < 0 ? undefined : end + kNearest)
      .some((state) => isSame(view, extrapolate(state, at)));
  });
  const samples = samplesOf(metrics);
  const isPublished = ({ name, figures }) => samples.some(({ participant, figures: sample }) =>
    participant === name && Object.entries(sample).every(([figure, value]) => value === figures[figure]));
  const unequal = shown.figures.filter((each) => !isPublished(each));
  const compare = (name, differing, all, min) =>
    check(name, `${differing.length} of ${all.length}`, all.length >= min && differing.length <= kMaxLost * all.length,
          `<= ${100 * kMaxLost} %`);
  compare("shown probes that equal no sample", others, shown.probes, kMinProbes);
  compare("shown figures of HRTCs that equal no sample", unequal, shown.figures, kMinFigures);
  const delays = shown.delays.map((delay) => delay - Math.min(...shown.delays)).sort((a, b) => a - b);
  const percentile = (share) => delays[Math.floor(share * (delays.length - 1))];
  report("delay of shown probes beyond the shortest, median", `${percentile(0.5).toFixed(0)} ms`);
  report("the same, p95", `${percentile(0.95).toFixed(0)} ms`);
}

/// Compares the mesh shown of an HRTC with the mesh hash of this HRTC.
async function compareHashes(browser, hrtc, object) {
  await browser.value(`{ const meshOf = document.getElementById("mesh-of"); meshOf.value = "${hrtc}"; meshOf.dispatchEvent(new Event("change")); }`);
  const isSame = await browser.until(`(() => {
    const { scene, meshes, hashes } = window.tactus;
    const { number } = scene.objects.find(({ name }) => name === "${object}");
    return scene.shownHrtc === "${hrtc}" && meshes.get(number).hash !== "0" && meshes.get(number).hash === hashes["${hrtc}"]?.["${object}"];
  })()`, 20).then(() => true, () => false);
  check(`mesh of ${object} at ${hrtc}: mesh hash`, isSame ? "equal" : "different", isSame, "equal");
}

async function look(browser) {
  const demo = programs.spawn("bash", ["-c", kDemo, "demo", kScripts, resolve(programFolder), "--seconds", String(kSeconds)]);
  const [, name, domain] = await programs.printed(demo, /session (\S+) on domain (\d+)/, 120);
  const session = ["--session", name, "--domain", domain];
  const { address } = await programs.startViewer(pageFolder, "0", ...session);
  await browser.open(address, 800, 600);
  await browser.until("window.tactus?.scene?.objects.length === 3 && window.tactus.probes.length === 5", 20);
  const objects = await browser.value("window.tactus.scene.objects.map(({ name }) => name).sort().join(' ')");
  check("objects of the demo", objects, objects === "crate organ terrain", "3 objects");
  await browser.value(kWatchContacts);
  await compareWithTopics(browser, session);
  await checkContacts(browser, kIsFast);
  writeFileSync(screenshot, await browser.screenshot());
  await compareHashes(browser, "hrtc-1", "organ");
  await compareHashes(browser, "hrtc-2", "terrain");
  const status = await demo.ended;
  const short = demo.text.split("\n").filter((line) => /falls short/.test(line));
  report("rows of the demo that fall short while the page runs", `${short.length}${short.length > 0 ? `: ${short.join("; ")}` : ""}`);
  check("exit status of the demo", status, status === 0 || (status === 1 && short.length > 0), "0 or 1");
  const errors = [await browser.value("window.tactus.error"), ...browser.log].filter((text) => text);
  check("errors", errors.join("; ") || 0, errors.length === 0, "0");
}

const browser = new Browser(process.env.CHROMIUM ?? "chromium-headless-shell");
look(browser).catch((error) => {
  console.error(`demo_test.js: ${error.message}; console: ${browser.log.join("; ") || "empty"}`);
  programs.printAll();
  isBroken = true;
}).finally(async () => {
  browser.close();
  await programs.end();
  process.exit(isBroken ? 2 : exitStatus());
});
