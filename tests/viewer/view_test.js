// view_test.js PROGRAMS PAGE SCREENSHOT: starts a host, an HRTC, simulated users and a viewer, and looks at the viewer's
// page in a headless browser, as a user does. Then the page's own user touches, by the mouse.
// Prints each check with value and bound. Exit status: 0 all hold, 1 one falls short, 2 the page could not be tried.
"use strict";
const { execFileSync } = require("child_process");
const { mkdtempSync, rmSync, writeFileSync } = require("fs");
const { tmpdir } = require("os");
const { join } = require("path");
const { Browser } = require("../web/browser.js");
const { check, exitStatus, pause, report } = require("../web/checks.js");
const { checkContacts, kWatchContacts } = require("./contacts.js");
const { joinPictures } = require("./film.js");
const { Programs } = require("./programs.js");

const [programFolder, pageFolder, screenshot] = process.argv.slice(2);
const kWidth = 800, kHeight = 600;
const kFaces = 200000, kBaseFaces = 500;  // of the organ
const kPresses = 5;
const kScreenFaces = 20000;  // max number of faces for the screen alone, the default of tactus view
const kCrate = 0.12, kCrateX = 0.22;  // m, side of the crate and position of its centre
const kObjects = `objects:
  - model: organ.spm
    position: [0, 0, 0.1]
  - model: crate.spm
    position: [${kCrateX}, 0, ${kCrate / 2}]
    material: {stiffness: 1000, damping: 3, static_friction: 0.6, dynamic_friction: 0.5}
    body: {mass: 0.2, friction: 0.6}
`;
const kSession = `view-test-${process.pid}`, kDomain = String(1 + 3 * (process.pid % 30));
const kOrganFaces = "window.tactus.meshes.get(window.tactus.scene.objects.find(({ name }) => name === 'organ').number).faces";
const kScenario = `name: two users
duration: 900
users:
  - name: ann
    repeat: true
    script:
      - approach: {object: organ, direction: [0, 0, 1], speed: 0.1, until_force: 0.5}
      - follow: {speed: 0.05, force: 1, seconds: 8, pattern: circle}
      - retreat: {}
  - name: bob
    repeat: true
    script:
      - tap: {object: organ, direction: [0, -1, 0], count: 5, speed: 0.1, force: 1}
      - wait: {seconds: 1}
`;

const folder = mkdtempSync(join(tmpdir(), "tactus-view-"));
const programs = new Programs(programFolder);
let isBroken = false;

const kSessionOptions = ["--session", kSession, "--domain", kDomain];

/// Starts a program of the session.
const start = (name, ...options) => programs.start(name, ...kSessionOptions, ...options);

/// Number of pictures drawn in a second, over `ms`.
async function pictureRate(browser, ms) {
  const before = await browser.value("window.tactus.pictures"), began = performance.now();
  await pause(ms);
  return (await browser.value("window.tactus.pictures") - before) / (performance.now() - began) * 1e3;
}

/// The boxes of regions: those of contact contain the surface under the probes, and their layers are drawn.
async function checkRegions(browser) {
  const numbers = `[3, 2, 1].map((mark) => [...window.tactus.regions.values()].flat().filter((each) => each.mark === mark).length)`;
  // Between two taps, nobody touches.
  const areAll = await browser.until(`${numbers}.every((number) => number > 0)`, 10).then(() => true, () => false);
  check("regions in contact, predicted, resident", (await browser.value(numbers)).join(", "), areAll, "> 0 each");
  const contained = await browser.until(`window.tactus.probes.some(({ status, object, proxy }) => {
    const { scale, position } = window.tactus.scene.objects.find(({ number }) => number === object) ?? {};
    if ((status & 1) === 0 || scale === undefined) return false;
    const at = [0, 1, 2].map((k) => (proxy[k] - position[k]) / scale), reach = 0.003 / scale;  // the organ is not turned
    return window.tactus.regions.get(object)?.some(({ mark, x, y, z, edge }) => mark === 3 && [x, y, z].every(
        (low, k) => at[k] > low - reach && at[k] < low + edge + reach));
  })`, 10).then(() => true, () => false);
  check("a region in contact is at a probe in contact", contained ? "yes" : "no", contained, "yes");
  const layer = (name, shows) => browser.value(`{ const box = document.getElementById("${name}"); if (box.checked !== ${shows}) box.click(); }`);
  for (const name of ["contact", "predicted", "resident"]) await layer(name, true);
  await pause(300);
  writeFileSync(screenshot.replace(/\.png$/, "-regions.png"), await browser.screenshot());
  for (const name of ["contact", "predicted", "resident"]) await layer(name, name !== "resident");
}

/// Takes a probe with the mouse, presses on the crate, grabs it and raises it.
async function touch(browser) {
  await browser.value("document.getElementById('take').click()");
  await browser.until("window.tactus.touching?.isServed", 5);
  await browser.value(`{
    document.getElementById("scene").addEventListener("pointerdown", () => { window.times = { down: performance.now() }; });
    const watch = () => {
      const times = window.times ?? {};
      const probe = window.tactus.probes.find(({ user }) => window.tactus.scene.users.find(({ id }) => id === user)?.name === "guest");
      window.ours = probe;
      if (times.down && probe && Math.hypot(...probe.force) > 0.05) times.force ??= performance.now();
      if (times.down && probe && (probe.status & 3) === 3) times.exact ??= performance.now();
      setTimeout(watch, 1);
    };
    watch();
  }`);
  const crate = "window.tactus.scene.objects.find(({ name }) => name === 'crate').number";
  const height = () => browser.value(`window.tactus.poses.find(({ object }) => object === ${crate}).position[2]`);
  const at = await browser.value(`window.tactus.screenOf([${kCrateX}, ${-kCrate / 2}, ${0.7 * kCrate}])`);
  await browser.mouse("mouseMoved", ...at, false);
  await pause(1000);  // the hand moves to the crate
  check("force of the hand above the crate", `${(await browser.value("Math.hypot(...window.ours.force)")).toFixed(2)} N`,
        await browser.value("Math.hypot(...window.ours.force)") === 0, "0 N");
  const latencies = [];  // ms, of force and exact contact after the button was pressed
  for (let i = 0; i < kPresses; ++i) {
    if (i > 0) {
      await browser.mouse("mouseReleased", ...at, false);
      await browser.until("Math.hypot(...window.ours.force) === 0", 5);
      await pause(200);
    }
    await browser.mouse("mousePressed", ...at, true);
    await browser.until("window.times?.force && window.times.exact", 5);
    const { down, force, exact } = await browser.value("window.times");
    latencies.push(Math.max(force, exact) - down);
  }
  latencies.sort((a, b) => a - b);
  const median = latencies[Math.floor(kPresses / 2)];
  check(`exact contact after a press, median of ${kPresses}`, `${median.toFixed(0)} ms`, median <= 150, "<= 150 ms");
  report("the same, longest", `${latencies.at(-1).toFixed(0)} ms`);
  const before = await height();
  await browser.key("g");
  await browser.until("(window.ours.status & 2048) !== 0", 5);
  for (let i = 1; i <= 40; ++i) {
    await browser.mouse("mouseMoved", at[0], at[1] - 2 * i, true);
    await pause(25);
  }
  await pause(500);
  const raised = 1e3 * (await height() - before);
  check("rise of the crate that the page's user grabbed", `${raised.toFixed(0)} mm`, raised > 20, "> 20 mm");
  writeFileSync(screenshot.replace(/\.png$/, "-grab.png"), await browser.screenshot());
  await browser.key("g");
  await browser.mouse("mouseReleased", at[0], at[1] - 80, false);
  await browser.value("document.getElementById('take').click()");
  await browser.until("!window.tactus.scene.users.some(({ name }) => name === 'guest')", 5);
}

/// Films ten seconds in which the page's user presses on the crate, lifts it and puts it down again.
async function film(browser) {
  const kPictures = 50, kPictureMs = 200;
  await browser.value("document.getElementById('take').click()");
  await browser.until("window.tactus.touching?.isServed", 5);
  const at = await browser.value(`window.tactus.screenOf([${kCrateX}, ${-kCrate / 2}, ${0.7 * kCrate}])`);
  const pictures = [], began = performance.now();
  for (let i = 0; i < kPictures; ++i) {
    await pause(began + kPictureMs * i - performance.now());
    const t = i / kPictures, raised = 90 * Math.sin(Math.PI * Math.min(1, Math.max(0, (t - 0.3) / 0.6)));
    const x = at[0] + 25 * Math.sin(12 * Math.min(t, 0.25)), y = at[1] - raised;
    if (i === 5) await browser.mouse("mousePressed", x, y, true);
    if (i === Math.round(0.28 * kPictures) || i === Math.round(0.92 * kPictures)) await browser.key("g");
    await browser.mouse("mouseMoved", x, y, i >= 5);
    pictures.push(await browser.screenshot());
  }
  await browser.mouse("mouseReleased", at[0], at[1], false);
  await browser.value("document.getElementById('take').click()");
  await browser.until("!window.tactus.scene.users.some(({ name }) => name === 'guest')", 5);
  writeFileSync(screenshot.replace(/\.png$/, "-still.png"), pictures[Math.round(0.6 * kPictures)]);
  const bytes = joinPictures(pictures, kPictureMs);
  writeFileSync(screenshot.replace(/\.png$/, "-film.png"), bytes);
  check("film of ten seconds", `${(bytes.length / 1e6).toFixed(2)} MB`, bytes.length <= 3e6, "<= 3 MB");
}

/// Pauses, steps back and returns to the present.
async function stepBack(browser) {
  const press = () => browser.value("document.getElementById('pause').click()");
  const shown = () => browser.value(`[${kOrganFaces}, window.tactus.meshes.values().next().value.hash, ...window.tactus.probes[0].device].join()`);
  await press();
  const paused = await shown();
  await pause(500);
  check("the paused view changes", (await shown()) === paused ? "no" : "yes", (await shown()) === paused, "no");
  await browser.value("{ const time = document.getElementById('time'); time.value = -3; time.dispatchEvent(new Event('input')); }");
  const before = await shown();
  const ago = await browser.value("document.getElementById('ago').textContent");
  check("the view 3 s ago differs", before === paused ? "no" : "yes", before !== paused && /^3\.[0-4] s ago$/.test(ago), "yes");
  await press();
  await browser.until("window.tactus.isLive", 1);
}

/// Chooses the HRTC whose meshes are shown, without refinement for the screen.
async function showMeshOf(browser, hrtc) {
  await browser.value(`{ const meshOf = document.getElementById("mesh-of"); meshOf.value = "${hrtc}"; meshOf.dispatchEvent(new Event("change")); }`);
  await browser.until(`window.tactus.scene?.shownHrtc === "${hrtc}"`, 5);
}

/// Plays the recording of the session in the same page.
async function playRecording(browser, recording, lastHash) {
  const { viewer, address } = await programs.startViewer(pageFolder, "0", "--recording", recording, "--tool", "stylus");
  await browser.open(address, kWidth, kHeight);
  await browser.until("window.tactus?.firstPictureMs != null || window.tactus?.error != null", 20);
  const first = await browser.value("window.tactus.firstPictureMs");
  report("recording: first picture after the page was opened", `${(first / 1e3).toFixed(2)} s`);
  const hidden = await browser.value("['stop', 'touch'].every((id) => document.getElementById(id).offsetParent === null)");
  check("recording: touch and stop are hidden", hidden ? "yes" : "no", hidden, "yes");
  const { seconds } = await browser.value("window.tactus.playback");
  const seek = async (to) => {
    await browser.value(`{ const time = document.getElementById("time"); time.value = ${to}; time.dispatchEvent(new Event("input")); }`);
    const began = performance.now();
    await browser.until(`Math.abs(window.tactus.playback.at - ${to}) < 0.3`, 20);
    return performance.now() - began;
  };
  const tool = await browser.value("window.tactus.toolFaces");
  check("recording: faces of the tool", tool, tool > 100, "> 100");
  const press = () => browser.value("document.getElementById('pause').click()");
  await press();
  await browser.until("!window.tactus.playback.isPlaying", 5);
  await showMeshOf(browser, "hrtc-1");
  await seek(seconds);
  const hash = "window.tactus.meshes.get(window.tactus.scene?.objects.find(({ name }) => name === 'organ')?.number)?.hash";
  const isSame = await browser.until(`${hash} === "${lastHash}"`, 5).then(() => true, () => false);
  check("recording: mesh hash of the organ at the end", await browser.value(hash), isSame, "as live");
  const took = await seek(0.3 * seconds);
  report(`recording: step from ${seconds.toFixed(0)} s back to ${(0.3 * seconds).toFixed(0)} s`, `${(took / 1e3).toFixed(2)} s`);
  await browser.until("window.tactus.probes.length >= 2 && window.tactus.meshes.size === 2", 5);
  const state = `[${kOrganFaces}, window.tactus.playback.at, ...window.tactus.probes[0].device].join()`;
  await pause(300);
  const paused = await browser.value(state);
  await pause(500);
  check("recording: the paused view changes", await browser.value(state) === paused ? "no" : "yes",
        await browser.value(state) === paused, "no");
  await press();
  await browser.until(`window.tactus.playback.at > ${0.3 * seconds} + 2`, 10);
  const force = await browser.until("Math.max(...window.tactus.probes.map(({ force }) => Math.hypot(...force))) > 0.3", 10)
    .then(() => true, () => false);
  check("recording: forces are shown", force ? "yes" : "no", force, "yes");
  writeFileSync(screenshot.replace(/\.png$/, "-recording.png"), await browser.screenshot());
  viewer.kill("SIGTERM");
}

async function look(browser) {
  execFileSync(join(programFolder, "tactus-mesh"), ["generate", "organ", "--faces", String(kFaces), "--seed", "1", join(folder, "organ.ply")]);
  execFileSync(join(programFolder, "tactus-mesh"), ["build", join(folder, "organ.ply"), join(folder, "organ.spm"), "--size", "0.2"]);
  writeFileSync(join(folder, "users.yaml"), kScenario);
  execFileSync(join(programFolder, "tactus-mesh"), ["generate", "box", "--faces", "3000", join(folder, "crate.ply")]);
  execFileSync(join(programFolder, "tactus-mesh"), ["build", join(folder, "crate.ply"), join(folder, "crate.spm"), "--size", String(kCrate)]);
  writeFileSync(join(folder, "objects.yaml"), kObjects);
  start("host", "--name", "host-a", "--config", join(folder, "objects.yaml"));
  const recording = join(folder, "session.mcap");
  const recorder = start("record", recording);
  await programs.printed(recorder, /recording session/);  // before the HRTC receives base meshes
  const hrtc = start("hrtc", "--name", "hrtc-1");
  let { viewer, address, port } = await programs.startViewer(pageFolder, "0", ...kSessionOptions);
  await programs.printed(viewer, /HRTC 'hrtc-1' joined/);
  await programs.printed(viewer, /object organ found/);
  await pause(500);  // until the base mesh has arrived

  await browser.open(address, kWidth, kHeight);
  await browser.until("window.tactus?.firstPictureMs != null || window.tactus?.error != null", 20);
  const first = await browser.value("window.tactus.firstPictureMs");
  check("first picture after the page was opened", `${(first / 1e3).toFixed(2)} s`, first <= 1000, "<= 1 s");

  // Nobody touches yet, so these faces are for the screen.
  const isRefined = await browser.until(`${kOrganFaces} > 2000`, 10).then(() => true, () => false);
  await pause(1000);
  const forScreen = await browser.value(kOrganFaces);
  check("faces of the organ before a touch", forScreen, isRefined && forScreen <= kScreenFaces + kBaseFaces,
        `<= ${kScreenFaces + kBaseFaces}`);
  writeFileSync(screenshot.replace(/\.png$/, "-screen.png"), await browser.screenshot());
  await showMeshOf(browser, "hrtc-1");  // so that no face is fine for the screen
  await browser.value(kWatchContacts);
  const users = start("sim", "--scenario", join(folder, "users.yaml"), "--name", "users");
  // Both users touch, and one of them exactly.
  await browser.until("window.tactus.probes.length === 2 && window.tactus.probes.some(({ status }) => (status & 3) === 3)", 40);
  await pause(5000);
  await checkContacts(browser);
  await showMeshOf(browser, "");
  const faces = await browser.value(kOrganFaces);
  check("faces shown of the organ while it is touched", faces, faces > kBaseFaces && faces < kFaces, "refined");
  const names = await browser.value("[...document.querySelectorAll('#users tr')].map((row) => row.cells[0].textContent).sort().join(' ')");
  check("users in the table", names, names === "ann bob", "ann bob");
  let force = 0;
  for (let i = 0; i < 50 && force < 0.5; ++i, await pause(50))
    force = await browser.value("Math.max(...window.tactus.probes.map(({ force }) => Math.hypot(...force)))");
  check("largest force shown", `${force.toFixed(2)} N`, force >= 0.5 && force < 8, ">= 0.5 N");
  const age = await browser.value("Math.max(...window.tactus.probes.map(({ age }) => age))");
  report("age of the older probe state", `${(1e3 * age).toFixed(0)} ms`);
  await browser.until("window.tactus.figures?.['hrtc-1']?.['hrtc.rate_hz'] > 0", 10);
  const rate = await browser.value("window.tactus.figures['hrtc-1']['hrtc.rate_hz']");
  check("rate of the HRTC", `${rate.toFixed(0)} Hz`, rate > 900, "> 900 Hz");
  const { refined, loaded } = await browser.value("window.tactus.fronts.organ");
  const isOrdered = refined.every((share, i) => share <= loaded[i]);
  check("columns of the organ with a refined front", refined.filter((share) => share > 0).length,
        isOrdered && refined.some((share) => share > 0), "> 0");
  const hosts = await browser.value("document.getElementById('hosts').textContent");
  check("health of the host", hosts, /^host-a2 objects, \d+ kB\/spresent$/.test(hosts), "2 objects");
  const pictures = await pictureRate(browser, 4000);
  check(`pictures a second, ${kWidth} x ${kHeight}`, pictures.toFixed(1), pictures >= 20, ">= 20");
  writeFileSync(screenshot, await browser.screenshot());

  await checkRegions(browser);
  await stepBack(browser);
  await touch(browser);
  await film(browser);

  viewer.kill("SIGKILL");
  await browser.until("!window.tactus.isConnected", 10);
  ({ viewer } = await programs.startViewer(pageFolder, port, ...kSessionOptions));
  await browser.until("window.tactus.isConnected && window.tactus.connections === 2 && window.tactus.probes.length === 2 && window.tactus.meshes.size === 2", 20);
  const again = await browser.value(kOrganFaces);
  check("faces shown by a new viewer at the same port", again, again > 0, "> 0");

  await browser.value("document.getElementById('stop').click()");
  await browser.until("!document.getElementById('banner').hidden", 5);
  await browser.until("window.tactus.probes.length === 2 && window.tactus.probes.every(({ force }) => Math.hypot(...force) === 0)", 5);
  await programs.printed(hrtc, /emergency stop/);
  await browser.until("/^All forces are stopped/.test(document.getElementById('banner').textContent)", 5);
  // The hands do not move while the forces are stopped, so the mesh of the HRTC does not change either.
  const sameMesh = (name) => `(() => {
    const { scene, meshes, hashes } = window.tactus;
    const { number } = scene.objects.find((object) => object.name === "${name}");
    return meshes.get(number).hash !== "0" && meshes.get(number).hash === hashes["hrtc-1"]?.["${name}"];
  })()`;
  await showMeshOf(browser, "hrtc-1");
  const isSame = await browser.until(sameMesh("organ"), 5).then(() => true, () => false);
  const hash = await browser.value("window.tactus.hashes['hrtc-1']?.organ ?? 'none'");
  check("mesh hash of the HRTC; that of the shown organ is", hash, isSame, "equal");
  recorder.kill("SIGINT");
  await programs.printed(recorder, /messages/);
  users.kill("SIGINT");
  await playRecording(browser, recording, hash);
  const error = await browser.value("window.tactus.error");
  // The browser itself reports the connections that failed while no viewer ran.
  const errors = [error, ...browser.log].filter((text) => text && !/WebSocket connection/.test(text));
  check("errors", errors.join("; ") || 0, errors.length === 0, "0");
}

const browser = new Browser(process.env.CHROMIUM ?? "chromium-headless-shell");
look(browser).catch((error) => {
  console.error(`view_test.js: ${error.message}; console: ${browser.log.join("; ") || "empty"}`);
  programs.printAll();
  isBroken = true;
}).finally(async () => {
  await programs.end();
  browser.close();
  rmSync(folder, { recursive: true, force: true });
  process.exit(isBroken ? 2 : exitStatus());
});
