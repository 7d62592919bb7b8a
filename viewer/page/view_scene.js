// Draws the objects, probes and forces of a session.
import * as three from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { Probe, drawsInSoftware, fitToCanvas } from "../../web/page/scene.js";

const kCoarse = [87, 107, 133], kFine = [237, 153, 69], kPlain = [176, 187, 200];  // colours of faces

/// The layers of regions. Regions of contact are drawn over predicted ones, and these over resident ones.
export const kRegionLayers = [{ name: "resident", mark: 1, colour: 0x5c7da3 }, { name: "predicted", mark: 2, colour: 0xffd36f },
                              { name: "contact", mark: 3, colour: 0xff6b5e }];
// Corners of the edges of a cube, as bits x y z.
const kCubeEdges = [0, 1, 2, 3, 4, 5, 6, 7, 0, 2, 1, 3, 4, 6, 5, 7, 0, 4, 1, 5, 2, 6, 3, 7];

/// The edges of the cells of marked regions, model frame.
class RegionBoxes {
  constructor(group, scale) {
    this.layers = kRegionLayers.map(({ mark, colour }) => {
      const lines = new three.LineSegments(new three.BufferGeometry(), new three.LineBasicMaterial({ color: colour }));
      lines.scale.setScalar(scale);
      lines.frustumCulled = false;
      lines.renderOrder = mark;
      group.add(lines);
      return lines;
    });
    this.regions = [];
  }

  /// Returns the regions before.
  set(regions) {
    const before = this.regions;
    this.regions = regions;
    this.layers.forEach((lines, i) => {
      const marked = regions.filter(({ mark }) => mark === kRegionLayers[i].mark);
      const corners = new Float32Array(3 * kCubeEdges.length * marked.length);
      marked.forEach(({ x, y, z, edge }, number) => kCubeEdges.forEach((corner, k) => {
        const at = 3 * (kCubeEdges.length * number + k);
        corners.set([x + (corner & 1) * edge, y + (corner >> 1 & 1) * edge, z + (corner >> 2) * edge], at);
      }));
      lines.geometry.dispose();
      lines.geometry = new three.BufferGeometry();
      lines.geometry.setAttribute("position", new three.BufferAttribute(corners, 3));
    });
    return before;
  }

  dispose() {
    for (const lines of this.layers) {
      lines.geometry.dispose();
      lines.material.dispose();
    }
  }
}

/// The mesh of an object. Its buffers have the rows of the viewer's frames; an empty row is a face without area.
class ShownObject {
  constructor(scene, description, material) {
    this.rows = this.faces = 0;
    this.hash = 0n;
    this.finest = new Uint8Array(0);  // by row
    this.positions = new Float32Array(0);
    this.colours = new Uint8Array(0);
    this.group = new three.Group();
    this.mesh = new three.Mesh(new three.BufferGeometry(), material);
    this.mesh.frustumCulled = false;
    this.mesh.scale.setScalar(description.scale);
    this.group.add(this.mesh);
    this.boxes = new RegionBoxes(this.group, description.scale);
    scene.add(this.group);
    this.setPose(description);
  }

  setPose({ position, orientation }) {
    this.group.position.fromArray(position);
    this.group.quaternion.fromArray(orientation);
  }

  /// Enlarges the buffers to at least `rows` rows.
  reserve(rows) {
    if (rows <= this.finest.length) return;
    const capacity = Math.ceil(1.5 * rows);
    const grown = (array, size) => {
      const larger = new array.constructor(size);
      larger.set(array);
      return larger;
    };
    this.finest = grown(this.finest, capacity);
    this.positions = grown(this.positions, 9 * capacity);
    this.colours = grown(this.colours, 9 * capacity);
    this.mesh.geometry.dispose();
    this.mesh.geometry = new three.BufferGeometry();
    this.mesh.geometry.setAttribute("position", new three.BufferAttribute(this.positions, 3).setUsage(three.DynamicDrawUsage));
    this.mesh.geometry.setAttribute("color", new three.BufferAttribute(this.colours, 3, true).setUsage(three.DynamicDrawUsage));
    this.mesh.geometry.boundingSphere = new three.Sphere(new three.Vector3(), Infinity);  // so that three.js does not compute it
  }

  /// Writes the rows of a frame. Returns a frame that restores the present rows.
  apply(frame, showsResolution) {
    if (frame.isWhole) this.positions.fill(0);
    const before = { object: frame.object, isWhole: false, rows: this.rows, faces: this.faces, hash: this.hash,
                     changed: new Uint32Array(frame.changed.length), corners: new Float32Array(frame.corners.length) };
    this.reserve(Math.max(frame.rows, this.rows));
    this.mesh.geometry.setDrawRange(0, 3 * frame.rows);
    this.rows = frame.rows;
    this.faces = frame.faces;
    this.hash = frame.hash;
    frame.changed.forEach((number, i) => {
      const row = number & 0x7fffffff;
      before.changed[i] = (row | this.finest[row] << 31) >>> 0;
      before.corners.set(this.positions.subarray(9 * row, 9 * row + 9), 9 * i);
      this.finest[row] = number >>> 31;
      this.positions.set(frame.corners.subarray(9 * i, 9 * i + 9), 9 * row);
      this.colour(row, showsResolution);
    });
    const { position, color } = this.mesh.geometry.attributes;
    const low = frame.changed.reduce((min, number) => Math.min(min, number & 0x7fffffff), frame.rows);
    const high = frame.changed.reduce((max, number) => Math.max(max, number & 0x7fffffff), 0);
    if (frame.changed.length === 0) return before;
    for (const attribute of [position, color]) {
      attribute.addUpdateRange(9 * low, 9 * (high - low + 1));
      attribute.needsUpdate = true;
    }
    return before;
  }

  isFineAt(point, distance) {
    this.group.updateMatrixWorld();
    const at = this.mesh.worldToLocal(new three.Vector3().fromArray(point)), nearest = new three.Vector3();
    const corners = [0, 1, 2].map(() => new three.Vector3()), face = new three.Triangle(...corners);
    const reach = distance / this.mesh.scale.x, { positions } = this;
    // True if the bounding box of a face is more than `reach` away along this axis.
    const isFar = (row, axis, centre) => {
      const first = 9 * row + axis, a = positions[first] - centre, b = positions[first + 3] - centre, c = positions[first + 6] - centre;
      return (a > reach && b > reach && c > reach) || (a < -reach && b < -reach && c < -reach);
    };
    let any = false;
    for (let row = 0; row < this.rows; ++row) {
      if (isFar(row, 0, at.x) || isFar(row, 1, at.y) || isFar(row, 2, at.z)) continue;
      corners.forEach((corner, k) => corner.fromArray(this.positions, 9 * row + 3 * k));
      const isEmpty = corners.every((corner) => corner.lengthSq() === 0);
      if (isEmpty || face.closestPointToPoint(at, nearest).distanceTo(at) * this.mesh.scale.x > distance) continue;
      if (!this.finest[row]) return false;
      any = true;
    }
    return any;
  }

  colour(row, showsResolution) {
    const colour = !showsResolution ? kPlain : this.finest[row] ? kFine : kCoarse;
    for (let k = 0; k < 9; ++k) this.colours[9 * row + k] = colour[k % 3];
  }

  showResolution(shows) {
    for (let row = 0; row < this.finest.length; ++row) this.colour(row, shows);
    const { color } = this.mesh.geometry.attributes;
    if (!color) return;
    color.clearUpdateRanges();  // without ranges, all of it is uploaded
    color.needsUpdate = true;
  }

  dispose() {
    this.group.removeFromParent();
    this.mesh.geometry.dispose();
    this.boxes.dispose();
  }
}

export class ViewScene {
  constructor(canvas, names) {
    this.canvas = canvas;
    this.names = names;
    this.isSoftware = drawsInSoftware();
    this.renderer = new three.WebGLRenderer({ canvas, antialias: !this.isSoftware });
    this.scene = new three.Scene();
    this.scene.background = new three.Color(0x10141a);
    this.camera = new three.PerspectiveCamera(40, 1, 0.005, 100);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(0.3, -0.8, 0.6);
    const light = new three.DirectionalLight(0xffffff, 2.4);
    this.camera.add(light);
    light.position.set(-0.3, 0.6, 1);
    this.scene.add(new three.HemisphereLight(0xcfdcea, 0x39414b, 1.6), this.camera);
    this.controls = new OrbitControls(this.camera, canvas);
    this.material = new three.MeshLambertMaterial({ vertexColors: true, flatShading: true, side: three.DoubleSide });
    this.objects = new Map();  // by number
    this.probes = new Map();   // by user id
    this.showsResolution = true;
    this.showsNames = true;
    this.showsForces = true;
    this.shownLayers = new Set(["contact", "predicted"]);  // of regions, by name
    this.tool = null;          // geometry
    this.followed = null;      // user id
    this.hasView = false;      // the camera was placed so that it sees all objects
    this.raycaster = new three.Raycaster();
  }

  setObjects(descriptions) {
    const present = new Set(descriptions.map(({ number }) => number));
    for (const [number, object] of this.objects) {
      if (present.has(number)) continue;
      object.dispose();
      this.objects.delete(number);
    }
    for (const description of descriptions)
      if (!this.objects.has(description.number))
        this.objects.set(description.number, new ShownObject(this.scene, description, this.material));
    if (!this.hasView && descriptions.length > 0) this.viewAll(descriptions);
  }

  /// Places the camera so that it sees the bounds of all objects.
  viewAll(descriptions) {
    const bounds = new three.Box3();
    for (const { number, low, high, scale } of descriptions) {
      const { group } = this.objects.get(number);
      group.updateMatrixWorld();
      const box = new three.Box3(new three.Vector3().fromArray(low), new three.Vector3().fromArray(high));
      bounds.union(box.applyMatrix4(group.matrixWorld.clone().scale(new three.Vector3(scale, scale, scale))));
    }
    const centre = bounds.getCenter(new three.Vector3()), size = bounds.getSize(new three.Vector3()).length();
    const { clientWidth, clientHeight } = this.canvas, half = Math.tan(three.MathUtils.degToRad(this.camera.fov) / 2);
    const distance = 0.5 * size / half / Math.min(1, clientWidth / clientHeight);
    this.camera.position.copy(centre).addScaledVector(new three.Vector3(0.35, -1, 0.75).normalize(), distance);
    this.controls.target.copy(centre);
    this.controls.update();
    this.hasView = true;
  }

  /// Whether an object has faces within `distance` m of a point of the world, x y z, and all of them are at full
  /// resolution.
  isFineAt(number, point, distance) { return this.objects.get(number)?.isFineAt(point, distance) ?? false; }

  /// Returns a frame that undoes this one, or null without the object.
  applyMesh(frame) { return this.objects.get(frame.object)?.apply(frame, this.showsResolution) ?? null; }

  /// Returns the regions before, or null without the object.
  applyRegions({ object, regions }) { return this.objects.get(object)?.boxes.set(regions) ?? null; }

  showResolution(shows) {
    this.showsResolution = shows;
    for (const object of this.objects.values()) object.showResolution(shows);
  }

  /// `users`: by id {name, colour}.
  setProbes({ probes, poses }, users) {
    for (const pose of poses) this.objects.get(pose.object)?.setPose(pose);
    const present = new Set(probes.map(({ user }) => user));
    for (const user of this.probes.keys())
      if (!present.has(user)) this.removeProbe(user);
    for (const state of probes) {
      const { name, colour } = users.get(state.user) ?? { name: "unknown user", colour: "#ffffff" };
      if (this.probes.has(state.user) && this.probes.get(state.user).colour !== colour) this.removeProbe(state.user);
      if (!this.probes.has(state.user)) {
        const label = this.names.appendChild(document.createElement("span"));
        label.style.color = colour;
        const probe = new Probe(this.scene, colour);
        probe.setShape(this.tool, state.radius);
        this.probes.set(state.user, { probe, label, colour });
      }
      const shown = this.probes.get(state.user), isTouching = (state.status & 1) !== 0;
      const proxy = isTouching || this.tool ? state.proxy : state.device;  // the proxy of a tool is always valid
      if (this.tool) shown.probe.turn(state.orientation);
      const force = this.showsForces ? state.force : [0, 0, 0];
      shown.probe.update(new Float32Array([...state.device, ...proxy, ...force, state.errorBound, 1, isTouching, 0]));
      shown.proxy = new three.Vector3().fromArray(proxy);
      const newtons = Math.hypot(...state.force);
      shown.label.textContent = newtons > 0.05 ? `${name} ${newtons.toFixed(1)} N` : name;
    }
  }

  /// `mesh`: {positions, faces} of a tool, or null for spheres.
  setTool(mesh) {
    for (const user of [...this.probes.keys()]) this.removeProbe(user);  // the next frame adds them with this shape
    this.tool = mesh && new three.BufferGeometry();
    this.tool?.setAttribute("position", new three.Float32BufferAttribute(mesh.positions.flat(), 3));
    this.tool?.setIndex(mesh.faces.flat());
    this.tool?.computeVertexNormals();
  }

  /// While the page's user touches, the left button and one finger belong to the hand.
  setTouching(isTouching) {
    this.controls.mouseButtons = isTouching
      ? { LEFT: null, MIDDLE: three.MOUSE.DOLLY, RIGHT: three.MOUSE.ROTATE }
      : { LEFT: three.MOUSE.ROTATE, MIDDLE: three.MOUSE.DOLLY, RIGHT: three.MOUSE.PAN };
    this.controls.touches = isTouching ? { ONE: null, TWO: three.TOUCH.DOLLY_ROTATE }
                                       : { ONE: three.TOUCH.ROTATE, TWO: three.TOUCH.DOLLY_PAN };
  }

  /// The ray of a pointer event: {origin, direction, hit: its first point of an object or null}.
  pick(event) {
    const area = this.canvas.getBoundingClientRect();
    return this.cast(new three.Vector2(2 * (event.clientX - area.left) / area.width - 1,
                                       1 - 2 * (event.clientY - area.top) / area.height));
  }

  /// `at`: -1 to 1 from left to right and from bottom to top.
  cast(at) {
    this.raycaster.setFromCamera(at, this.camera);
    const meshes = [...this.objects.values()].map(({ mesh }) => mesh).filter((mesh) => mesh.geometry.attributes.position);
    const hits = this.raycaster.intersectObjects(meshes, false);
    const { origin, direction } = this.raycaster.ray;
    return { origin: origin.clone(), direction: direction.clone(), hit: hits[0]?.point ?? null };
  }

  /// Where a point of the world, x y z, is drawn: x y in pixels of the window.
  screenOf(point) {
    const area = this.canvas.getBoundingClientRect();
    const at = new three.Vector3().fromArray(point).project(this.camera);
    return [area.left + (at.x + 1) / 2 * area.width, area.top + (1 - at.y) / 2 * area.height];
  }

  /// The view as a request to the viewer, which refines the meshes for it.
  cameraRequest() {
    const half = Math.tan(three.MathUtils.degToRad(this.camera.fov) / 2);
    const direction = this.camera.getWorldDirection(new three.Vector3());
    return { position: this.camera.position.toArray().map((x) => Math.min(100, Math.max(-100, x))), direction: direction.toArray(),
             halfAngle: Math.atan(half * Math.hypot(1, this.camera.aspect)), pixel: 2 * half / Math.max(1, this.canvas.clientHeight) };
  }

  /// A point between the eye and what is in the middle of the view, x y z. It is outside of all objects.
  pointBefore() {
    const { origin, hit } = this.cast(new three.Vector2(0, 0));
    return origin.lerp(hit ?? this.controls.target, 0.5).toArray();
  }

  removeProbe(user) {
    const { probe, label } = this.probes.get(user);
    probe.remove();
    label.remove();
    this.probes.delete(user);
  }

  placeNames(width, height) {
    for (const { label, proxy } of this.probes.values()) {
      const at = proxy.clone().project(this.camera);
      label.hidden = !this.showsNames || at.z > 1;
      label.style.transform = `translate(${(at.x + 1) / 2 * width + 10}px, ${(1 - at.y) / 2 * height - 24}px)`;
    }
  }

  draw() {
    const { width, height } = fitToCanvas(this);
    const followed = this.probes.get(this.followed);
    if (followed) {
      const step = followed.proxy.clone().sub(this.controls.target).multiplyScalar(0.2);
      this.controls.target.add(step);
      this.camera.position.add(step);
    }
    this.controls.update();
    for (const { boxes } of this.objects.values())
      boxes.layers.forEach((lines, i) => { lines.visible = this.shownLayers.has(kRegionLayers[i].name); });
    this.renderer.render(this.scene, this.camera);
    this.placeNames(width, height);
  }
}
