// Decodes the binary frames of a viewer (docs/reference/viewer-frames.md).
const kMesh = 1, kProbes = 2, kRegions = 3;
const kProbeBytes = 80, kPoseBytes = 32, kRegionBytes = 20;

function readMesh(buffer, view) {
  const count = view.getUint32(16, true);
  return {
    object: view.getUint32(4, true),
    isWhole: (view.getUint32(8, true) & 1) !== 0,
    rows: view.getUint32(12, true),
    faces: view.getUint32(20, true),
    hash: view.getBigUint64(24, true),
    changed: new Uint32Array(buffer, 32, count),  // row numbers; bit 31: the face has its finest version
    corners: new Float32Array(buffer, 32 + 4 * count, 9 * count),
  };
}

function readProbe(buffer, view, at) {
  const floats = new Float32Array(buffer, at + 16, 16);
  return {
    user: view.getBigUint64(at, true).toString(),
    status: view.getUint32(at + 8, true),
    object: view.getUint32(at + 12, true),
    device: floats.subarray(0, 3),
    orientation: floats.subarray(3, 7),
    proxy: floats.subarray(7, 10),
    force: floats.subarray(10, 13),
    radius: floats[13],
    errorBound: floats[14],
    age: floats[15],
  };
}

function readProbes(buffer, view) {
  const probes = [], poses = [];
  let at = 24;
  for (let i = 0; i < view.getUint32(4, true); ++i, at += kProbeBytes) probes.push(readProbe(buffer, view, at));
  for (let i = 0; i < view.getUint32(8, true); ++i, at += kPoseBytes) {
    const floats = new Float32Array(buffer, at + 4, 7);
    poses.push({ object: view.getUint32(at, true), position: floats.subarray(0, 3), orientation: floats.subarray(3, 7) });
  }
  return { sessionTime: view.getFloat64(16, true), probes, poses };
}

/// `regions`: [{mark: 1 resident, 2 predicted, 3 contact; x, y, z: lowest corner of the cell; edge}]
function readRegions(view) {
  const regions = [];
  for (let i = 0, at = 16; i < view.getUint32(8, true); ++i, at += kRegionBytes)
    regions.push({ mark: view.getUint32(at, true), x: view.getFloat32(at + 4, true), y: view.getFloat32(at + 8, true),
                   z: view.getFloat32(at + 12, true), edge: view.getFloat32(at + 16, true) });
  return { object: view.getUint32(4, true), regions };
}

/// Returns {mesh}, {marked: regions of an object} or {probes, poses, sessionTime}.
export function readFrame(buffer) {
  const view = new DataView(buffer);
  switch (view.getUint32(0, true)) {
    case kMesh:
      return { mesh: readMesh(buffer, view) };
    case kRegions:
      return { marked: readRegions(view) };
    case kProbes:
      return readProbes(buffer, view);
    default:
      throw new Error(`frame of unknown kind ${view.getUint32(0, true)}`);
  }
}
