// The page of a viewer: shows the session whose frames arrive over one WebSocket.
import { readFrame } from "./frames.js";
import { drawFronts, makeFronts } from "./fronts.js";
import { History } from "./history.js";
import { PointedHand } from "../../web/page/pointed_hand.js";
import { Strip } from "./strip.js";
import { ViewScene, kRegionLayers } from "./view_scene.js";

const kColours = ["#6fc3ff", "#c79bff", "#7fd88f", "#ff9d9d", "#ffd36f", "#6fe3d6", "#ff9be0", "#b6d96f"];  // of users
const kReconnectMs = 500;
const kSilentMs = 1500;    // a page that reports what it has seen gets a frame every 15 ms, so a connection without any is dead
const kSeekMs = 150;       // a seek waits for further movements of the slider
const kCameraMs = 250;     // min time between two views for the viewer
const kHandMs = 8;         // min time between two targets of the hand
const kRefused = 1008;     // code with which the viewer closes the connection of a page that it refuses
// Min time between two pictures without a graphics processor. Every second frame of a screen with 60 Hz is drawn.
const kSoftwareIntervalMs = 25;
const kContact = 1, kExact = 2, kFault = 1 << 8, kHolding = 1 << 11;  // docs/reference/status-bits.md
const kNoObject = 0xffffffff;

const element = (id) => document.getElementById(id);
/// For tests and curious users: the newest messages and what is drawn.
const state = window.tactus = { scene: null, probes: [], poses: [], figures: null, hashes: {}, losses: {}, fronts: {}, meshes: new Map(), regions: new Map(), connections: 0,
                                isConnected: false, isLive: true, playback: null, error: null, pictures: 0, firstPictureMs: null, touching: null };
const users = new Map();   // by id: {name, colour, hrtc}
const strips = new Map();  // by HRTC: {element, text, strips: by name, before}
const frontsOf = new Map();  // by object: {row, canvas}
const bytesSent = new Map();  // by host: {bytes, nowMs, rate}

let view;  // made by `start`

/// Sets the rows of a table. `rows`: lists of cells, each a text or an element.
function setRows(table, rows) {
  table.tBodies[0].replaceChildren(...rows.map((cells) => {
    const row = document.createElement("tr");
    row.append(...cells.map((cell) => {
      const data = document.createElement("td");
      data.append(cell);
      return data;
    }));
    return row;
  }));
}

function span(text, className = "") {
  const made = document.createElement("span");
  made.textContent = text;
  made.className = className;
  return made;
}

function named(name, colour) {
  const made = span("");
  const swatch = span("", "swatch");
  swatch.style.background = colour;
  made.append(swatch, name);
  return made;
}

// ---- messages ----

function showScene(message) {
  state.scene = { ...message, receivedMs: performance.now() };
  for (const { id, name, hrtc } of message.users)
    users.set(id, { colour: kColours[users.size % kColours.length], ...users.get(id), name, hrtc });
  view.setObjects(message.objects);
  for (const number of state.meshes.keys())
    if (!view.objects.has(number)) {
      state.meshes.delete(number);
      state.regions.delete(number);
    }
  showStop(message.stop);
  showPresence(message.participants);
  showHosts();
  const events = element("events");
  events.replaceChildren(...message.events.slice(-12).reverse().map(({ secondsAgo, text }) => {
    const item = document.createElement("li");
    const shownMs = state.playback ? 1e3 * (state.playback.began + state.playback.at) : Date.now();
    const clock = new Date(shownMs - 1e3 * secondsAgo).toLocaleTimeString("en", { hour12: false });
    item.append(span(`${clock} `, "soft"), text);
    return item;
  }));
  const follow = element("follow"), chosen = follow.value;
  follow.replaceChildren(new Option("nobody", ""), ...message.users.map(({ id, name }) => new Option(name, id)));
  follow.value = message.users.some(({ id }) => id === chosen) ? chosen : "";
  view.followed = follow.value || null;
  const hrtc = element("hrtc"), wanted = hrtc.value;
  const hrtcs = message.participants.filter(({ role }) => role === "hrtc").map(({ name }) => name);
  hrtc.replaceChildren(new Option("any HRTC", ""), ...hrtcs.map((name) => new Option(name, name)));
  hrtc.value = hrtcs.includes(wanted) ? wanted : "";
  const meshOf = element("mesh-of");
  meshOf.replaceChildren(new Option("all HRTCs", ""), ...hrtcs.map((name) => new Option(name, name)));
  meshOf.value = hrtcs.includes(message.shownHrtc) ? message.shownHrtc : "";
  updateTouch();
  showObjects();
  showFronts();
}

/// Says so if nobody serves this session: it has not begun, it has ended, or its name or domain is another one.
function showPresence(participants) {
  if (state.playback) return;
  const isEmpty = !participants.some(({ role }) => role === "host" || role === "hrtc");
  element("connection").textContent = isEmpty ? "connected; no host and no HRTC in this session" : "connected";
  element("connection").className = isEmpty ? "" : "open";
}

function showStop({ requested, hrtcs, stopped, missing = [] }) {
  const banner = element("banner");
  banner.hidden = !requested && stopped === 0;
  const isComplete = stopped === hrtcs && hrtcs > 0 && missing.length === 0;
  banner.textContent = isComplete ? "All forces are stopped. `tactus control reset` starts them again."
    : `${requested ? "Stop requested" : "Some forces are stopped"}: ${stopped} of ${hrtcs} HRTCs have stopped.`
      + (missing.length > 0 ? ` Not acknowledged by ${missing.join(", ")}.` : "");
}

function showUsers() {
  setRows(element("users"), state.probes.map((probe) => {
    const { name = "unknown user", colour = "#ffffff" } = users.get(probe.user) ?? {};
    const isTouching = (probe.status & kContact) !== 0;
    const object = state.scene?.objects.find(({ number }) => number === probe.object && number !== kNoObject)?.name ?? "";
    const contact = (probe.status & kFault) !== 0 ? span("force off", "fault")
      : !isTouching ? span("no contact", "soft")
      : (probe.status & kExact) !== 0 ? span("exact", "exact") : span(`within ${(1e3 * probe.errorBound).toFixed(2)} mm`, "coarse");
    return [named(name, colour), (probe.status & kHolding) !== 0 ? `holds ${object}` : object, contact,
            `${Math.hypot(...probe.force).toFixed(2)} N`];
  }));
}

/// The health of the hosts. A host that sends no roster entry for 250 ms may have failed.
function showHosts() {
  setRows(element("hosts"), (state.scene?.participants ?? []).filter(({ role }) => role === "host").map(({ name, late }) => {
    const figures = state.figures?.[name], rate = bytesSent.get(name)?.rate;
    const load = figures ? `${figures["host.objects"] ?? 0} objects, ${rate === undefined ? "-" : rate.toFixed(0)} kB/s` : "";
    return [name, span(load, "soft"), late ? span("late", "fault") : span("present", "exact")];
  }));
}

function updateHosts(participants, nowMs) {
  for (const [name, figures] of Object.entries(participants)) {
    const bytes = figures["host.bytes"], before = bytesSent.get(name);
    if (bytes === undefined || (before && nowMs - before.nowMs < 900)) continue;
    bytesSent.set(name, { bytes, nowMs, rate: before ? (bytes - before.bytes) / (nowMs - before.nowMs) : undefined });
  }
  for (const name of bytesSent.keys())
    if (!(name in participants)) bytesSent.delete(name);
  showHosts();
}

function showFronts() {
  const names = (state.scene?.objects ?? []).map(({ name }) => name);
  for (const [name, { row }] of frontsOf)
    if (!names.includes(name)) {
      row.remove();
      frontsOf.delete(name);
    }
  for (const name of names) {
    if (!state.fronts[name]) continue;
    if (!frontsOf.has(name)) {
      const row = document.createElement("div"), canvas = makeFronts();
      row.append(span(name, "soft"), canvas);
      element("fronts").append(row);
      frontsOf.set(name, { row, canvas });
    }
    drawFronts(frontsOf.get(name).canvas, state.fronts[name]);
  }
}

/// Names of the HRTCs whose mesh of an object is the shown one, by mesh hash.
function hrtcsWithMesh(number, name) {
  const hash = state.meshes.get(number)?.hash;
  return Object.entries(state.hashes).filter(([, hashes]) => hash && hashes[name] === hash).map(([hrtc]) => hrtc);
}

function showObjects() {
  setRows(element("objects"), (state.scene?.objects ?? []).map(({ number, name, host, faces }) => {
    const shown = view.objects.get(number), same = hrtcsWithMesh(number, name);
    const mesh = same.length > 0 ? span(`= ${same.join(", ")}`, "exact") : span("", "soft");
    mesh.title = `served by ${host}` + (same.length > 0 ? `; the same mesh as that of ${same.join(" and ")}` : "");
    return [name, mesh, `${(shown?.faces ?? 0).toLocaleString("en")} of ${faces.toLocaleString("en")}`];
  }));
}

/// Makes the element of an HRTC, with its strips.
function addStrips(name) {
  const shown = document.createElement("div");
  shown.className = "hrtc";
  const text = span("", "soft"), line = document.createElement("div"), grid = document.createElement("div");
  const interventions = span("", "soft interventions");
  grid.className = "strips";
  line.append(name, text);
  shown.append(line, interventions, grid);
  element("hrtcs").append(shown);
  const add = (...options) => {
    const strip = new Strip(...options);
    grid.append(strip.canvas);
    return strip;
  };
  strips.set(name, { element: shown, text, interventions, before: null,
                     strips: { cycle: add("cycle p99", "us", 50), age: add("state age", "ms", 50), exact: add("exact", "%", 100),
                               loss: add("lost states", "%", 5), rate: add("received", "kB/s", 10), cache: add("cache", "%", 100),
                               pool: add("pool", "%", 100) } });
}

/// Adds to the strips what has changed since the figures before.
function updateStrips(name, shown, figures, nowMs) {
  const { cycle, age, exact, loss, rate, cache, pool } = shown.strips, before = shown.before;
  const counts = { cycles: figures["hrtc.contact_cycles"], exact: figures["hrtc.exact_cycles"], bytes: figures["hrtc.bytes_received"], nowMs };
  if (before && counts.cycles === before.cycles && counts.bytes === before.bytes && nowMs - before.nowMs < 900) return;
  cycle.add(figures["hrtc.recent_cycle_us.p99"]);
  const ages = state.probes.filter(({ user }) => users.get(user)?.hrtc === name).map((probe) => 1e3 * probe.age);
  age.add(ages.length > 0 ? Math.max(...ages) : undefined);
  loss.add(100 * (state.losses[name] ?? 0));
  cache.add(100 * figures["hrtc.compressed_used"] / figures["hrtc.compressed_limit"]);
  pool.add(100 * figures["hrtc.pool_used"] / figures["hrtc.pool_limit"]);
  if (before) {
    const cycles = counts.cycles - before.cycles;
    exact.add(cycles > 0 ? 100 * (counts.exact - before.exact) / cycles : undefined);
    rate.add((counts.bytes - before.bytes) / (nowMs - before.nowMs));
  }
  shown.before = counts;
  for (const strip of Object.values(shown.strips)) strip.draw();
}

/// How often each safety limit of an HRTC became active, of those that did.
function interventions(figures) {
  const counts = Object.entries(figures).filter(([name, count]) => name.startsWith("safety.") && count > 0);
  return counts.map(([name, count]) => `${name.slice(7).replaceAll("_", " ")} ${count.toLocaleString("en")}`).join(", ");
}

function showFigures(message) {
  state.figures = message.participants;
  state.hashes = message.meshes;
  state.losses = message.losses;
  state.fronts = message.fronts;
  updateHosts(message.participants, performance.now());
  showFronts();
  const hrtcs = Object.entries(message.participants).filter(([, figures]) => "hrtc.cycles" in figures);
  for (const [name, { element: shown }] of strips) {
    if (hrtcs.some(([present]) => present === name)) continue;
    shown.remove();
    strips.delete(name);
  }
  for (const [name, figures] of hrtcs) {
    if (!strips.has(name)) addStrips(name);
    const shown = strips.get(name);
    const late = (figures["hrtc.overruns"] ?? 0) + (figures["hrtc.preempted"] ?? 0);
    const isLate = state.scene?.participants.some((each) => each.name === name && each.late);
    shown.text.textContent = `${isLate ? "late, " : ""}${Math.round(figures["hrtc.rate_hz"] ?? 0)} Hz, ${late.toLocaleString("en")} late cycles`;
    shown.text.className = isLate ? "fault" : "soft";
    shown.interventions.textContent = interventions(figures);
    updateStrips(name, shown, figures, performance.now());
  }
  showObjects();
}

/// Processes a message and reports it as seen. The viewer limits the unseen messages, so the browser queues no old states.
function receive({ data }) {
  receivedMs = performance.now();
  process(data);
  request({ seen: ++seen });
}

function process(data) {
  if (typeof data === "string") {
    const message = JSON.parse(data);
    if (message.type === "scene") showScene(message);
    else if (message.type === "figures") showFigures(message);
    else if (message.type === "playback") showPlayback(message);
    else if (message.type === "rights") {
      canRequest = message.control;
      document.body.classList.toggle("observer", !message.control);
      element("mesh-of").disabled = !message.control;
    }
    else if (message.type === "notice") endTouch(message.text);
    return;
  }
  history.add(readFrame(data), performance.now());
}

// ---- time ----

function applyMesh(mesh) {
  const before = view.applyMesh(mesh);
  if (before) state.meshes.set(mesh.object, { faces: mesh.faces, hash: mesh.hash.toString() });
  return before;
}

function applyRegions(marked) {
  const regions = view.applyRegions(marked);
  if (regions) state.regions.set(marked.object, marked.regions);
  return regions && { object: marked.object, regions };
}

const history = new History({
  apply(entry) {
    if (entry.frame.mesh) entry.before = applyMesh(entry.frame.mesh);
    if (entry.frame.marked) entry.before = applyRegions(entry.frame.marked);
  },
  undo(entry) {
    if (!entry.before) return;
    if (entry.frame.mesh) applyMesh(entry.before);
    else applyRegions(entry.before);
  },
  showProbes(frame) {
    state.probes = frame.probes;
    state.sessionTime = frame.sessionTime;
    state.poses = frame.poses;
    view.setProbes(frame, users);
  },
});

/// Drops all that the viewer has sent. The next frames have the whole state.
function forgetSession() {
  history.clear();
  state.meshes.clear();
  state.regions.clear();
  state.probes = [];
  view.setObjects([]);
}

/// Shows what part of a recording the viewer plays. The viewer stores the whole recording, so the page's history is
/// not used.
function showPlayback(playback) {
  if (state.playback === null || playback.restarts !== state.playback.restarts) forgetSession();
  const isNew = state.playback === null;
  state.playback = playback;
  document.body.classList.add("playback");
  const time = element("time");
  if (isNew) {
    element("connection").textContent = `recording ${playback.file}`;
    time.setAttribute("aria-label", "seconds after the begin");
  }
  time.min = 0;
  time.max = playback.seconds;
  if (!isSeeking) time.value = playback.at;
  element("pause").textContent = playback.isPlaying ? "Pause" : "Play";
  showAge();
}

let isSeeking = false;  // a user moves the slider
let seekTimer = null;

/// Requests another time of the recording, once the slider has rested for kSeekMs.
function seek(seconds) {
  isSeeking = true;
  clearTimeout(seekTimer);
  seekTimer = setTimeout(() => {
    isSeeking = false;
    request({ seek: seconds });
  }, kSeekMs);
}

/// Shows the session as it was `ago` milliseconds before now. 0: live.
function showTime(ago) {
  if (ago !== 0) giveBack("The probe was given back because the view is paused.");
  history.show(ago, performance.now());
  state.isLive = history.isLive;
  element("pause").textContent = history.isLive ? "Pause" : "Live";
  element("pause").classList.toggle("on", !history.isLive);
  document.body.classList.toggle("paused", !history.isLive);
  showAge();
}

function showAge() {
  if (state.playback) {
    element("ago").textContent = `${state.playback.at.toFixed(1)} of ${state.playback.seconds.toFixed(1)} s`;
    return;
  }
  const ago = history.isLive || history.shownMs() === null ? 0 : 1e-3 * (performance.now() - history.shownMs());
  element("ago").textContent = history.isLive ? "live" : `${ago.toFixed(1)} s ago`;
}

element("pause").addEventListener("click", () => {
  if (state.playback) return request({ play: !state.playback.isPlaying });
  element("time").value = 0;
  showTime(history.isLive ? 1 : 0);
});
element("time").addEventListener("input", ({ target }) => {
  if (state.playback) seek(Number(target.value));
  else showTime(-1e3 * Number(target.value));
});

// ---- touch ----

const hand = new PointedHand(element("scene"), (event) => view.pick(event));

function hint(text, isFault = false) {
  element("hint").textContent = text;
  element("hint").className = isFault ? "fault" : "soft";
}

function request(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function beginTouch() {
  const user = element("user").value.trim(), hrtc = element("hrtc").value;
  if (!element("user").validity.valid || user === "") {
    hint("The name needs 1 to 32 letters, digits or . _ -", true);
    return;
  }
  showTime(0);
  request({ touch: hrtc ? { user, hrtc } : { user } });
  state.touching = { user, isServed: false, grabsByPad: false, target: null, sentMs: 0 };
  hand.clear();
  hint("waiting for a probe");
  updateTouch();
}

/// `problem`: why the user has no probe any more; none if the page has given it back.
function endTouch(problem = "") {
  state.touching = null;
  hand.clear();
  hint(problem, problem !== "");
  updateTouch();
}

/// Gives the probe back, if there is one.
function giveBack(reason) {
  if (!state.touching) return;
  request({ release: true });
  endTouch(reason);
}

function updateTouch() {
  const touching = state.touching;
  const isServed = touching !== null && (state.scene?.users ?? []).some(({ name }) => name === touching.user);
  if (touching && isServed && !touching.isServed) hint("Press on an object to touch it. The right button turns the view.");
  if (touching) touching.isServed = touching.isServed || isServed;
  element("take").disabled = !state.isConnected;
  element("take").textContent = touching ? "Give back" : "Touch";
  element("take").classList.toggle("on", touching !== null);
  element("grab").disabled = !isServed;
  element("grab").classList.toggle("on", hand.isGrabbing);
  element("user").disabled = element("hrtc").disabled = touching !== null;
  view.setTouching(touching !== null);
}

function setGrab(grabs) {
  if (!state.touching?.isServed || hand.isGrabbing === grabs) return;
  hand.isGrabbing = grabs;
  updateTouch();
}

/// Sends the target of the hand. Called with each picture.
function moveHand(now) {
  if (!state.touching?.isServed) return;
  const grabsByPad = hand.readGamepad(now);
  if (grabsByPad !== state.touching.grabsByPad) setGrab(grabsByPad);
  state.touching.grabsByPad = grabsByPad;
  const probe = state.probes.find(({ user }) => users.get(user)?.name === state.touching.user);
  if (probe) hand.rumble(Math.hypot(...probe.force), (probe.status & kContact) !== 0, now);
  // Before the pointer has hit an object, the hand waits between the eye and the objects.
  state.touching.target = hand.target() ?? state.touching.target ?? view.pointBefore();
  if (now - state.touching.sentMs < kHandMs) return;
  state.touching.sentMs = now;
  request({ hand: { target: state.touching.target, grab: hand.isGrabbing } });
}

let canRequest = false;  // the viewer disconnects observers that send requests
let sentCamera = "", sentCameraMs = 0;

/// Sends the view if it has changed. Called with each picture.
function sendCamera(now) {
  if (!canRequest || !view.hasView || now - sentCameraMs < kCameraMs) return;
  const camera = view.cameraRequest(), text = JSON.stringify(camera);
  if (text === sentCamera) return;
  sentCamera = text;
  sentCameraMs = now;
  request({ camera });
}

element("take").addEventListener("click", () => {
  if (!state.touching) return beginTouch();
  giveBack("");
});
element("grab").addEventListener("click", () => setGrab(!hand.isGrabbing));
document.addEventListener("keydown", ({ key, repeat, target, ctrlKey, altKey, metaKey }) => {
  const isTyped = ["INPUT", "SELECT"].includes(target.tagName) || ctrlKey || altKey || metaKey;
  if (key.toLowerCase() === "g" && !repeat && !isTyped) setGrab(!hand.isGrabbing);
});
document.addEventListener("visibilitychange", () => {
  if (document.hidden) giveBack("The probe was given back because the page was hidden.");
});

// ---- connection ----

let socket = null;
let receivedMs = 0;  // time of the newest message
let seen = 0;        // number of messages of this connection
let silentChecks = 0;

/// Shows that the connection has ended, and connects again, unless the viewer refuses this page.
function lose(text, isFinal) {
  state.isConnected = false;
  element("connection").textContent = text;
  element("connection").className = "";
  element("stop").disabled = true;
  document.body.classList.add("lost");
  if (state.touching) endTouch("The connection to the viewer was lost, and with it the probe.");
  updateTouch();
  if (!isFinal) setTimeout(connect, kReconnectMs);
}

/// A network can fail without an end of the connection.
function checkConnection() {
  const isSilent = state.isConnected && performance.now() - receivedMs > kSilentMs;
  silentChecks = isSilent ? silentChecks + 1 : 0;
  if (silentChecks < 3) return;  // after a pause of the page itself, messages are still waiting
  socket.onmessage = socket.onclose = null;
  socket.close();
  lose("the viewer is silent; trying again", false);
}

/// Connects, and connects again whenever the connection ends. The first frames then have the whole state.
function connect() {
  socket = new WebSocket(`ws://${location.host}/session`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    ++state.connections;
    seen = 0;
    state.isConnected = true;
    receivedMs = performance.now();
    state.playback = null;
    canRequest = false;
    sentCamera = "";
    element("time").min = -30;
    element("time").max = element("time").value = 0;
    document.body.classList.remove("playback");
    forgetSession();
    showTime(0);
    if (location.hash) socket.send(JSON.stringify({ token: location.hash.slice(1) }));
    updateTouch();
    element("connection").textContent = "connected";
    element("connection").className = "open";
    element("stop").disabled = false;
    document.body.classList.remove("lost");
  };
  socket.onmessage = receive;
  socket.onclose = ({ code, reason }) => {
    const isRefused = code === kRefused;
    lose(isRefused ? `refused by the viewer: ${reason}` : "no connection to the viewer; trying again", isRefused);
  };
}

element("stop").addEventListener("click", () => request({ stop: "requested at the viewer's page" }));
element("resolution").addEventListener("change", ({ target }) => view.showResolution(target.checked));
element("wireframe").addEventListener("change", ({ target }) => { view.material.wireframe = target.checked; });
element("labels").addEventListener("change", ({ target }) => { view.showsNames = target.checked; });
element("forces").addEventListener("change", ({ target }) => { view.showsForces = target.checked; });
element("mesh-of").addEventListener("change", ({ target }) => request({ show: target.value }));
element("follow").addEventListener("change", ({ target }) => { view.followed = target.value || null; });

// ---- drawing ----

let drawnMs = 0;

function draw(now) {
  requestAnimationFrame(draw);
  if (now - drawnMs < state.minIntervalMs) return;
  drawnMs = now;
  moveHand(now);
  view.draw();
  sendCamera(now);
  ++state.pictures;
  if (state.firstPictureMs === null && state.meshes.size > 0) state.firstPictureMs = performance.now();
}

state.screenOf = (point) => view.screenOf(point);
state.isFineAt = (object, point, distance) => view.isFineAt(object, point, distance);
/// The switches of the layers of regions.
function makeLayers() {
  for (const { name, colour } of kRegionLayers) {
    element(name).checked = view.shownLayers.has(name);
    element(name).addEventListener("change", ({ target }) => view.shownLayers[target.checked ? "add" : "delete"](name));
    element(name).nextElementSibling.style.background = `#${colour.toString(16)}`;
  }
}

/// Connects and requests the tool, then makes the scene. Without a graphics processor, that takes half a second, in
/// which the first frames arrive.
function start() {
  connect();
  const tool = fetch("tool.json").then((answer) => answer.json());
  try {
    view = new ViewScene(element("scene"), element("names"));
  } catch (error) {
    state.error = error.message;
    socket.onopen = socket.onclose = null;
    socket.close();
    element("connection").textContent = `this browser cannot draw: ${error.message}`;
    return;
  }
  state.minIntervalMs = view.isSoftware ? kSoftwareIntervalMs : 0;
  tool.then((found) => {
    view.setTool(found);
    state.toolFaces = found?.faces.length ?? 0;
  }).catch((error) => { state.error = error.message; });
  fetch("session.json").then((answer) => answer.json()).then(({ isPlain }) => { element("plain").hidden = !isPlain; })
    .catch((error) => { state.error = error.message; });
  makeLayers();
  setInterval(() => {
    showUsers();
    showAge();
    checkConnection();
  }, 100);
  requestAnimationFrame(draw);
}
start();
