// The cell in three dimensions: robot, objects, cameras, target boxes and sight lines, at any time of a motion.

const matrix = (rows) => new THREE.Matrix4().set(...rows.flat());
const linear = (text) => new THREE.Color(text).convertSRGBToLinear();

// Triangles with normals that are smooth over faces that meet at less than 35 degrees.
function shape(solid, step) {
  const corner = solid.triangles, points = solid.vertices, faces = corner.length / 3;
  const at = (index) => new THREE.Vector3(points[3 * index] * step, points[3 * index + 1] * step, points[3 * index + 2] * step);
  const normals = [], touching = new Map();
  for (let face = 0; face < faces; face++) {
    const [a, b, c] = [0, 1, 2].map((k) => at(corner[3 * face + k]));
    normals.push(b.sub(a).cross(c.sub(a)));
    for (let k = 0; k < 3; k++) {
      const index = corner[3 * face + k];
      if (!touching.has(index)) touching.set(index, []);
      touching.get(index).push(face);
    }
  }
  const unit = normals.map((normal) => normal.clone().normalize());
  const position = new Float32Array(9 * faces), normal = new Float32Array(9 * faces), limit = Math.cos((35 * Math.PI) / 180);
  for (let i = 0; i < corner.length; i++) {
    const face = Math.floor(i / 3), sum = new THREE.Vector3();
    for (const other of touching.get(corner[i])) if (unit[other].dot(unit[face]) > limit) sum.add(normals[other]);
    at(corner[i]).toArray(position, 3 * i);
    sum.normalize().toArray(normal, 3 * i);
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(position, 3));
  geometry.setAttribute('normal', new THREE.BufferAttribute(normal, 3));
  return geometry;
}

class Scene3D {
  constructor(model, scene, host, chosen) {
    this.scene = scene;
    this.host = host;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.outputEncoding = THREE.sRGBEncoding;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.renderer.autoClear = false;
    host.prepend(this.renderer.domElement);
    this.world = new THREE.Scene();
    this.nodes = new Map([['world', this.world]]);
    this.through = null;
    this.build(model);
    this.light();
    this.addCameras(chosen);
    this.boxes = this.group();
    this.lines = this.group();
    this.eye = new THREE.PerspectiveCamera(38, 1.6, 0.02, 60);
    this.eye.up.set(0, 0, 1);
    this.closing = new AbortController();
    this.orbit = new Orbit(host, this.eye, () => this.draw(), this.closing.signal);
    this.frame();
    this.resizing = new ResizeObserver(() => this.draw());
    this.resizing.observe(host);
  }

  // Make room for the scene of another cell.
  close() {
    this.closing.abort();
    this.resizing.disconnect();
    this.waiting = true;
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.renderer.domElement.remove();
    for (const { label } of this.cameras) label.remove();
  }

  group(parent = this.world) {
    const group = new THREE.Group();
    parent.add(group);
    return group;
  }

  fixed(parent, rows) {
    const node = this.group(parent);
    node.matrixAutoUpdate = false;
    node.matrix.copy(matrix(rows));
    return node;
  }

  build(model) {
    this.joints = model.joints.map((joint) => ({ ...joint, axis: new THREE.Vector3(...joint.axis), still: matrix(joint.pose) }));
    for (const joint of this.joints) joint.node = this.fixed(joint.parent < 0 ? this.world : this.joints[joint.parent].node, joint.pose);
    const carrier = (index) => (index < 0 ? this.world : this.joints[index].node);
    for (const [name, link] of Object.entries(model.links)) this.nodes.set(name, this.fixed(carrier(link.joint), link.pose));
    const identity = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
    for (const [name, thing] of Object.entries(this.scene.objects)) this.nodes.set(name, this.fixed(this.world, thing.pose || identity));
    this.solids = model.solids.map((solid) => {
      const tint = solid.color, metalness = solid.parent in this.scene.objects ? 0 : 0.12;
      const material = new THREE.MeshStandardMaterial({ color: linear(tint), roughness: 0.62, metalness, side: THREE.DoubleSide });
      const mesh = new THREE.Mesh(shape(solid, model.step), material);
      mesh.castShadow = mesh.receiveShadow = true;
      this.nodes.get(solid.parent).add(mesh);
      return { name: solid.name, mesh, tint };
    });
    const objects = Object.entries(this.scene.objects).filter(([, thing]) => thing.pose === null).map(([name]) => this.nodes.get(name));
    for (const node of objects) node.visible = false;
  }

  light() {
    this.world.add(new THREE.HemisphereLight(0xffffff, 0x9aa4ad, 0.75));
    this.sun = new THREE.DirectionalLight(0xffffff, 0.75);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(2048, 2048);
    this.sun.shadow.bias = -0.0008;
    this.sun.shadow.normalBias = 0.01;
    this.world.add(this.sun, this.sun.target);
  }

  addCameras(chosen) {
    this.cameras = Object.entries(this.scene.cameras).map(([name, camera]) => {
      const node = this.fixed(this.nodes.get(camera.frame) || this.world, camera.pose);
      const body = new THREE.Mesh(new THREE.BoxGeometry(0.06, 0.045, 0.07).translate(0, 0, -0.035), new THREE.MeshStandardMaterial({ color: linear('#3c4650'), roughness: 0.5 }));
      const [[fx, , cx], [, fy, cy]] = camera.K, depth = 0.3;
      const corner = (u, v) => new THREE.Vector3(((u - cx) / fx) * depth, ((v - cy) / fy) * depth, depth);
      const [left, right, top, bottom] = [-0.5, camera.width - 0.5, -0.5, camera.height - 0.5];
      const rim = [corner(left, top), corner(right, top), corner(right, bottom), corner(left, bottom)];
      const lines = rim.flatMap((point, i) => [new THREE.Vector3(), point, point, rim[(i + 1) % 4]]);
      const frustum = new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(lines), new THREE.LineBasicMaterial({ color: linear('#5a7386') }));
      const pane = new THREE.Mesh(new THREE.BufferGeometry().setFromPoints([rim[0], rim[1], rim[2], rim[0], rim[2], rim[3]]),
        new THREE.MeshBasicMaterial({ color: linear('#5a8fb0'), transparent: true, opacity: 0.13, side: THREE.DoubleSide, depthWrite: false }));
      node.add(body, frustum, pane);
      const label = make('button', { type: 'button', tabindex: '-1', onclick: () => chosen(name) }, named(name));
      byId('labels').append(label);
      return { name, camera, node, frustum, pane, body, label };
    });
  }

  // Look at the whole cell: everything that moves or can be moved, and the cameras.
  frame() {
    this.world.updateMatrixWorld(true);
    const box = new THREE.Box3(), inner = new THREE.Box3();
    for (const { mesh } of this.solids) {
      const owner = [...this.nodes].find(([, node]) => node === mesh.parent)[0];
      if (!this.scene.objects[owner]?.fixed) inner.expandByObject(mesh);
    }
    box.copy(inner);
    for (const { node } of this.cameras) box.expandByPoint(new THREE.Vector3().setFromMatrixPosition(node.matrixWorld));
    const middle = box.getCenter(new THREE.Vector3()).lerp(inner.getCenter(new THREE.Vector3()), 0.5), size = box.getBoundingSphere(new THREE.Sphere()).radius || 1;
    this.orbit.target.copy(middle);
    this.orbit.distance = 2.3 * size;
    this.sun.position.copy(middle).add(new THREE.Vector3(0.5, -0.7, 1.6).multiplyScalar(2 * size));
    this.sun.target.position.copy(middle);
    Object.assign(this.sun.shadow.camera, { left: -1.4 * size, right: 1.4 * size, top: 1.4 * size, bottom: -1.4 * size, near: 0.1, far: 8 * size });
    this.orbit.update();
  }

  // Begin to show a motion: its target boxes, and where objects were when it began.
  load(motion) {
    this.motion = motion;
    const first = { ...motion.detail.still, ...motion.samples[0].objects };
    for (const [name, pose] of Object.entries(first)) this.nodes.set(`${name}@start`, this.fixed(this.world, pose));
    for (const { mark } of this.targets || []) mark.parent.removeFromParent();
    this.lines.clear();
    const tube = new THREE.CylinderGeometry(0.003, 0.003, 1, 6);
    this.targets = [];
    const byAtom = new Map(Object.entries(motion.detail.targets).map(([literal, target]) => [atomOf(literal), target]));
    for (const [atom, target] of byAtom) target.boxes.forEach((box, index) => {
      const node = this.fixed(this.nodes.get(box.frame), box.pose);
      const block = new THREE.BoxGeometry(...box.size.map((side) => side + 0.002));
      const mark = this.group(node);
      const edges = new THREE.LineSegments(new THREE.EdgesGeometry(block), new THREE.LineBasicMaterial());
      const fill = new THREE.Mesh(block, new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.22, depthWrite: false }));
      mark.add(edges, fill);
      const sights = this.cameras.map(() => {
        const line = new THREE.Mesh(tube, new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.75 }));
        this.lines.add(line);
        return line;
      });
      this.targets.push({ atom, index, mark, edges, fill, sights, half: box.size.map((side) => side / 2) });
    });
  }

  seek(t) {
    const [before, after, way] = this.motion.around(t);
    for (const joint of this.joints) {
      const q = before.q[joint.name] + way * (after.q[joint.name] - before.q[joint.name]);
      const moved = joint.slides ? new THREE.Matrix4().makeTranslation(...joint.axis.clone().multiplyScalar(q).toArray()) : new THREE.Matrix4().makeRotationAxis(joint.axis, q);
      joint.node.matrix.multiplyMatrices(joint.still, moved);
    }
    for (const [name, pose] of Object.entries(this.motion.detail.still)) this.nodes.get(name).matrix.copy(matrix(pose));
    for (const [name, pose] of Object.entries(before.objects)) this.nodes.get(name).matrix.copy(between(pose, after.objects[name], way));
    this.sample = this.motion.at(t);
    this.world.updateMatrixWorld(true);
    this.tell();
    this.draw();
  }

  // Colour what is seen and what hides it.
  tell() {
    const culprits = new Set();
    const shades = Object.fromEntries(['covered', 'hidden', 'out', 'range', 'angle', 'missed'].map((kind) => [kind, linear(colour(kind === 'missed' ? 'hidden' : kind))]));
    for (const target of this.targets) {
      const state = found(this.sample, target.atom), asked = state !== null;
      target.mark.visible = asked && byId('show-boxes').checked;
      const center = new THREE.Vector3().setFromMatrixPosition(target.mark.matrixWorld);
      const seen = asked && (this.through ? state.boxes[target.index].cameras[this.through].covered : state.covered);
      target.edges.material.depthTest = this.through === null; // through a camera also where something hides it
      target.edges.material.color = target.fill.material.color = shades[seen ? 'covered' : 'hidden'];
      this.cameras.forEach(({ name, node }, i) => {
        const line = target.sights[i], verdict = asked && state.boxes[target.index].cameras[name];
        line.visible = asked && byId('show-lines').checked && this.through === null;
        if (!verdict) return;
        if (verdict.cause === 'hidden' && (this.through === null || this.through === name)) culprits.add(verdict.by);
        line.material.color = shades[KINDS[kindOf(verdict)][0]];
        line.material.opacity = verdict.covered ? 0.9 : 0.42;
        const eye = new THREE.Vector3().setFromMatrixPosition(node.matrixWorld), way = center.clone().sub(eye);
        line.position.copy(eye).addScaledVector(way, 0.5);
        line.scale.set(1, way.length(), 1);
        line.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
      });
    }
    for (const { name, mesh, tint } of this.solids) mesh.material.color = linear(culprits.has(name) ? colour('hidden') : tint);
    for (const { name, node, frustum, pane, body, label } of this.cameras) {
      frustum.visible = pane.visible = byId('show-frusta').checked && this.through === null;
      body.visible = this.through !== name;
      label.hidden = this.through !== null;
      node.visible = true;
    }
  }

  look(name) {
    this.through = name;
    this.orbit.enabled = name === null;
    if (this.sample) this.tell();
    this.draw();
  }

  // What a camera sees: its own intrinsics as a projection (OpenCV's pixels, with the centre of the first at 0, 0).
  lens({ camera, node }) {
    const view = new THREE.Camera(), { width, height } = camera, [[fx, , cx], [, fy, cy]] = camera.K;
    const [near, far] = [0.01, 60];
    view.projectionMatrix.set((2 * fx) / width, 0, 1 - (2 * cx + 1) / width, 0, 0, (2 * fy) / height, (2 * cy + 1) / height - 1, 0,
      0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near), 0, 0, -1, 0);
    view.projectionMatrixInverse.copy(view.projectionMatrix).invert();
    view.matrixAutoUpdate = false;
    view.matrix.copy(node.matrixWorld).multiply(new THREE.Matrix4().makeScale(1, -1, -1));
    view.updateMatrixWorld(true);
    return view;
  }

  draw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.render(); });
  }

  render() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height);
    this.renderer.setScissorTest(false);
    this.renderer.setViewport(0, 0, width, height);
    const chosen = this.cameras.find(({ name }) => name === this.through);
    if (chosen) {
      const { camera } = chosen, scale = Math.min(width / camera.width, height / camera.height);
      const [w, h] = [camera.width * scale, camera.height * scale], [x, y] = [(width - w) / 2, (height - h) / 2];
      this.renderer.setClearColor(0x0b0f13, 1);
      this.renderer.clear();
      this.renderer.setScissorTest(true);
      this.renderer.setScissor(x, y, w, h);
      this.renderer.setViewport(x, y, w, h);
      this.renderer.setClearColor(linear(colour('sky')), 1);
      this.renderer.clear();
      this.renderer.render(this.world, this.lens(chosen));
    } else {
      this.eye.aspect = width / height;
      this.eye.updateProjectionMatrix();
      this.renderer.setClearColor(0, 0);
      this.renderer.clear();
      this.renderer.render(this.world, this.eye);
      this.placeLabels(width, height);
    }
  }

  placeLabels(width, height) {
    for (const { node, label } of this.cameras) {
      const point = new THREE.Vector3().setFromMatrixPosition(node.matrixWorld).project(this.eye);
      label.hidden = point.z > 1 || Math.abs(point.x) > 1 || Math.abs(point.y) > 1;
      label.style.transform = `translate(${((point.x + 1) / 2) * width}px, ${((1 - point.y) / 2) * height}px) translate(-50%, -170%)`;
    }
  }

  // Where things are, for scripts: the tool frame, and the corners of a target box in the order of the JSON documents [m].
  toolPosition() {
    return new THREE.Vector3().setFromMatrixPosition(this.nodes.get(this.scene.robot.tool_frame).matrixWorld).toArray();
  }

  corners(atom, index) {
    const { mark, half } = this.targets.find((target) => target.atom === atom && target.index === index);
    const signs = [-1, 1];
    return signs.flatMap((x) => signs.flatMap((y) => signs.map((z) =>
      new THREE.Vector3(x * half[0], y * half[1], z * half[2]).applyMatrix4(mark.matrixWorld).toArray())));
  }

  // Pixel at which a camera sees a point of the world, its distortion left out.
  pixel(name, point) {
    const chosen = this.cameras.find((camera) => camera.name === name);
    const { x, y } = new THREE.Vector3(...point).project(this.lens(chosen));
    return [((x + 1) / 2) * chosen.camera.width - 0.5, ((1 - y) / 2) * chosen.camera.height - 0.5];
  }
}

function between(first, second, way) {
  if (way === 0) return matrix(first);
  const parts = [first, second].map((rows) => {
    const [position, turn, scale] = [new THREE.Vector3(), new THREE.Quaternion(), new THREE.Vector3()];
    matrix(rows).decompose(position, turn, scale);
    return { position, turn, scale };
  });
  return new THREE.Matrix4().compose(parts[0].position.lerp(parts[1].position, way), parts[0].turn.slerp(parts[1].turn, way), parts[0].scale);
}
