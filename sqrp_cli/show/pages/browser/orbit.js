// Looking around: drag to turn, shift-drag or right drag to move, wheel or pinch to come closer; arrows, + and -.

class Orbit {
  constructor(host, camera, changed, signal) {
    Object.assign(this, {
      host,
      camera,
      changed,
      target: new THREE.Vector3(),
      distance: 3,
      azimuth: -0.9,
      elevation: 0.45,
    });
    this.pointers = new Map();
    this.enabled = true;
    host.addEventListener(
      'pointerdown',
      (event) => {
        if (event.target.closest('button')) return;
        host.setPointerCapture(event.pointerId);
        this.pointers.set(event.pointerId, event);
      },
      { signal },
    );
    host.addEventListener('pointermove', (event) => this.drag(event), { signal });
    for (const name of ['pointerup', 'pointercancel'])
      host.addEventListener(name, (event) => this.pointers.delete(event.pointerId), { signal });
    host.addEventListener('contextmenu', (event) => event.preventDefault(), { signal });
    host.addEventListener(
      'wheel',
      (event) => {
        if (!this.enabled) return;
        event.preventDefault();
        this.zoom(Math.exp(0.001 * event.deltaY));
      },
      { passive: false, signal },
    );
    host.addEventListener('keydown', (event) => this.key(event), { signal });
  }

  drag(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last || !this.enabled) return;
    const dx = event.clientX - last.clientX,
      dy = event.clientY - last.clientY;
    if (this.pointers.size === 2) {
      const other = [...this.pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
      const apart = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY);
      this.zoom(apart(last) / Math.max(1, apart(event)));
    } else if (event.shiftKey || event.buttons === 2) this.move(dx, dy);
    else this.turn(-0.006 * dx, 0.006 * dy);
    this.pointers.set(event.pointerId, event);
  }

  key(event) {
    const act = {
      ArrowLeft: () => this.turn(-0.1, 0),
      ArrowRight: () => this.turn(0.1, 0),
      ArrowUp: () => this.turn(0, 0.08),
      ArrowDown: () => this.turn(0, -0.08),
      '+': () => this.zoom(0.88),
      '=': () => this.zoom(0.88),
      '-': () => this.zoom(1.14),
    }[event.key];
    if (!act || !this.enabled || event.target !== this.host) return;
    event.preventDefault();
    act();
  }

  turn(azimuth, elevation) {
    this.azimuth += azimuth;
    this.elevation = Math.max(-0.2, Math.min(1.55, this.elevation + elevation));
    this.update();
  }

  zoom(factor) {
    this.distance = Math.max(0.15, Math.min(30, this.distance * factor));
    this.update();
  }

  move(dx, dy) {
    const scale = (2 * this.distance * Math.tan((this.camera.fov * Math.PI) / 360)) / this.host.clientHeight;
    const [right, up] = [0, 1].map((column) =>
      new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, column),
    );
    this.target.addScaledVector(right, -dx * scale).addScaledVector(up, dy * scale);
    this.update();
  }

  // Look at a point from the same side.
  aim(point) {
    this.target.copy(point);
    this.update();
  }

  update() {
    const level = Math.cos(this.elevation) * this.distance;
    this.camera.position
      .set(Math.cos(this.azimuth) * level, Math.sin(this.azimuth) * level, Math.sin(this.elevation) * this.distance)
      .add(this.target);
    this.camera.lookAt(this.target);
    this.camera.updateMatrixWorld();
    this.changed();
  }
}
