// The cell in three dimensions: robot, objects, cameras and what they look at, at any time of a motion.

const COARSE = 0.5; // pixels of the picture per pixel of the page while a hand moves something, without a graphics card

class Scene3D {
  constructor(model, scene, host, chosen, places) {
    this.scene = scene;
    this.host = host;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.outputEncoding = THREE.sRGBEncoding;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.renderer.shadowMap.autoUpdate = false; // only where something that casts one has moved
    this.renderer.autoClear = false;
    this.slow = drawsWithoutCard(this.renderer.getContext());
    this.held = false; // whether a hand moves something, so that the next picture is close
    host.prepend(this.renderer.domElement);
    this.world = new THREE.Scene();
    this.nodes = new Map([['world', this.world]]);
    this.through = null;
    this.build(model);
    this.light();
    this.addCameras(chosen);
    this.mounts = new Mounts(places, this);
    this.lines = this.group();
    this.sights = [];
    this.starts = [];
    this.eye = new THREE.PerspectiveCamera(38, 1.6, 0.02, 60);
    this.eye.up.set(0, 0, 1);
    this.closing = new AbortController();
    this.orbit = new Orbit(host, this.eye, () => this.draw(), this.closing.signal);
    this.frame();
    this.renderer.shadowMap.needsUpdate = true;
    this.resizing = new ResizeObserver(() => this.draw());
    this.resizing.observe(host);
  }

  // Make room for the scene of another cell.
  close() {
    this.closing.abort();
    this.resizing.disconnect();
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
    this.joints = model.joints.map((joint) => ({
      ...joint,
      axis: new THREE.Vector3(...joint.axis),
      still: matrix(joint.pose),
    }));
    for (const joint of this.joints)
      joint.node = this.fixed(joint.parent < 0 ? this.world : this.joints[joint.parent].node, joint.pose);
    const carrier = (index) => (index < 0 ? this.world : this.joints[index].node);
    this.links = model.links;
    for (const [name, link] of Object.entries(model.links))
      this.nodes.set(name, this.fixed(carrier(link.joint), link.pose));
    const identity = [
      [1, 0, 0, 0],
      [0, 1, 0, 0],
      [0, 0, 1, 0],
      [0, 0, 0, 1],
    ];
    for (const [name, object] of Object.entries(this.scene.objects))
      this.nodes.set(name, this.fixed(this.world, object.pose || identity));
    this.solids = model.solids.map((solid) => {
      const tint = solid.color,
        metalness = solid.parent in this.scene.objects ? 0 : 0.12;
      const material = new THREE.MeshStandardMaterial({
        color: linear(tint),
        roughness: 0.62,
        metalness,
        side: THREE.DoubleSide,
      });
      const mesh = new THREE.Mesh(shape(solid, model.step), material);
      mesh.castShadow = mesh.receiveShadow = true;
      this.nodes.get(solid.parent).add(mesh);
      return { name: solid.name, parent: solid.parent, mesh, tint };
    });
    this.present(Object.keys(this.scene.objects).filter((name) => this.scene.objects[name].pose !== null));
  }

  // Show these objects and no others.
  present(names) {
    for (const name of Object.keys(this.scene.objects)) this.nodes.get(name).visible = names.includes(name);
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
      return new CellCamera(name, camera, node, chosen);
    });
  }

  // Look at the whole cell: the robot, what can be moved, and the cameras.
  frame() {
    this.world.updateMatrixWorld(true);
    const box = new THREE.Box3(),
      points = [];
    for (const { mesh, parent } of this.solids) if (!this.scene.objects[parent]?.fixed) box.expandByObject(mesh);
    for (const x of [box.min.x, box.max.x])
      for (const y of [box.min.y, box.max.y])
        for (const z of [box.min.z, box.max.z]) points.push(new THREE.Vector3(x, y, z));
    points.push(...this.cameras.map((camera) => camera.position()), ...this.mounts.positions());
    box.setFromPoints(points).getCenter(this.orbit.target);
    this.orbit.update();
    const [right, up, back] = [0, 1, 2].map((column) =>
      new THREE.Vector3().setFromMatrixColumn(this.eye.matrixWorld, column),
    );
    const slope = 0.84 * Math.tan((this.eye.fov * Math.PI) / 360),
      aspect = this.host.clientWidth / this.host.clientHeight || 1.6;
    this.orbit.distance = Math.max(
      0.3,
      ...points.map((point) => {
        const from = point.clone().sub(this.orbit.target);
        return from.dot(back) + Math.max(Math.abs(from.dot(right)) / (aspect * slope), Math.abs(from.dot(up)) / slope);
      }),
    );
    this.orbit.update();
    const size = box.getSize(new THREE.Vector3()).length() / 2;
    this.sun.position.copy(this.orbit.target).add(new THREE.Vector3(0.5, -0.7, 1.6).multiplyScalar(2 * size));
    this.sun.target.position.copy(this.orbit.target);
    Object.assign(this.sun.shadow.camera, {
      left: -1.4 * size,
      right: 1.4 * size,
      top: 1.4 * size,
      bottom: -1.4 * size,
      near: 0.1,
      far: 8 * size,
    });
  }

  // Begin to show a motion: its target boxes, and where objects were when it began.
  load(motion) {
    this.motion = motion;
    for (const sight of this.sights) sight.remove();
    for (const node of this.starts) node.removeFromParent();
    const first = Object.entries({ ...motion.detail.still, ...motion.places[0].objects });
    this.present(first.map(([name]) => name));
    this.starts = first.map(([name, pose]) => {
      const node = this.fixed(this.world, pose);
      this.nodes.set(`${name}@start`, node);
      return node;
    });
    const targets = new Map(
      Object.entries(motion.detail.targets).map(([literal, target]) => [atomOf(literal), target]),
    );
    this.sights = [...targets].flatMap(([atom, { boxes }]) =>
      boxes.map((box, index) => {
        const node = this.fixed(this.nodes.get(box.frame), box.pose);
        return new Sight(atom, index, box, node, this.cameras, this.lines);
      }),
    );
  }

  seek(t) {
    const [before, after, way] = this.motion.around(t);
    for (const joint of this.joints) {
      const q = before.q[joint.name] + way * (after.q[joint.name] - before.q[joint.name]);
      const moved = joint.slides
        ? new THREE.Matrix4().makeTranslation(...joint.axis.clone().multiplyScalar(q).toArray())
        : new THREE.Matrix4().makeRotationAxis(joint.axis, q);
      joint.node.matrix.multiplyMatrices(joint.still, moved);
    }
    for (const [name, pose] of Object.entries(this.motion.detail.still)) this.nodes.get(name).matrix.copy(matrix(pose));
    for (const [name, pose] of Object.entries(before.objects))
      this.nodes.get(name).matrix.copy(between(pose, after.objects[name], way));
    this.place = before;
    this.sample = this.motion.at(t);
    this.world.updateMatrixWorld(true);
    this.renderer.shadowMap.needsUpdate = true;
    if (this.following) this.orbit.aim(this.tool());
    this.colour();
    this.draw();
  }

  // Colour what is seen and what hides it.
  colour() {
    const kinds = ['covered', 'hidden', 'out', 'range', 'angle', 'nothing'];
    const shades = Object.fromEntries(kinds.map((kind) => [kind, linear(colour(kind))]));
    shades.missed = shades.same = shades.hidden;
    this.culprits = new Set(this.sights.flatMap((sight) => sight.show(this.sample, this.through, shades)));
    for (const { name, mesh, tint } of this.solids)
      mesh.material.color = this.culprits.has(name) ? shades.hidden : linear(tint);
    for (const camera of this.cameras) {
      camera.frustum.visible = byId('show-frusta').checked && this.through === null;
      camera.body.visible = this.through !== camera.name;
      camera.label.hidden = this.through !== null;
    }
    this.mounts.show(byId('show-mounts').checked && this.through === null);
  }

  // Keep the tool in the middle of the outside view, close up; or return to the last viewpoint.
  follow(wanted) {
    const { target, distance } = this.orbit;
    if (wanted) this.left = { target: target.clone(), distance };
    this.following = wanted;
    this.orbit.distance = wanted ? Math.min(distance, 0.9) : this.left.distance;
    if (!wanted) this.orbit.aim(this.left.target);
  }

  look(name) {
    this.through = name;
    this.orbit.enabled = name === null;
    if (this.sample) this.colour();
    this.draw();
  }

  // Draw at the next frame. patience: how long that may wait for what is shown with it [ms]; without a graphics card
  // nothing takes longer than a picture.
  draw(patience = 0) {
    if (patience) {
      this.later ??= setTimeout(() => this.draw(), patience);
      return;
    }
    clearTimeout(this.later);
    this.later = undefined;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      if (!this.closing.signal.aborted) this.render();
    });
  }

  render() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    const size = this.renderer.getSize(new THREE.Vector2()),
      fine = this.slow && this.held ? COARSE : Math.min(devicePixelRatio, 2);
    if (size.x !== width || size.y !== height || fine !== this.renderer.getPixelRatio()) {
      this.renderer.setPixelRatio(fine);
      this.renderer.setSize(width, height);
    }
    this.renderer.setScissorTest(false);
    this.renderer.setViewport(0, 0, width, height);
    const chosen = this.cameras.find(({ name }) => name === this.through);
    if (chosen) {
      const { camera } = chosen,
        scale = Math.min(width / camera.width, height / camera.height);
      const [w, h] = [camera.width * scale, camera.height * scale],
        [x, y] = [(width - w) / 2, (height - h) / 2];
      this.renderer.setClearColor(0x0b0f13, 1);
      this.renderer.clear();
      this.renderer.setScissorTest(true);
      this.renderer.setScissor(x, y, w, h);
      this.renderer.setViewport(x, y, w, h);
      this.renderer.setClearColor(linear(colour('sky')), 1);
      this.renderer.clear();
      this.renderer.render(this.world, chosen.lens());
    } else {
      this.eye.aspect = width / height;
      this.eye.updateProjectionMatrix();
      this.gizmo?.fit(this.eye);
      this.renderer.setClearColor(0, 0);
      this.renderer.clear();
      this.renderer.render(this.world, this.eye);
      const taken = [];
      for (const camera of this.cameras) camera.placeLabel(this.eye, width, height, taken);
    }
  }

  // For scripts: where the tool frame and the corners of a target box are [m], and the pixel of a point in a camera.
  toolPosition() {
    return this.tool().toArray();
  }

  tool() {
    return new THREE.Vector3().setFromMatrixPosition(this.nodes.get(this.scene.robot.tool_frame).matrixWorld);
  }

  // For scripts: the pose of an object, as rows.
  objectPose(name) {
    const columns = this.nodes.get(name).matrixWorld.elements;
    return [0, 1, 2, 3].map((row) => [0, 1, 2, 3].map((column) => columns[4 * column + row]));
  }

  corners(atom, index) {
    return this.sights.find((sight) => sight.atom === atom && sight.index === index).corners();
  }

  pixel(name, point) {
    return this.cameras.find((camera) => camera.name === name).pixel(point);
  }
}

// Whether the processor draws.
function drawsWithoutCard(gl) {
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  return names !== null && /swiftshader|llvmpipe|software/i.test(gl.getParameter(names.UNMASKED_RENDERER_WEBGL));
}
