// Draws the object, the probes and the forces, and finds the point of the object under the pointer.
import * as three from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const kCoarse = [87, 107, 133], kFine = [237, 153, 69];  // colours of faces: below and at full resolution
const kTip = 0.003;           // m, radius of a probe
const kArrowPerNewton = 0.008;  // m

export function drawsInSoftware() {
  const context = document.createElement("canvas").getContext("webgl2");
  const names = context?.getExtension("WEBGL_debug_renderer_info");
  const renderer = names ? context.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(renderer);
}

/// A user's probe: the device (transparent), the proxy (solid), the spring between them and the force.
export class Probe {
  constructor(scene, colour) {
    const ball = new three.SphereGeometry(kTip, 24, 16);
    this.device = new three.Mesh(ball, new three.MeshLambertMaterial({ color: colour, transparent: true, opacity: 0.4 }));
    this.proxy = new three.Mesh(ball, new three.MeshLambertMaterial({ color: colour }));
    this.spring = new three.Line(new three.BufferGeometry().setFromPoints([new three.Vector3(), new three.Vector3()]),
                                 new three.LineBasicMaterial({ color: colour }));
    this.spring.frustumCulled = false;
    this.arrow = new three.ArrowHelper(new three.Vector3(0, 0, 1), new three.Vector3(), 0.01, 0xffffff, 0.005, 0.003);
    scene.add(this.device, this.proxy, this.spring, this.arrow);
    this.show(false);
  }

  remove() {
    for (const part of [this.device, this.proxy, this.spring, this.arrow]) part.removeFromParent();
    for (const part of [this.device, this.proxy, this.spring]) {
      part.geometry.dispose();
      part.material.dispose();
    }
    this.arrow.dispose();
  }

  /// `geometry`: of a tool, m; null: a sphere of this radius.
  setShape(geometry, radius) {
    for (const part of [this.device, this.proxy]) {
      if (geometry) part.geometry = geometry;
      part.scale.setScalar(geometry ? 1 : radius / kTip);
    }
  }

  /// `orientation`: quaternion x y z w.
  turn(orientation) {
    for (const part of [this.device, this.proxy]) part.quaternion.fromArray(orientation);
  }

  show(visible) {
    for (const part of [this.device, this.proxy, this.spring, this.arrow]) part.visible = visible;
  }

  /// `view`: the numbers of a UserView (web/touch_session.hpp).
  update(view) {
    this.show(view[10] === 1);
    this.device.position.fromArray(view, 0);
    this.proxy.position.fromArray(view, 3);
    const line = this.spring.geometry.getAttribute("position");
    line.setXYZ(0, view[0], view[1], view[2]);
    line.setXYZ(1, view[3], view[4], view[5]);
    line.needsUpdate = true;
    const force = new three.Vector3().fromArray(view, 6), newtons = force.length();
    this.arrow.visible = this.arrow.visible && newtons > 0.05;
    if (!this.arrow.visible) return;
    this.arrow.position.copy(this.proxy.position);
    this.arrow.setDirection(force.divideScalar(newtons));
    this.arrow.setLength(0.004 + kArrowPerNewton * newtons, 0.005, 0.004);
  }
}

/// Sets the size of the picture and the aspect of the camera to the present size of the canvas. Returns that size.
export function fitToCanvas({ canvas, camera, renderer, isSoftware }) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const ratio = isSoftware ? 1 : Math.min(window.devicePixelRatio, 2);
  if (canvas.width !== Math.floor(width * ratio) || canvas.height !== Math.floor(height * ratio)) {
    renderer.setPixelRatio(ratio);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
  }
  return { width, height };
}

export class Scene {
  constructor(canvas, colours) {
    this.canvas = canvas;
    this.isSoftware = drawsInSoftware();
    this.renderer = new three.WebGLRenderer({ canvas, antialias: !this.isSoftware });
    this.scene = new three.Scene();
    this.scene.background = new three.Color(0x10141a);
    this.camera = new three.PerspectiveCamera(40, 1, 0.005, 10);
    this.camera.up.set(0, 0, 1);
    const light = new three.DirectionalLight(0xffffff, 2.4);
    this.camera.add(light);
    light.position.set(-0.3, 0.6, 1);
    this.scene.add(new three.HemisphereLight(0xcfdcea, 0x39414b, 1.6), this.camera);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.mouseButtons = { LEFT: null, MIDDLE: three.MOUSE.DOLLY, RIGHT: three.MOUSE.ROTATE };
    this.controls.touches = { ONE: null, TWO: three.TOUCH.DOLLY_ROTATE };
    this.controls.enablePan = false;
    this.material = new three.MeshLambertMaterial({ vertexColors: true, flatShading: true, side: three.DoubleSide });
    this.object = new three.Mesh(new three.BufferGeometry(), this.material);
    this.object.frustumCulled = false;
    this.mesh = null;  // the buffers of the drawn mesh
    this.scene.add(this.object);
    this.probes = colours.map((colour) => new Probe(this.scene, colour));
    this.raycaster = new three.Raycaster();
  }

  /// Places the camera so that it sees the bounds: low x y z, high x y z.
  open(bounds, scale) {
    const low = new three.Vector3().fromArray(bounds, 0), high = new three.Vector3().fromArray(bounds, 3);
    const centre = low.clone().add(high).multiplyScalar(0.5), size = high.distanceTo(low);
    this.object.scale.setScalar(scale);
    this.object.geometry.dispose();
    this.object.geometry = new three.BufferGeometry();
    this.mesh = null;
    this.camera.position.copy(centre).add(new three.Vector3(0.35, -1, 0.75).multiplyScalar(1.15 * size));
    this.controls.target.copy(centre);
    this.controls.minDistance = 0.3 * size;
    this.controls.maxDistance = 5 * size;
    this.controls.update();
    this.camera.updateMatrixWorld();
    this.object.updateMatrixWorld();
  }

  /// `corners`: x y z of three corners of each face; `fine`: by face, 1 at full resolution.
  /// Returns the buffers of the mesh that was drawn before, or null.
  setMesh({ corners, fine }) {
    const spare = this.mesh;
    this.mesh = { corners: corners.buffer, fine: fine.buffer };
    const colours = new Uint8Array(9 * fine.length);
    for (let face = 0; face < fine.length; ++face) {
      const colour = fine[face] ? kFine : kCoarse;
      for (let k = 0; k < 9; ++k) colours[9 * face + k] = colour[k % 3];
    }
    const geometry = new three.BufferGeometry();
    geometry.setAttribute("position", new three.BufferAttribute(corners, 3));
    geometry.setAttribute("color", new three.BufferAttribute(colours, 3, true));
    geometry.boundingSphere = new three.Sphere(new three.Vector3(), Infinity);  // spares its computation
    this.object.geometry.dispose();
    this.object.geometry = geometry;
    return spare;
  }

  setUsers(users, numbers) {
    this.probes.forEach((probe, i) => probe.update(users.subarray(numbers * i, numbers * (i + 1))));
  }

  /// The ray of a pointer event: {origin, direction, hit: the first point of the object or null}.
  pick(event) {
    const area = this.canvas.getBoundingClientRect();
    const at = new three.Vector2(2 * (event.clientX - area.left) / area.width - 1,
                                 1 - 2 * (event.clientY - area.top) / area.height);
    this.raycaster.setFromCamera(at, this.camera);
    const hits = this.object.geometry.getAttribute("position") ? this.raycaster.intersectObject(this.object) : [];
    const { origin, direction } = this.raycaster.ray;
    return { origin: origin.clone(), direction: direction.clone(), hit: hits[0]?.point ?? null };
  }

  draw() {
    fitToCanvas(this);
    this.renderer.render(this.scene, this.camera);
  }
}
