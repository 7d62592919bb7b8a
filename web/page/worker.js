// Runs one session of the page: loads the WebAssembly module, builds the model, advances the session by one step in each
// millisecond, and sends a frame whenever the page has drawn the previous one. The page starts a new worker for another
// model.
//
// Messages from the page: {open: {faces, seed} or {positions, faces, name}, link}, {link}, {hand: [x, y, z]}, {paused},
// {drawn: the buffers of a mesh that the page no longer draws, or null}. Messages to the page: {started} when it has read
// `open`, {opened: {...}}, {frame: {figures, users, forces, timing, mesh}}, {error: text}.
importScripts("tactus.js");

const kFigures = 11, kUsers = 2, kUserNumbers = 13;
const kSize = 0.16;          // m, longest side of the object
const kMaxFaces = 3000000;   // with 1,000,000 faces, the memory grows to 214 MB; the module may use 2 GB
const kWarmUpSteps = 500;    // steps before the first frame, in which the browser optimizes the code
const kMaxBehind = 100;      // ms; a session that is further behind does not catch up
const kMaxStepsPerTurn = 20;
const kMeshIntervalMs = 50;  // min time between two meshes
const kSpareMesh = 2;        // size of a mesh's buffers over the size of the mesh
const kForceIntervalMs = 20; // time between two forces of the chart
const kMaxForces = 300;
const kTimingIntervalMs = 500;

let tactus, link, running = false, failed = false, paused = false, pageIsReady = true;
let started = 0, steps = 0, lastMesh = 0, lastTiming = 0, lastStep = 0;
let spareMesh = null;  // buffers of an earlier mesh; copies into new ones would take ten times as long
let forces = [];  // since the last frame: {seconds, forces: N by user}
const periods = new Float32Array(5000), durations = new Float32Array(5000);  // of the newest steps, ms

// Each turn of the loop ends with a message to itself, so that messages of the page are read between turns. A worker may
// block in Atomics.wait, which needs shared memory. A worker may create it; only sending it to another thread needs
// special headers of the server. Without it, the loop does not sleep.
const channel = new MessageChannel();
channel.port1.onmessage = runTurn;
const nextTurn = () => channel.port2.postMessage(0);
let sleeper = null;
try {
  sleeper = new Int32Array(new WebAssembly.Memory({ initial: 1, maximum: 1, shared: true }).buffer);
} catch {
  console.warn("no shared memory: the session does not sleep between its cycles");
}

function fail(error) {
  failed = true;
  running = false;
  postMessage({ error: error instanceof Error ? error.message : "the session failed; reload the page" });
}

function require(succeeded) {
  if (!succeeded) throw new Error(tactus.UTF8ToString(tactus._tactus_error()));
}

function numbers(address, count) {
  return tactus.HEAPF64.slice(address / 8, address / 8 + count);
}

function applyLink() {
  require(tactus._tactus_set_link(link.delay, link.jitter, link.loss, link.rate));
}

function openMesh({ positions, faces }) {
  require(tactus._tactus_allocate_mesh(positions.length / 3, faces.length / 3));
  tactus.HEAPF32.set(positions, tactus._tactus_mesh_positions() / 4);
  tactus.HEAPU32.set(faces, tactus._tactus_mesh_faces() / 4);
  require(tactus._tactus_open_mesh(kSize, 1));
}

/// Reads a PLY file into the memory of the session. Returns the number of its faces.
function readPly(bytes) {
  const address = tactus._tactus_allocate_file(bytes.byteLength);
  require(address !== 0);
  tactus.HEAPU8.set(new Uint8Array(bytes), address);
  const faces = tactus._tactus_read_ply();
  require(faces >= 0);
  if (faces === 0) throw new Error("found no triangle");
  return faces;
}

async function open(model) {
  postMessage({ started: true });
  tactus = await createTactus();
  const began = performance.now();
  const faceCount = model.ply ? readPly(model.ply) : model.positions ? model.faces.length / 3 : model.faces;
  if (faceCount > kMaxFaces)
    throw new Error(`found ${faceCount} faces, expected at most ${kMaxFaces}; use tactus mesh build for larger models`);
  if (model.ply) require(tactus._tactus_open_mesh(kSize, 1));
  else if (model.positions) openMesh(model);
  else require(tactus._tactus_open_organ(model.faces, kSize, model.seed));
  applyLink();
  for (let i = 0; i < kWarmUpSteps; ++i) require(tactus._tactus_step());
  postMessage({ opened: { bounds: [...numbers(tactus._tactus_bounds(), 6)], scale: tactus._tactus_metres_per_unit(),
                          milliseconds: performance.now() - began } });
  run(!paused);
}

function step(now) {
  require(tactus._tactus_step());
  durations[steps % durations.length] = performance.now() - now;
  periods[steps % periods.length] = now - lastStep;
  ++steps;
  lastStep = now;
  if (steps % kForceIntervalMs !== 0) return;
  const users = tactus._tactus_users() / 8;
  const force = (user) => Math.hypot(...tactus.HEAPF64.subarray(users + kUserNumbers * user + 6, users + kUserNumbers * user + 9));
  forces.push({ seconds: steps / 1e3, forces: [force(0), force(1)] });
  if (forces.length > kMaxForces) forces.shift();
}

function percentiles(samples) {
  const sorted = samples.slice(0, Math.min(steps, samples.length)).sort();
  const at = (share) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] ?? 0;
  return { p50: at(0.5), p99: at(0.99), max: at(1) };
}

/// Copies the shown mesh into buffers that can be sent to the page.
function copyMesh() {
  const count = tactus._tactus_shown_faces(), corners = tactus._tactus_corners() / 4, fine = tactus._tactus_fine();
  const isLargeEnough = spareMesh && spareMesh.fine.byteLength >= count;
  const { corners: cornerBytes, fine: fineBytes } = isLargeEnough ? spareMesh :
    { corners: new ArrayBuffer(9 * 4 * kSpareMesh * count), fine: new ArrayBuffer(kSpareMesh * count) };
  spareMesh = null;
  const mesh = { corners: new Float32Array(cornerBytes, 0, 9 * count), fine: new Uint8Array(fineBytes, 0, count) };
  mesh.corners.set(tactus.HEAPF32.subarray(corners, corners + 9 * count));
  mesh.fine.set(tactus.HEAPU8.subarray(fine, fine + count));
  return mesh;
}

function sendFrame(now) {
  const frame = { users: numbers(tactus._tactus_users(), kUsers * kUserNumbers), forces };
  const transfer = [];
  forces = [];
  if (now - lastMesh >= kMeshIntervalMs) {
    lastMesh = now;
    const changed = tactus._tactus_update_mesh();
    require(changed >= 0);
    if (changed > 0) {
      frame.mesh = copyMesh();
      transfer.push(frame.mesh.corners.buffer, frame.mesh.fine.buffer);
    }
  }
  if (now - lastTiming >= kTimingIntervalMs) {
    lastTiming = now;
    frame.timing = { period: percentiles(periods), step: percentiles(durations) };
  }
  frame.figures = numbers(tactus._tactus_figures(), kFigures);
  pageIsReady = false;
  postMessage({ frame }, transfer);
}

function runTurn() {
  if (!running) return;
  try {
    let now = performance.now();
    if (now - started - steps > kMaxBehind) started = now - steps;
    for (let i = 0; i < kMaxStepsPerTurn && steps < now - started; ++i) {
      step(now);
      now = performance.now();
    }
    if (pageIsReady) sendFrame(now);
    const remaining = started + steps - performance.now();
    if (sleeper && remaining > 0.05) Atomics.wait(sleeper, 0, 0, remaining);
    nextTurn();
  } catch (error) {
    fail(error);
  }
}

/// Starts or stops the loop.
function run(wanted) {
  if (failed || wanted === running) return;
  running = wanted;
  if (!running) return;
  lastStep = performance.now();
  started = lastStep - steps;
  nextTurn();
}

onmessage = async ({ data }) => {
  try {
    if (data.link) link = data.link;
    if (data.open) await open(data.open);
    else if (data.link && running) applyLink();
    else if (data.hand && running) require(tactus._tactus_move_hand(...data.hand));
    else if (data.drawn !== undefined) {
      spareMesh = data.drawn ?? spareMesh;
      pageIsReady = true;
    }
    else if (data.paused !== undefined) {
      paused = data.paused;
      if (tactus && link) run(!paused);
    }
  } catch (error) {
    fail(error);
  }
};
