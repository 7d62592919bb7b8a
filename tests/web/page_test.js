// page_test.js FOLDER SCREENSHOT [TRACE]: touches the page "Touch it now" in a headless browser, as a user does with the
// mouse. With the program TRACE (tests/web/touch_trace.cpp), also compares the contacts of the WebAssembly module with
// those of the native build.
// Prints each check with value and bound. Exit status: 0 all hold, 1 one falls short, 2 the page could not be tried.
"use strict";
const { execFileSync } = require("child_process");
const { readFileSync, writeFileSync } = require("fs");
const { cpus } = require("os");
const { join, resolve } = require("path");
const { serve } = require("../../web/serve.js");
const { Browser } = require("./browser.js");
const { check, exitStatus, pause, report } = require("./checks.js");

const kWidth = 1120, kHeight = 720;
const kCentre = { x: 400, y: 350 };  // pixels, on the object
const [folder, screenshot, trace] = process.argv.slice(2);
let isBroken = false;

/// Moves the pressed mouse along a circle for `ms`.
async function slide(browser, ms) {
  const began = performance.now();
  for (let t = 0; t < ms; t = performance.now() - began) {
    await browser.mouse("mouseMoved", kCentre.x + 60 * Math.sin(t / 700), kCentre.y + 40 * Math.sin(t / 500), true);
    await pause(16);
  }
}

/// A sphere as OBJ, with `rows` rows of `columns` quadrilaterals between two poles.
function ballObj(rows, columns) {
  const lines = ["v 0 0 1", "v 0 0 -1"];
  const vertex = (row, column) => 3 + (row - 1) * columns + column % columns;
  for (let row = 1; row < rows; ++row) {
    const theta = Math.PI * row / rows;
    for (let column = 0; column < columns; ++column) {
      const phi = 2 * Math.PI * column / columns;
      lines.push(`v ${Math.sin(theta) * Math.cos(phi)} ${Math.sin(theta) * Math.sin(phi)} ${Math.cos(theta)}`);
    }
  }
  for (let column = 0; column < columns; ++column) {
    lines.push(`f 1 ${vertex(1, column)} ${vertex(1, column + 1)}`, `f 2 ${vertex(rows - 1, column + 1)} ${vertex(rows - 1, column)}`);
    for (let row = 1; row < rows - 1; ++row)
      lines.push(`f ${vertex(row, column)} ${vertex(row + 1, column)} ${vertex(row + 1, column + 1)} ${vertex(row, column + 1)}`);
  }
  return lines.join("\n");
}

/// A cylinder as PLY: `sides` quadrilaterals, and a polygon of `sides` corners at each end.
function cylinderPly(sides) {
  const ring = [...Array(sides).keys()], next = (i) => (i + 1) % sides;
  const point = (i, z) => `${Math.cos(2 * Math.PI * i / sides)} ${Math.sin(2 * Math.PI * i / sides)} ${z}`;
  return ["ply", "format ascii 1.0", `element vertex ${2 * sides}`, "property float x", "property float y", "property float z",
          `element face ${sides + 2}`, "property list uchar int vertex_indices", "end_header",
          ...ring.map((i) => point(i, 0)), ...ring.map((i) => point(i, 1)),
          ...ring.map((i) => `4 ${i} ${next(i)} ${sides + next(i)} ${sides + i}`),
          `${sides} ${ring.map((i) => sides + i).join(" ")}`, `${sides} ${ring.reverse().join(" ")}`, ""].join("\n");
}

/// Chooses a file with this text, as a user does with the button "your model".
function chooseFile(browser, name, text) {
  return browser.value(`{
    const files = new DataTransfer();
    files.items.add(new File([${JSON.stringify(text)}], ${JSON.stringify(name)}));
    document.getElementById("file").files = files.files;
    document.getElementById("file").dispatchEvent(new Event("change"));
  }`);
}

async function touch(browser, address) {
  await browser.open(address, kWidth, kHeight);
  await browser.until("window.tactus?.opened != null || window.tactus?.error != null", 20);
  const reason = await browser.value("window.tactus.error");
  if (reason !== null) throw new Error(reason);
  await browser.until("window.tactus.frames > 0", 5);
  await browser.mouse("mouseMoved", kCentre.x, kCentre.y, false);
  await browser.mouse("mousePressed", kCentre.x, kCentre.y, true);
  await browser.until("window.tactus.users[11] === 1 && window.tactus.users[12] === 1", 10);
  const seconds = await browser.value("performance.now()") / 1e3;
  check("first exact touch after the page was opened", `${seconds.toFixed(2)} s`, seconds <= 3, "<= 3 s");

  await slide(browser, 6000);
  writeFileSync(screenshot, await browser.screenshot());
  const force = await browser.value("Math.hypot(...window.tactus.users.slice(6, 9))");
  check("force while pressed", `${force.toFixed(2)} N`, force > 0.3, "> 0.3 N");
  const ann = await browser.value("window.tactus.users[13 + 10]");
  check("the second user has a probe", ann, ann === 1, "1");
  const figures = await browser.value("[...window.tactus.figures]");
  const exact = 100 * figures[2] / figures[1];
  check("share of exact contact", `${exact.toFixed(2)} %`, exact >= 98, ">= 98 %");
  check("vertex splits received", `${figures[5]} of ${figures[6]}`, figures[5] > 0 && figures[5] < figures[6], "some");
  check("faces at full resolution", figures[8], figures[8] > 500, "> 500");
  // Without a graphics processor, the browser draws in threads that take the processors from the session.
  const drawing = await browser.value("window.tactus.timing");
  report("time between two cycles, p99, while drawing", `${drawing.period.p99.toFixed(2)} ms`);
  await browser.value("window.tactus.isDrawing = false");
  await slide(browser, 6000);
  const timing = await browser.value("window.tactus.timing");
  await browser.value("window.tactus.isDrawing = true");
  const checkTime = cpus().length >= 4 ? check : report;  // on fewer, the browser's other threads delay the session
  checkTime("time between two cycles, p99, without drawing", `${timing.period.p99.toFixed(2)} ms`, timing.period.p99 <= 1.5, "<= 1.5 ms");
  checkTime("time of a cycle, max, without drawing", `${timing.step.max.toFixed(2)} ms`, timing.step.max <= 4, "<= 4 ms");

  await browser.mouse("mouseReleased", kCentre.x, kCentre.y, false);
  await pause(700);
  const released = await browser.value("Math.hypot(...window.tactus.users.slice(6, 9))");
  check("force after the button was released", `${released.toFixed(2)} N`, released === 0, "0 N");

  await browser.value(`document.getElementById("delay").value = 150;
                       document.getElementById("delay").dispatchEvent(new Event("input"));
                       document.getElementById("small").click()`);
  await browser.until("window.tactus.frames > 0 && window.tactus.figures[10] > 0", 20);
  const trip = await browser.value("window.tactus.figures[10]");
  check("round trip of a new session with a delay of 150 ms", `${trip.toFixed(0)} ms`, trip >= 300 && trip < 500, "300 to 500");
  await chooseFile(browser, "ball.obj", ballObj(40, 60));
  await browser.until("window.tactus.figures[9] !== 60000", 20);
  const faces = await browser.value("window.tactus.figures[9]");
  check("faces of a chosen OBJ file", faces, faces === 2 * 39 * 60, "4680");
  await chooseFile(browser, "cylinder.ply", cylinderPly(200));
  await browser.until("window.tactus.figures[9] !== 4680", 20);
  const polygons = await browser.value("window.tactus.figures[9]");
  check("faces of a PLY file with two polygons of 200 corners", polygons, polygons === 2 * 200 + 2 * 198, "796");
  const error = await browser.value("window.tactus.error");
  check("errors", [error, ...browser.log].filter(Boolean).join("; ") || 0, error === null && browser.log.length === 0, "0");

  await chooseFile(browser, "notes.obj", "no triangles here");
  await browser.until("window.tactus.error !== null", 10);
  const message = await browser.value("document.getElementById('message').textContent");
  check("message for a file without triangles", message, message === "notes.obj: found no triangle", "names it");
  await chooseFile(browser, "half.ply", cylinderPly(200).slice(0, 3000));
  await browser.until("document.getElementById('message').textContent.includes('truncated')", 10);
}

/// Chooses a model while the first worker runs `script`, and so has not started a session.
async function chooseBeforeStart(browser, address, script, isReady, name) {
  await browser.open(address, kWidth, kHeight, `{
    let first = ${JSON.stringify(script)};
    window.Worker = class extends Worker {
      constructor(address) {
        super(first ?? address);
        first = null;
      }
    };
  }`);
  await browser.until(isReady, 20);
  await browser.value("document.getElementById('small').click()");
  await browser.until("window.tactus.frames > 0 || window.tactus.error !== null", 20).catch(() => {});
  const [frames, error] = await browser.value("[window.tactus.frames, window.tactus.error]");
  check(`frames of a model that is chosen ${name}`, error ?? frames, frames > 0 && error === null, "> 0");
}

async function chooseBeforeAnyStart(browser, address) {
  await chooseBeforeStart(browser, address, "data:text/javascript,", "window.tactus !== undefined",
                          "before the first worker has started");
  await chooseBeforeStart(browser, address, "missing.js", "window.tactus?.error != null", "after the first worker has failed");
}

/// Rises and falls between 0 and 1.
function triangleWave(ms, period) {
  const at = ms % period, half = Math.floor(period / 2);
  return (at < half ? at : period - at) / half;
}

/// Makes the motions of touch_trace.cpp in this process.
async function compareWithNative() {
  const native = execFileSync(trace, { encoding: "utf8" }).trim().split("\n");
  const create = require(resolve(folder, "tactus.js"));
  const tactus = await create({ wasmBinary: readFileSync(join(folder, "tactus.wasm")) });
  if (!tactus._tactus_open_organ(60000, 0.16, 1)) throw new Error(tactus.UTF8ToString(tactus._tactus_error()));
  const top = tactus.HEAPF64[tactus._tactus_bounds() / 8 + 5];
  let faces = 0, differing = 0, contacts = 0;
  native.forEach((line, ms) => {
    if (ms % 16 === 0)
      tactus._tactus_move_hand(0.03 * triangleWave(ms, 1900) - 0.015, 0.03 * triangleWave(ms, 2300) - 0.015,
                               top + 0.02 - 0.05 * triangleWave(ms, 3000));
    tactus._tactus_step();
    if (ms % 100 === 99 && tactus._tactus_update_mesh()) faces = tactus.HEAPF64[tactus._tactus_figures() / 8 + 7];
    const user = tactus._tactus_users() / 8;
    const [inContact, exact] = tactus.HEAPF64.subarray(user + 11, user + 13);
    contacts += inContact;
    if (line !== `${inContact} ${inContact * exact} ${faces}`) ++differing;
  });
  check("contact, ms, of the native build's path", `${contacts} of ${native.length}`, contacts > 1000, "> 1000");
  check("ms in which the native build differs", differing, differing === 0, "0");
}

const browser = new Browser(process.env.CHROMIUM ?? "chromium-headless-shell");
serve(folder, 0, (address, server) => {
  const runs = [() => touch(browser, address), () => chooseBeforeAnyStart(browser, address), () => trace && compareWithNative()];
  runs.reduce((before, run) => before.then(run), Promise.resolve()).catch((error) => {
    console.error(`page_test.js: ${error.message}; console: ${browser.log.join("; ") || "empty"}`);
    isBroken = true;
  }).finally(() => {
    browser.close();
    server.close();
    process.exit(isBroken ? 2 : exitStatus());
  });
});
