// A target box, and the lines along which the cameras look at it, coloured by what they see.

class Sight {
  // node: what the box is fixed to at its own pose. atom, index: which box of which target. In a run a box counts
  // from a time to another, as every attempt has boxes of its own.
  constructor(atom, index, box, node, cameras, lines) {
    const { size, from = -Infinity, to = Infinity } = box;
    Object.assign(this, { atom, index, node, from, to, half: size.map((side) => side / 2) });
    const block = new THREE.BoxGeometry(...size.map((side) => side + 0.002));
    const tube = new THREE.CylinderGeometry(0.003, 0.003, 1, 6);
    this.edges = new THREE.LineSegments(new THREE.EdgesGeometry(block), new THREE.LineBasicMaterial());
    this.fill = new THREE.Mesh(
      block,
      new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.22, depthWrite: false }),
    );
    node.add(this.edges, this.fill);
    this.lines = cameras.map((camera) => {
      const mesh = new THREE.Mesh(tube, new THREE.MeshBasicMaterial({ transparent: true }));
      lines.add(mesh);
      return { camera, mesh };
    });
  }

  // Show a sample; through: the camera of the view, or null. Returns what hides the box.
  show(sample, through, shades) {
    const counts = sample.t >= this.from && sample.t < this.to,
      state = counts ? found(sample, this.atom) : null,
      culprits = [];
    this.edges.visible = this.fill.visible = state !== null && byId('show-boxes').checked;
    for (const { mesh } of this.lines) mesh.visible = state !== null && byId('show-lines').checked && through === null;
    if (state === null) return culprits;
    const verdicts = state.boxes[this.index]?.cameras ?? state.cameras;
    const shown = through === null ? state : (verdicts[through] ?? state); // a camera may be newer than what is told
    const shade = shown.kind ? KINDS[shown.kind][0] : shown.covered ? 'covered' : 'hidden';
    this.edges.material.depthTest = through === null; // a camera's view shows it also where something hides it
    this.edges.material.color = this.fill.material.color = shades[shade];
    const center = new THREE.Vector3().setFromMatrixPosition(this.node.matrixWorld);
    for (const { camera, mesh } of this.lines) {
      const verdict = verdicts[camera.name];
      if (!verdict) {
        mesh.visible = false;
        continue;
      }
      mesh.material.color = shades[KINDS[kindOf(verdict)][0]];
      mesh.material.opacity = verdict.covered ? 0.9 : 0.42;
      stretch(mesh, camera.position(), center, verdict.covered ? 1 : 0.45);
      if (['hidden', 'same_colour', 'too_dark'].includes(verdict.cause) && [null, camera.name].includes(through))
        culprits.push(verdict.by);
    }
    return culprits;
  }

  // Corners in the world, in the order of the JSON documents [m].
  corners() {
    const signs = [-1, 1];
    const units = signs.flatMap((x) => signs.flatMap((y) => signs.map((z) => [x, y, z])));
    const at = (unit) => new THREE.Vector3(...unit.map((sign, axis) => sign * this.half[axis]));
    return units.map((unit) => at(unit).applyMatrix4(this.node.matrixWorld).toArray());
  }

  remove() {
    this.node.removeFromParent();
    for (const { mesh } of this.lines) mesh.removeFromParent();
    for (const { geometry } of [this.edges, this.fill, this.lines[0]?.mesh]) geometry.dispose();
  }
}

// Lay a cylinder of length 1 along y from one point to another, as thick as `thick` of its own.
function stretch(mesh, from, to, thick) {
  const way = to.clone().sub(from);
  mesh.position.copy(from).addScaledVector(way, 0.5);
  mesh.scale.set(thick, way.length(), thick);
  mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
}
