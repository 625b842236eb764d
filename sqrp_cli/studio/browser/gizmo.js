// Handles in the picture: arrows that move a thing along the axes, a ring that turns it, a ball where a camera looks.

const AXES = [
  ['x', '#d64545', [1, 0, 0]],
  ['y', '#3f9d4f', [0, 1, 0]],
  ['z', '#3d7edb', [0, 0, 1]],
];
const TALL = 0.16; // length of an arrow, as a share of the distance from the eye

class Gizmo {
  // held(move): a hand moves it; put(move): it rests; taken(kind, name): something else was clicked.
  constructor(scene, { held, put, taken }) {
    Object.assign(this, { scene, held, put, taken, target: null, drag: null });
    this.group = scene.group();
    this.ball = this.handle('aim', new THREE.SphereGeometry(0.09, 20, 14), '#c9820c');
    this.beam = new THREE.Line(
      new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(), new THREE.Vector3()]),
      new THREE.LineDashedMaterial({ color: linear('#c9820c'), dashSize: 0.03, gapSize: 0.02, depthTest: false }),
    );
    this.beam.frustumCulled = false;
    this.scene.world.add(this.ball, this.beam);
    for (const [name, tint, way] of AXES) this.group.add(this.arrow(name, tint, new THREE.Vector3(...way)));
    this.middle = this.handle('level', new THREE.BoxGeometry(0.18, 0.18, 0.18), '#8a949e');
    this.ring = this.handle('turn', new THREE.TorusGeometry(0.75, 0.035, 10, 64), '#8a5fc2');
    this.group.add(this.middle, this.ring);
    const { host, closing } = scene,
      options = { capture: true, signal: closing.signal };
    host.addEventListener('pointerdown', (event) => this.begin(event), options);
    host.addEventListener('pointermove', (event) => this.move(event), options);
    for (const name of ['pointerup', 'pointercancel'])
      host.addEventListener(name, (event) => this.end(event), options);
    this.choose(null);
  }

  handle(role, geometry, tint) {
    const material = new THREE.MeshBasicMaterial({ color: linear(tint), depthTest: false, transparent: true, opacity: 0.85 });
    const mesh = new THREE.Mesh(geometry, material);
    mesh.renderOrder = 20;
    mesh.userData.role = role;
    return mesh;
  }

  arrow(name, tint, way) {
    const parts = [
      [new THREE.CylinderGeometry(0.03, 0.03, 0.8, 10).translate(0, 0.4, 0)],
      [new THREE.ConeGeometry(0.09, 0.24, 16).translate(0, 0.9, 0)],
    ];
    const group = new THREE.Group();
    for (const [geometry] of parts) group.add(this.handle(name, geometry, tint));
    const wide = this.handle(name, new THREE.CylinderGeometry(0.12, 0.12, 1.05, 8).translate(0, 0.52, 0), tint);
    wide.material.opacity = 0; // easier to hit
    group.add(wide);
    group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way);
    return group;
  }

  // target: a move as the server has it, with `frame`, the node in which its numbers are, and `up` of a camera.
  choose(target) {
    this.target = target && { ...target, move: structuredClone(target.move) };
    this.show();
  }

  show() {
    const shown = this.target !== null && this.scene.through === null;
    const camera = shown && this.target.move.kind === 'camera';
    this.group.visible = shown;
    this.ball.visible = this.beam.visible = camera;
    this.ring.visible = shown && !camera;
    if (!shown) return;
    const { frame, move } = this.target;
    frame.updateWorldMatrix(true, false);
    this.group.position.set(...move.position).applyMatrix4(frame.matrixWorld);
    if (camera) {
      this.ball.position.set(...move.look_at).applyMatrix4(frame.matrixWorld);
      this.beam.geometry.setFromPoints([this.group.position, this.ball.position]);
      this.beam.computeLineDistances();
    }
  }

  // Of the same size on the screen, wherever it is; called before each picture.
  fit(eye) {
    if (this.target === null) return;
    this.show();
    this.group.scale.setScalar(TALL * eye.position.distanceTo(this.group.position));
    this.ball.scale.setScalar(TALL * 0.8 * eye.position.distanceTo(this.ball.position));
  }

  ray(event) {
    const place = this.scene.host.getBoundingClientRect();
    const at = new THREE.Vector2(
      (2 * (event.clientX - place.left)) / place.width - 1,
      1 - (2 * (event.clientY - place.top)) / place.height,
    );
    const ray = new THREE.Raycaster();
    ray.setFromCamera(at, this.scene.eye);
    return ray;
  }

  begin(event) {
    if (this.scene.through !== null || event.button !== 0 || event.target.closest('button')) return;
    const ray = this.ray(event),
      handles = [this.ball, ...this.group.children].filter((one) => one.visible && this.target);
    const hit = ray.intersectObjects(handles, true)[0];
    if (!hit) {
      this.click = { event, ray };
      return;
    }
    event.stopImmediatePropagation();
    event.preventDefault();
    this.scene.host.setPointerCapture(event.pointerId);
    const role = hit.object.userData.role,
      begun = structuredClone(this.target.move),
      origin = (role === 'aim' ? this.ball : this.group).position.clone();
    this.drag = { role, begun, origin, moved: false };
    this.drag.start = this.at(ray);
  }

  // Where the pointer is on what a handle moves along: a line, a plane, or an angle.
  at(ray) {
    const { role, origin } = this.drag;
    const axis = AXES.find(([name]) => name === role);
    if (axis) return along(ray.ray, origin, new THREE.Vector3(...axis[2]));
    const normal =
      role === 'aim' ? this.scene.eye.getWorldDirection(new THREE.Vector3()) : new THREE.Vector3(0, 0, 1);
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(normal, origin);
    return ray.ray.intersectPlane(plane, new THREE.Vector3()) ?? this.drag.start ?? origin.clone();
  }

  move(event) {
    if (!this.drag) return;
    event.stopImmediatePropagation();
    this.drag.moved = true;
    const { role, begun, origin, start } = this.drag,
      now = this.at(this.ray(event)),
      { frame, move } = this.target;
    if (role === 'turn') {
      const angle = (point) => Math.atan2(point.y - origin.y, point.x - origin.x);
      move.yaw = begun.yaw + angle(now) - angle(start);
    } else {
      const inFrame = new THREE.Matrix4().copy(frame.matrixWorld).invert(),
        there = origin.clone().add(now).sub(start).applyMatrix4(inFrame);
      const numbers = there.toArray().map((x) => Math.round(x * 1e4) / 1e4);
      if (role === 'aim') move.look_at = numbers;
      else move.position = numbers;
    }
    this.held({ ...move }, event.timeStamp);
  }

  end(event) {
    if (!this.drag) {
      this.clicked(event);
      return;
    }
    event.stopImmediatePropagation();
    const { moved } = this.drag;
    this.drag = null;
    if (moved) this.put({ ...this.target.move });
  }

  // Let go without having moved anything.
  cancel() {
    if (!this.drag) return null;
    const { begun } = this.drag;
    this.drag = null;
    this.target.move = begun;
    this.scene.draw();
    return begun;
  }

  // A click without a drag takes what is under it.
  clicked(event) {
    const { click } = this;
    this.click = null;
    if (!click || Math.hypot(event.clientX - click.event.clientX, event.clientY - click.event.clientY) > 4) return;
    const things = [
      ...this.scene.solids.map(({ mesh, parent }) => [mesh, parent in this.scene.scene.objects ? ['object', parent] : ['base', '']]),
      ...this.scene.cameras.map(({ body, name }) => [body, ['camera', name]]),
    ];
    const hit = click.ray.intersectObjects(things.map(([mesh]) => mesh))[0];
    if (hit) this.taken(...things.find(([mesh]) => mesh === hit.object)[1]);
  }
}

// The point of a line nearest to a ray.
function along(ray, origin, way) {
  const between = origin.clone().sub(ray.origin),
    slope = way.dot(ray.direction),
    divisor = 1 - slope * slope;
  if (divisor < 1e-6) return origin.clone();
  const far = (slope * between.dot(ray.direction) - between.dot(way)) / divisor;
  return origin.clone().addScaledVector(way, far);
}

// The pose of a camera that looks at a point, as `look_at` of the server has it.
function lookingAt(eye, point, up) {
  const forward = new THREE.Vector3(...point).sub(new THREE.Vector3(...eye)).normalize();
  if (!forward.length()) return null; // it would look at its own lens
  const ways = [new THREE.Vector3(...up), new THREE.Vector3(1, 0, 0), new THREE.Vector3(0, 0, 1)];
  const right = ways.map((way) => forward.clone().cross(way)).find((across) => across.length() > 1e-9).normalize();
  const down = forward.clone().cross(right);
  return new THREE.Matrix4().makeBasis(right, down, forward).setPosition(...eye);
}
