// The robot in 3D, with forward kinematics in the browser.
import { THREE, GLTFLoader, OrbitControls, STLLoader } from "nicegui-scene";

const MOST_TRAIL = 1500, AHEAD = 0.36, NEAREST = 0.2, FARTHEST = 20, SIGHT = 3, TRAIL = 5, ASPECT = 4 / 3; // m, s
const FITTED = 0.5, PREDICTED = 0.5, SLOWEST = 0.15; // s, s, m/s
const CLICK = 6, PERIOD = 33, SLOW_PERIOD = 250; // pixels, ms
const FROM = new THREE.Vector3(-0.75, -0.55, 0.36).normalize(), SHARE = 0.85; // from where one looks; of the view, for what is shown
const COLOURS = { target: 0xd22699, trail: 0xe060b8, prediction: 0xfaa028, "line of sight": 0x28a050, "view cone": 0x5b8cff };

function lineOf(colour, points) {
  const line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: colour }));
  line.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * points), 3));
  line.geometry.setDrawRange(0, 0);
  line.frustumCulled = false;
  return line;
}

function draw(line, points) {
  const attribute = line.geometry.attributes.position;
  points.forEach((point, number) => attribute.setXYZ(number, ...point));
  attribute.needsUpdate = true;
  line.geometry.setDrawRange(0, points.length);
}

/** Return both ends of a target's path in the next moment, by its last points; empty if it may be at rest. */
function pathAhead(points, now) {
  const last = points.at(-1), first = points.find(({ stamp }) => stamp > last.stamp - FITTED);
  const seconds = last?.stamp - first?.stamp;
  if (!(seconds > FITTED / 2) || now - last.stamp > FITTED) return [];
  const speed = last.at.map((value, axis) => (value - first.at[axis]) / seconds);
  return Math.hypot(...speed) < SLOWEST ? [] : [last.at, last.at.map((value, axis) => value + speed[axis] * (now + PREDICTED - last.stamp))];
}

function put(node, [x, y, z, qx, qy, qz, qw]) {
  node.position.set(x, y, z);
  node.quaternion.set(qx, qy, qz, qw);
}

function cornersOf({ min, max }) {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((number) => new THREE.Vector3(number & 1 ? min.x : max.x, number & 2 ? min.y : max.y, number & 4 ? min.z : max.z));
}

function geometryOf({ kind, size }) {
  if (kind === "box") return new THREE.BoxGeometry(...size);
  if (kind === "sphere") return new THREE.SphereGeometry(size[0], 24, 16);
  return new THREE.CylinderGeometry(size[0], size[0], size[1], 32).rotateX(Math.PI / 2);
}

async function meshOf(shape) {
  if (shape.kind === "coloured") return (await new GLTFLoader().loadAsync(shape.mesh)).scene;
  const geometry = shape.kind === "mesh" ? await new STLLoader().loadAsync(shape.mesh) : geometryOf(shape);
  const [red, green, blue, alpha] = shape.rgba;
  const color = new THREE.Color().setRGB(red, green, blue, THREE.SRGBColorSpace);
  return new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ color, roughness: 0.7, transparent: alpha < 1, opacity: alpha }));
}

export class RobotScene {
  /** @param {(point: number[]) => void} onPoint receives a point to look at [m]. */
  constructor(place, onPoint) {
    this.place = place;
    THREE.Object3D.DEFAULT_UP.set(0, 0, 1);
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    place.append(this.renderer.domElement);
    const gl = this.renderer.getContext(), about = gl.getExtension("WEBGL_debug_renderer_info");
    this.isSlow = /swiftshader|llvmpipe|software/i.test(about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "");
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(35, 1, 0.02, 50);
    this.camera.position.set(1.6, -1.9, 1.1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.request());
    this.controls.addEventListener("start", () => { this.moved = this.isHeld = true; });
    this.controls.addEventListener("end", () => { this.isHeld = false; });
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8088a0, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.8);
    sun.position.set(2, -3, 4);
    this.scene.add(sun);
    const grid = new THREE.GridHelper(6, 24, 0x8890a0, 0x8890a0).rotateX(Math.PI / 2);
    grid.material.transparent = true;
    grid.material.opacity = 0.18;
    this.scene.add(grid);
    this.root = this.scene.add(new THREE.Group()).children.at(-1);
    this.target = new THREE.Mesh(new THREE.SphereGeometry(0.035, 24, 16), new THREE.MeshStandardMaterial({ color: COLOURS.target, emissive: 0x700c50 }));
    this.target.visible = false;
    this.trail = lineOf(COLOURS.trail, MOST_TRAIL);
    this.prediction = lineOf(COLOURS.prediction, 2);
    this.points = [];
    this.scene.add(this.target, this.trail, this.prediction);
    this.listen(onPoint);
    new ResizeObserver(() => this.resize()).observe(place);
  }

  /** A click on the floor looks there. */
  listen(onPoint) {
    const canvas = this.renderer.domElement, floor = new THREE.Plane(new THREE.Vector3(0, 0, 1), 0), caster = new THREE.Raycaster();
    let pressed = null;
    canvas.addEventListener("pointerdown", (event) => { pressed = event; }, { capture: true }); // before the view's own listener
    canvas.addEventListener("pointerup", ({ clientX, clientY }) => {
      const from = pressed;
      pressed = null;
      if (!from || Math.hypot(clientX - from.clientX, clientY - from.clientY) > CLICK) return;
      const { left, top, width, height } = canvas.getBoundingClientRect();
      caster.setFromCamera(new THREE.Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height), this.camera);
      const point = caster.ray.intersectPlane(floor, new THREE.Vector3());
      if (point && point.distanceTo(this.camera.position) < FARTHEST) onPoint(point.toArray());
    });
    canvas.addEventListener("pointercancel", () => { pressed = null; });
  }

  resize() {
    const { clientWidth, clientHeight } = this.place;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setPixelRatio(this.isSlow ? 1 : Math.min(devicePixelRatio, 2));
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    if (this.robot && !this.moved) this.frame();
    this.request();
  }

  /** Draw once, soon; less often without a graphics card, to leave the processor to the robot. */
  request() {
    if (this.requested || !this.place.clientWidth) return;
    this.requested = true;
    const render = () => {
      this.requested = false;
      this.due = performance.now() + (this.isSlow && !this.isHeld ? SLOW_PERIOD : PERIOD);
      this.renderer.render(this.scene, this.camera);
    };
    setTimeout(() => requestAnimationFrame(render), Math.max(0, (this.due ?? 0) - performance.now()));
  }

  setRobot(robot) {
    this.robot = robot;
    this.root.clear();
    const links = (this.links = Object.assign(Object.create(null), { [robot.root]: this.root })); // any name is a name
    const link = (name) => (links[name] ??= new THREE.Group());
    this.joints = robot.joints.map((joint) => {
      const origin = new THREE.Group();
      put(origin, joint.origin);
      link(joint.parent).add(origin);
      origin.add(link(joint.child));
      return { ...joint, origin, axis: new THREE.Vector3(...joint.axis), node: link(joint.child) };
    });
    this.addShapes(robot.shapes, links);
    this.screen = null;
    if (robot.camera) this.addGaze(robot, link(robot.camera));
    this.request();
    this.shown = "";
    this.framed = this.moved = false;
    this.kept = new THREE.Box3(); // in the view
  }

  /** Add the shapes one after the other: a browser has six connections to a server, and STOP needs one. */
  async addShapes(shapes, links) {
    for (const shape of shapes) {
      const added = await meshOf(shape).catch(() => null); // one that can't be loaded is left out
      if (this.links !== links) return; // another robot is shown meanwhile
      if (!added) continue;
      put(added, shape.place);
      links[shape.link].add(added);
      this.framed = false; // the view is to have the whole robot
      this.shown = "";
      this.request();
    }
  }

  addGaze(robot, camera) {
    this.view = robot.view ?? this.view ?? 1; // a recorded robot has none
    const view = camera.add(new THREE.Group()).children.at(-1), { axis } = robot;
    if (axis[2] < 0.999) { // a body frame: make z forward, y down
      const forward = new THREE.Vector3(...axis), up = new THREE.Vector3(0, 0, 1);
      const right = forward.clone().cross(up);
      if (right.length() < 1e-9) right.set(0, -1, 0);
      right.normalize();
      view.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(right, forward.clone().cross(right), forward));
    }
    const line = lineOf(COLOURS["line of sight"], 2);
    draw(line, [[0, 0, 0], [0, 0, SIGHT]]);
    this.cone = new THREE.Group();
    view.add(line, this.cone);
    this.addFrustum(this.cone, AHEAD * Math.tan(this.view / 2));
  }

  addFrustum(view, right) {
    const down = right / ASPECT;
    const corners = [[-right, -down], [right, -down], [right, down], [-right, down]].map(([x, y]) => [x, y, AHEAD]);
    const edges = corners.flatMap((corner, number) => [0, 0, 0, ...corner, ...corner, ...corners[(number + 1) % 4]]);
    const lines = new THREE.BufferGeometry().setAttribute("position", new THREE.Float32BufferAttribute(edges, 3));
    view.add(new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: COLOURS["view cone"] })));
    this.screen = new THREE.Mesh(new THREE.PlaneGeometry(2 * right, 2 * down).rotateX(Math.PI), new THREE.MeshBasicMaterial({ side: THREE.DoubleSide }));
    this.screen.position.z = AHEAD;
    this.screen.visible = false;
    view.add(this.screen);
  }

  showPicture(image) {
    if (!this.screen || !image.naturalWidth || performance.now() < (this.pictureDue ?? 0)) return;
    this.pictureDue = performance.now() + 200;
    this.canvas ??= Object.assign(document.createElement("canvas"), { width: 160, height: 120 });
    this.cone.scale.y = (ASPECT * image.naturalHeight) / image.naturalWidth;
    this.canvas.getContext("2d").drawImage(image, 0, 0, 160, 120);
    const { material } = this.screen;
    if (!material.map) {
      material.map = new THREE.CanvasTexture(this.canvas);
      material.map.colorSpace = THREE.SRGBColorSpace;
      material.needsUpdate = true;
    }
    material.map.needsUpdate = true;
    this.screen.visible = true;
    this.request();
  }

  /** Show joint positions, and the target with the time [s] for which it was measured. */
  show(positions, target, stamp, targetStamp) {
    if (!this.robot) return;
    const shown = JSON.stringify([positions, target, targetStamp, stamp - targetStamp > FITTED]);
    if (shown === this.shown) return;
    this.shown = shown;
    for (const joint of this.joints) {
      const leader = positions[joint.leader];
      if (leader == null) continue;
      const position = joint.ratio * leader + joint.offset;
      if (joint.type === "prismatic") joint.node.position.copy(joint.axis).multiplyScalar(position);
      else joint.node.quaternion.setFromAxisAngle(joint.axis, position);
    }
    this.target.visible = Boolean(target);
    const before = this.points.at(-1);
    if (!target || (before && (targetStamp < before.stamp || Math.hypot(...target.map((value, axis) => value - before.at[axis])) > 0.3))) {
      this.points = [];
      this.kept.makeEmpty();
    }
    if (target) {
      this.target.position.set(...target);
      if (targetStamp !== this.points.at(-1)?.stamp) this.points.push({ stamp: targetStamp, at: target });
      this.points = this.points.filter((point) => point.stamp >= stamp - TRAIL).slice(-MOST_TRAIL);
    }
    draw(this.trail, this.points.map(({ at }) => at));
    draw(this.prediction, pathAhead(this.points, stamp));
    if (!this.moved && !(this.framed && this.sees(this.places()))) this.frame();
    this.request();
  }

  /** Fit the view to the robot, and to where its target and picture have been, until the user moves it. */
  frame() {
    const body = new THREE.Box3();
    this.root.updateWorldMatrix(true, true);
    this.root.traverse((node) => { if (node.isMesh) body.expandByObject(node); });
    if (body.isEmpty() || !Number.isFinite(body.getSize(new THREE.Vector3()).length())) return;
    for (const place of this.places()) this.kept.expandByPoint(place);
    const corners = [body, this.kept].filter((box) => !box.isEmpty()).flatMap(cornersOf);
    body.union(this.kept).getCenter(this.controls.target);
    for (let away = NEAREST; away < FARTHEST; away *= 1.03) {
      this.camera.position.copy(this.controls.target).addScaledVector(FROM, away);
      this.controls.update();
      this.camera.updateMatrixWorld();
      if (this.sees(corners, SHARE)) break;
    }
    this.framed = true;
    this.request();
  }

  /** Return the places of the target, or of one nearer in its direction, and of the picture. */
  places() {
    const place = (one) => one.getWorldPosition(new THREE.Vector3()), head = place(this.cone ?? this.root);
    return [this.target, this.screen].filter((one) => one?.visible).map((one) => place(one).sub(head).clampLength(0, SIGHT).add(head));
  }

  /** Return whether this share of the view has these places. */
  sees(places, share = 1) {
    return places.map((place) => place.clone().project(this.camera)).every(({ x, y, z }) => Math.max(Math.abs(x), Math.abs(y)) < share && z < 1);
  }
}
