// The page "Touch it now": shows the session that worker.js runs, and moves the first user's hand by the pointer.
import { Chart } from "./chart.js";
import { readModel } from "./model_file.js";
import { PointedHand } from "./pointed_hand.js";
import { Scene } from "./scene.js";

const kUserNumbers = 13;
const kColours = ["#6fc3ff", "#c79bff"];  // you, ann
const kSliders = ["delay", "jitter", "loss", "rate"];
const kDefaults = { delay: 20, jitter: 1, loss: 0, rate: 20 };  // ms, ms, %, Mbit/s
const kSoftwareIntervalMs = 60;           // min time between two pictures without a graphics processor
const kFaces = 60000, kMinFaces = 1000, kMaxFaces = 2000000;   // of the generated organ

const element = (id) => document.getElementById(id);
const parameters = new URLSearchParams(location.search);
/// The number of a parameter of the address within [low, high], or the default.
function parameter(name, fallback, low, high) {
  const value = parameters.has(name) ? Number(parameters.get(name)) : fallback;
  return Number.isFinite(value) ? Math.min(Math.max(value, low), high) : fallback;
}

/// For tests and curious users: the newest figures, and a switch for drawing.
const state = window.tactus = { users: null, figures: null, timing: null, opened: null, error: null, frames: 0,
                                isDrawing: true };

function say(text, isError = false) {
  element("message").textContent = text;
  element("message").classList.toggle("error", isError);
}

function showError(text) {
  state.error = text;
  say(text, true);
}

const chart = new Chart(element("chart"), kColours);

// ---- link ----

/// Reads the sliders and shows their values.
function readSliders() {
  const value = Object.fromEntries(kSliders.map((name) => [name, Number(element(name).value)]));
  const link = { ...value, jitter: Math.min(value.jitter, value.delay), rate: 10 ** value.rate };
  const show = (name, text) => { element(name).nextElementSibling.textContent = text; };
  show("delay", `${link.delay} ms`);
  show("jitter", `${link.jitter} ms`);
  show("loss", `${link.loss.toFixed(1)} %`);
  show("rate", `${link.rate.toFixed(link.rate < 10 ? 1 : 0)} Mbit/s`);
  return link;
}

function addressOf(link) {
  const address = new URL(location.href);
  for (const name of kSliders) address.searchParams.set(name, Number(link[name].toPrecision(3)));
  return address;
}

for (const name of kSliders) {
  const value = parameter(name, kDefaults[name], name === "rate" ? 0.1 : 0, 1000);
  element(name).value = name === "rate" ? Math.log10(value) : value;
  element(name).addEventListener("input", () => worker.postMessage({ link: readSliders() }));
  element(name).addEventListener("change", () => history.replaceState(null, "", addressOf(readSliders())));
}

// ---- object ----

let worker = null, newestFrame = null, reading = 0;
let ready = false;  // the first mesh was drawn, so that the pointer can hit it
let reportStart = null;
/// Waits for the first message or error of any worker. The first worker may end before it sends one.
const workerStarted = new Promise((resolve) => { reportStart = resolve; });

/// Starts a session in a new worker, which also ends a build that is under way.
function open(model, text) {
  worker?.terminate();
  worker = new Worker("worker.js");
  worker.onmessage = (event) => { reportStart(); receive(event); };
  worker.onerror = (event) => {
    reportStart();  // so that another model can be chosen
    showError(event.message || "the session could not start");
  };
  ready = false;
  newestFrame = null;
  hand.clear();
  Object.assign(state, { opened: null, error: null, frames: 0 });
  chart.clear();
  say(text);
  worker.postMessage({ open: model, link: readSliders() },
                     model.ply ? [model.ply] : model.positions ? [model.positions.buffer, model.faces.buffer] : []);
}

function openOrgan(faces) {
  ++reading;
  const seed = Math.round(parameter("seed", 1, 0, 2 ** 32 - 1));
  open({ faces, seed }, `building the model of an organ with ${faces.toLocaleString("en")} faces`);
}

async function openFile(file) {
  const number = ++reading;
  say(`reading ${file.name}`);
  try {
    const model = await readModel(file);
    if (number !== reading) return;  // another model was chosen since
    open(model, `building the model of ${file.name}`);
  } catch (error) {
    if (number === reading) showError(`${file.name}: ${error.message}`);
  }
}

element("small").addEventListener("click", () => openOrgan(kFaces));
element("large").addEventListener("click", () => openOrgan(5 * kFaces));
element("file").addEventListener("change", ({ target }) => {
  if (target.files[0]) openFile(target.files[0]);
  target.value = "";  // so that the same file can be chosen again
});
for (const name of ["dragenter", "dragover", "dragleave", "drop"]) {
  document.addEventListener(name, (event) => {
    event.preventDefault();
    document.body.classList.toggle("drop", name === "dragenter" || name === "dragover");
    if (name === "drop" && event.dataTransfer.files[0]) openFile(event.dataTransfer.files[0]);
  });
}

// ---- hand ----

const hand = new PointedHand(element("scene"), (event) => scene.pick(event));

function moveHand() {
  if (!ready) return;
  hand.readGamepad(performance.now());
  const target = hand.target();
  if (target) worker.postMessage({ hand: target });
}

document.addEventListener("visibilitychange", () => worker.postMessage({ paused: document.hidden }));

// ---- frames ----

const megabytes = (bytes) => `${(bytes / 1e6).toFixed(bytes < 1e6 ? 3 : 2)} MB`;
const count = (number) => Math.round(number).toLocaleString("en");

function showFigures({ figures, users, timing, forces }) {
  const [, , , , payload, records, allRecords, faces, fine, allFaces, roundTrip] = figures;
  const [inContact, exact] = users.subarray(11, 13);
  element("force").textContent = `${Math.hypot(...users.subarray(6, 9)).toFixed(2)} N`;
  element("contact").textContent = !inContact ? "none" : exact ? "exact" : `within ${(1e3 * users[9]).toFixed(2)} mm`;
  element("contact").className = !inContact ? "" : exact ? "exact" : "coarse";
  element("received").textContent = megabytes(payload);
  element("records").textContent = `${count(records)} of ${count(allRecords)}`;
  element("faces").textContent = `${count(faces)} of ${count(allFaces)}`;
  element("fine").textContent = count(fine);
  element("roundtrip").textContent = roundTrip > 0 ? `${roundTrip.toFixed(0)} ms` : "not measured yet";
  if (timing)
    element("cycle").textContent = `${timing.period.p50.toFixed(2)} ms (p99 ${timing.period.p99.toFixed(2)})`;
  for (const sample of forces) chart.add(sample);
}

function receive({ data }) {
  if (data.error) {
    ready = false;
    showError(data.error);
  } else if (data.started) {
    // Only `workerStarted` waits for this.
  } else if (data.opened) {
    state.opened = data.opened;
    scene.open(data.opened.bounds, data.opened.scale);
    say("");
  } else {
    newestFrame = data.frame;
  }
}

function drawFrame(frame) {
  const spareMesh = frame.mesh ? scene.setMesh(frame.mesh) : null;
  worker.postMessage({ drawn: spareMesh }, spareMesh ? Object.values(spareMesh) : []);
  if (state.isDrawing) {
    scene.setUsers(frame.users, kUserNumbers);
    showFigures(frame);
  }
  Object.assign(state, { users: frame.users, figures: frame.figures, timing: frame.timing ?? state.timing });
  ++state.frames;
  if (frame.mesh) ready = true;
}

let drawnMs = 0;

/// Without a graphics processor, everything is drawn less often, so that the session has time to run.
function draw(now) {
  requestAnimationFrame(draw);
  if (scene.isSoftware && now - drawnMs < kSoftwareIntervalMs) return;
  drawnMs = now;
  if (newestFrame) {
    const frame = newestFrame;
    newestFrame = null;
    drawFrame(frame);
  }
  moveHand();
  if (!state.isDrawing) return;
  scene.draw();
  chart.draw();
}

function makeScene() {
  try {
    return new Scene(element("scene"), kColours);
  } catch (error) {
    showError(`this browser cannot draw: ${error.message}`);
    throw error;
  }
}

// Without a graphics processor, the browser takes half a second to make the scene. Meanwhile the worker builds the model;
// it can start only while this thread is idle.
openOrgan(Math.round(parameter("faces", kFaces, kMinFaces, kMaxFaces)));
await workerStarted;
const scene = makeScene();
requestAnimationFrame(draw);
