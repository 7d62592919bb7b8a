// Reads the triangles of a model file with the loaders of three.js. The session itself reads PLY files (worker.js).
import { BufferGeometry, Matrix4, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { OBJLoader } from "three/addons/loaders/OBJLoader.js";
import { STLLoader } from "three/addons/loaders/STLLoader.js";

const kMaxBytes = 400e6;
const kParsers = {
  stl: (bytes) => new STLLoader().parse(bytes),
  obj: (bytes) => new OBJLoader().parse(new TextDecoder().decode(bytes)),
  glb: async (bytes) => (await new GLTFLoader().parseAsync(bytes, "")).scene,
};

/// The geometries of a parsed file, each with its transform.
function partsOf(parsed) {
  if (parsed instanceof BufferGeometry) return [{ geometry: parsed, matrix: new Matrix4() }];
  const parts = [];
  parsed.updateMatrixWorld(true);
  parsed.traverse((node) => {
    if (!node.isMesh) return;
    for (let i = 0; i < (node.isInstancedMesh ? node.count : 1); ++i) {
      const matrix = node.matrixWorld.clone();
      if (node.isInstancedMesh) {
        const instance = new Matrix4();
        node.getMatrixAt(i, instance);
        matrix.multiply(instance);
      }
      parts.push({ geometry: node.geometry, matrix });
    }
  });
  return parts;
}

/// Returns {positions: Float32Array of x y z, faces: Uint32Array of three vertices each}, or {ply: ArrayBuffer} for a PLY
/// file. Throws an Error with the reason if the file has no triangles.
export async function readModel(file) {
  const ending = file.name.toLowerCase().replace(/^.*\./, ""), parse = kParsers[ending];
  if (!parse && ending !== "ply") throw new Error("found an unknown ending, expected .ply, .stl, .obj or .glb");
  if (file.size === 0) throw new Error("found an empty file");
  if (file.size > kMaxBytes) throw new Error(`found ${file.size} bytes, expected at most ${kMaxBytes}`);
  if (ending === "ply") return { ply: await file.arrayBuffer() };
  const parts = partsOf(await parse(await file.arrayBuffer()));
  const vertexCount = ({ geometry }) => geometry.getAttribute("position")?.count ?? 0;
  const cornerCount = ({ geometry }) => 3 * Math.floor((geometry.index?.count ?? vertexCount({ geometry })) / 3);
  const sum = (count) => parts.reduce((total, part) => total + count(part), 0);
  const positions = new Float32Array(3 * sum(vertexCount)), faces = new Uint32Array(sum(cornerCount));
  if (faces.length === 0) throw new Error("found no triangle");
  const position = new Vector3();
  let vertex = 0, corner = 0;
  for (const part of parts) {
    const attribute = part.geometry.getAttribute("position"), indices = part.geometry.index;
    const mirrored = part.matrix.determinant() < 0;
    for (let i = 0; i < vertexCount(part); ++i)
      position.fromBufferAttribute(attribute, i).applyMatrix4(part.matrix).toArray(positions, 3 * (vertex + i));
    for (let i = 0; i < cornerCount(part); i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => vertex + (indices ? indices.getX(i + k) : i + k));
      faces.set(mirrored ? [a, c, b] : [a, b, c], corner);
      corner += 3;
    }
    vertex += vertexCount(part);
  }
  return { positions, faces };
}
