// The robot in 3D: forward kinematics in the browser from one array of joint positions.
import { THREE, OrbitControls, STLLoader } from "nicegui-scene";

const TRAIL = 150, AHEAD = 0.36, HALF = 0.546;

function put(node, [x, y, z, qx, qy, qz, qw]) {
  node.position.set(x, y, z);
  node.quaternion.set(qx, qy, qz, qw);
}

function geometryOf({ kind, size }) {
  if (kind === "box") return new THREE.BoxGeometry(...size);
  if (kind === "sphere") return new THREE.SphereGeometry(size[0], 24, 16);
  return new THREE.CylinderGeometry(size[0], size[0], size[1], 32).rotateX(Math.PI / 2);
}

export class RobotScene {
  constructor(place) {
    this.place = place;
    THREE.Object3D.DEFAULT_UP.set(0, 0, 1);
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    place.append(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(35, 1, 0.02, 50);
    this.camera.position.set(1.6, -1.9, 1.1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.request());
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8088a0, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.8);
    sun.position.set(2, -3, 4);
    this.scene.add(sun);
    const grid = new THREE.GridHelper(6, 24, 0x8890a0, 0x8890a0).rotateX(Math.PI / 2);
    grid.material.transparent = true;
    grid.material.opacity = 0.18;
    this.scene.add(grid);
    this.root = this.scene.add(new THREE.Group()).children.at(-1);
    this.target = new THREE.Mesh(new THREE.SphereGeometry(0.035, 24, 16), new THREE.MeshStandardMaterial({ color: 0xd22699, emissive: 0x700c50 }));
    this.target.visible = false;
    this.trail = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0xe060b8 }));
    this.trail.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * TRAIL), 3));
    this.trail.frustumCulled = false;
    this.points = [];
    this.scene.add(this.target, this.trail);
    new ResizeObserver(() => this.resize()).observe(place);
  }

  resize() {
    const { clientWidth, clientHeight } = this.place;
    if (!clientWidth || !clientHeight) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(clientWidth, clientHeight);
    this.camera.aspect = clientWidth / clientHeight;
    this.camera.updateProjectionMatrix();
    this.request();
  }

  /** Draw once, soon; nothing is drawn while nothing changes or the place is not shown. */
  request() {
    if (this.requested || !this.place.clientWidth) return;
    this.requested = true;
    requestAnimationFrame(() => {
      this.requested = false;
      this.renderer.render(this.scene, this.camera);
    });
  }

  setRobot(robot) {
    this.robot = robot;
    this.root.clear();
    this.links = { [robot.root]: this.root };
    const link = (name) => (this.links[name] ??= new THREE.Group());
    this.joints = robot.joints.map((joint) => {
      const origin = new THREE.Group();
      put(origin, joint.origin);
      link(joint.parent).add(origin);
      origin.add(link(joint.child));
      return { ...joint, origin, axis: new THREE.Vector3(...joint.axis), node: link(joint.child) };
    });
    const loader = new STLLoader();
    for (const shape of robot.shapes) {
      const [red, green, blue, alpha] = shape.rgba;
      const colour = new THREE.Color().setRGB(red, green, blue, THREE.SRGBColorSpace);
      const material = new THREE.MeshStandardMaterial({ color: colour, roughness: 0.7, transparent: alpha < 1, opacity: alpha });
      const add = (geometry) => {
        const mesh = new THREE.Mesh(geometry, material);
        put(mesh, shape.place);
        link(shape.link).add(mesh);
        this.request();
      };
      if (shape.kind === "mesh") loader.load(`/head/mesh/${shape.mesh}`, add);
      else add(geometryOf(shape));
    }
    if (robot.camera) this.addFrustum(link(robot.camera), robot.axis);
    this.framed = false;
  }

  addFrustum(camera, axis) {
    const view = camera.add(new THREE.Group()).children.at(-1);
    if (axis[2] < 0.999) { // a body frame: x forward; make z forward, y down
      const forward = new THREE.Vector3(...axis), right = forward.clone().cross(new THREE.Vector3(0, 0, 1)).normalize();
      view.quaternion.setFromRotationMatrix(new THREE.Matrix4().makeBasis(right, forward.clone().cross(right), forward));
    }
    const right = AHEAD * HALF, down = right * 0.75;
    const corners = [[-right, -down], [right, -down], [right, down], [-right, down]].map(([x, y]) => [x, y, AHEAD]);
    const edges = corners.flatMap((corner, number) => [0, 0, 0, ...corner, ...corner, ...corners[(number + 1) % 4]]);
    const lines = new THREE.BufferGeometry().setAttribute("position", new THREE.Float32BufferAttribute(edges, 3));
    view.add(new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: 0x5b8cff })));
    this.screen = new THREE.Mesh(new THREE.PlaneGeometry(2 * right, 2 * down).rotateX(Math.PI), new THREE.MeshBasicMaterial({ side: THREE.DoubleSide }));
    this.screen.position.z = AHEAD;
    this.screen.visible = false;
    view.add(this.screen);
    this.view = view;
  }

  showPicture(image) {
    if (!this.screen || performance.now() < (this.pictureDue ?? 0)) return;
    this.pictureDue = performance.now() + 200;
    this.canvas ??= Object.assign(document.createElement("canvas"), { width: 160, height: 120 });
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

  show(positions, target) {
    if (!this.robot) return;
    const shown = JSON.stringify([positions, target]);
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
    if (target) {
      this.target.position.set(...target);
      this.points.push(target);
      this.points.splice(0, this.points.length - TRAIL);
    } else this.points.length = 0;
    const attribute = this.trail.geometry.attributes.position;
    this.points.forEach((point, number) => attribute.setXYZ(number, ...point));
    attribute.needsUpdate = true;
    this.trail.geometry.setDrawRange(0, this.points.length);
    if (!this.framed) this.frame();
    this.request();
  }

  /** Show robot and frustum as a whole, once. */
  frame() {
    const box = new THREE.Box3().setFromObject(this.root);
    if (box.isEmpty()) return;
    this.framed = true;
    const ball = box.getBoundingSphere(new THREE.Sphere());
    const away = (ball.radius * 1.25) / Math.sin((this.camera.fov * Math.PI) / 360);
    this.controls.target.copy(ball.center);
    this.camera.position.copy(ball.center).add(new THREE.Vector3(0.35, -0.85, 0.38).normalize().multiplyScalar(away));
    this.controls.update();
  }

  /** Return yaw and elevation of the target as the head's base sees it [rad]; null without one. */
  targetDirection() {
    if (!this.target.visible || !this.view) return null;
    const pan = this.joints.find((joint) => joint.name === this.robot.pan);
    const camera = this.view.getWorldPosition(new THREE.Vector3());
    const turn = pan.origin.getWorldQuaternion(new THREE.Quaternion()).invert();
    const ray = this.target.position.clone().sub(camera).applyQuaternion(turn);
    return [Math.atan2(ray.y, ray.x), Math.atan2(ray.z, Math.hypot(ray.x, ray.y))];
  }
}
