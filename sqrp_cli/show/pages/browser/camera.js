// A camera of the cell: its body, its view as a pyramid, and what it sees.

class CellCamera {
  // node: what its optical frame (x right, y down, z forward) is fixed to.
  constructor(name, camera, node, chosen) {
    Object.assign(this, { name, camera, node });
    const grey = new THREE.MeshStandardMaterial({ color: linear('#3c4650'), roughness: 0.5 });
    this.body = new THREE.Mesh(new THREE.BoxGeometry(0.06, 0.045, 0.07).translate(0, 0, -0.035), grey);
    const glass = { color: linear('#5a8fb0'), transparent: true, opacity: 0.13, side: THREE.DoubleSide };
    this.frustum = new THREE.Group().add(
      new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: linear('#5a7386') })),
      new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshBasicMaterial({ ...glass, depthWrite: false })),
    );
    this.shapeFrustum();
    node.add(this.body, this.frustum);
    this.label = make('button', { type: 'button', tabindex: '-1', onclick: () => chosen(name) }, named(name));
    byId('labels').append(this.label);
  }

  // Draw the pyramid of its lens.
  shapeFrustum() {
    const rim = this.corners(0.3);
    const [edges, pane] = this.frustum.children;
    edges.geometry.setFromPoints(rim.flatMap((point, i) => [new THREE.Vector3(), point, point, rim[(i + 1) % 4]]));
    pane.geometry.setFromPoints([0, 1, 2, 0, 2, 3].map((i) => rim[i]));
  }

  // Where the corners of its image are at a depth [m], in the optical frame; distortion is left out.
  corners(depth) {
    const { width, height, K } = this.camera;
    const [[fx, , cx], [, fy, cy]] = K;
    const [left, right, top, bottom] = [-0.5, width - 0.5, -0.5, height - 0.5];
    const at = ([u, v]) => new THREE.Vector3(((u - cx) / fx) * depth, ((v - cy) / fy) * depth, depth);
    return [
      [left, top],
      [right, top],
      [right, bottom],
      [left, bottom],
    ].map(at);
  }

  position() {
    return new THREE.Vector3().setFromMatrixPosition(this.node.matrixWorld);
  }

  // Its own intrinsics as a projection. The centre of the first pixel is at 0, 0; distortion is left out.
  lens() {
    const view = new THREE.Camera(),
      { width, height, K } = this.camera;
    const [[fx, , cx], [, fy, cy]] = K,
      near = 0.01,
      far = 60;
    // prettier-ignore
    view.projectionMatrix.set(
      (2 * fx) / width, 0, 1 - (2 * cx + 1) / width, 0,
      0, (2 * fy) / height, (2 * cy + 1) / height - 1, 0,
      0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near),
      0, 0, -1, 0,
    );
    view.projectionMatrixInverse.copy(view.projectionMatrix).invert();
    view.matrixAutoUpdate = false;
    view.matrix.copy(this.node.matrixWorld).multiply(new THREE.Matrix4().makeScale(1, -1, -1));
    view.updateMatrixWorld(true);
    return view;
  }

  // Pixel at which it sees a point of the world.
  pixel(point) {
    const { x, y } = new THREE.Vector3(...point).project(this.lens());
    return [((x + 1) / 2) * this.camera.width - 0.5, ((1 - y) / 2) * this.camera.height - 0.5];
  }

  // Put its name beside it in a view of some size, where no other is: those that are there, as [left, top, width].
  placeLabel(eye, width, height, taken) {
    const { x, y, z } = this.position().project(eye);
    this.label.hidden = z > 1 || Math.abs(x) > 1 || Math.abs(y) > 1;
    if (this.label.hidden) return;
    this.size = this.size?.[0] ? this.size : [this.label.offsetWidth, this.label.offsetHeight];
    const [wide, high] = this.size,
      [right, down] = [((x + 1) / 2) * width, ((1 - y) / 2) * height];
    const places = [
      [right - wide / 2, down - 1.7 * high],
      [right - wide / 2, down + 0.7 * high],
      [right + high, down - high / 2],
      [right - high - wide, down - high / 2],
    ];
    const meets = (left, top) => taken.some(([l, t, w]) => left < l + w && l < left + wide && Math.abs(t - top) < high);
    const [left, top] = places.find((place) => !meets(...place)) ?? places[0];
    taken.push([left, top, wide]);
    this.label.style.transform = `translate(${left}px, ${top}px)`;
  }
}
