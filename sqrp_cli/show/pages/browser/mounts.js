// Where cameras may go: every mount as a ball, larger and greener the more one camera there would see, and the cameras
// that were chosen in a table.

const BALL = 0.024; // radius of the best mount's ball [m]

class Mounts {
  constructor(places, scene) {
    Object.assign(this, { places, scene });
    const frames = [...new Set(places.map(({ frame }) => frame))];
    this.groups = frames.map((frame) => this.balls(frame));
  }

  // The balls of one frame, as instances of a single mesh.
  balls(frame) {
    const own = this.places.filter((place) => place.frame === frame);
    const ball = new THREE.SphereGeometry(BALL, 14, 10);
    const mesh = new THREE.InstancedMesh(ball, new THREE.MeshBasicMaterial(), own.length);
    own.forEach((place, i) => {
      const size = place.seen === null ? 0.45 : 0.55 + 0.45 * place.seen;
      const pose = new THREE.Matrix4().makeScale(size, size, size).setPosition(...place.position);
      mesh.setMatrixAt(i, pose);
    });
    mesh.frustumCulled = false;
    (this.scene.nodes.get(frame) || this.scene.world).add(mesh);
    return { own, mesh };
  }

  // Show or hide them, in the colours of the page.
  show(visible) {
    const [poor, middling, good, shut] = ['hidden', 'range', 'covered', 'nothing'].map((kind) => linear(colour(kind)));
    for (const { own, mesh } of this.groups) {
      mesh.visible = visible;
      own.forEach(({ seen }, i) => {
        const shade = seen < 0.5 ? poor.clone().lerp(middling, 2 * seen) : middling.clone().lerp(good, 2 * seen - 1);
        mesh.setColorAt(i, seen === null ? shut : shade);
      });
      mesh.instanceColor.needsUpdate = true;
    }
  }

  // Where all are in the world [m].
  positions() {
    return this.groups.flatMap(({ own, mesh }) =>
      own.map(({ position }) => new THREE.Vector3(...position).applyMatrix4(mesh.matrixWorld)),
    );
  }

  // What is said of the mount at a place of the window; nothing where there is none.
  at(x, y) {
    const { left, top, width, height } = this.scene.host.getBoundingClientRect();
    const ray = new THREE.Raycaster();
    ray.setFromCamera({ x: (2 * (x - left)) / width - 1, y: 1 - (2 * (y - top)) / height }, this.scene.eye);
    const hits = this.groups.flatMap(({ own, mesh }) =>
      mesh.visible ? ray.intersectObject(mesh).map((hit) => ({ ...hit, place: own[hit.instanceId] })) : [],
    );
    const [first] = hits.sort((a, b) => a.distance - b.distance);
    return first ? mountInWords(first.place) : '';
  }
}

function mountInWords({ name, seen, camera }) {
  const chosen = camera === null ? '' : `, where ${camera} is`;
  if (seen === null) return `${name}: a camera here would be in the way`;
  return `${name}${chosen}: with one camera only, here, ${percent(seen)} is seen on average`;
}

// The chosen cameras as a table, and what its columns and the balls mean. look: called with a camera that is clicked.
function showPlacement({ by, cameras, keep, mounts }, look) {
  const priced = cameras.some(({ price }) => price > 0);
  const titles = ['camera', 'mount', 'lens', 'where [m]', 'alone', 'loss if it fails', ...(priced ? ['price'] : [])];
  const number = (i) => (i > 3 ? { class: 'number' } : {});
  const row = ({ name, mount, lens, pose, frame, alone, loss, price }) => {
    const place = pose.slice(0, 3).map((line) => fixed(line[3], 2));
    const cells = [
      make('button', { type: 'button', 'aria-label': `Look through ${name}`, onclick: () => look(name) }, named(name)),
      named(mount),
      named(lens),
      named(`${place.join(', ')}${frame === 'world' ? '' : ` on ${frame}`}`),
      percent(alone),
      `−${fixed(100 * loss, 1)} points`,
      ...(priced ? [String(+price.toPrecision(4))] : []),
    ];
    return make('tr', {}, ...cells.map((cell, i) => make('td', number(i), cell)));
  };
  const head = titles.map((title, i) => make('th', { scope: 'col', ...number(i) }, title));
  byId('cameras').append(
    ...(cameras.length
      ? [make('thead', {}, make('tr', {}, ...head)), make('tbody', {}, ...cameras.map(row))]
      : [make('caption', {}, 'None: no camera on these mounts would help.')]),
  );
  const terms = [
    ['seen', 'share of the time in which cameras see all that must be seen: of the critical time, or of all time'],
    ['alone', `the ${by} share seen, of all candidates, with this camera only`],
    ['loss if it fails', `by how much the ${by} share falls without it`],
    ...(keep.length ? [['kept', `${keep.join(', ')}, as in the workspace`]] : []),
  ];
  for (const [term, words] of terms) byId('cameras-words').append(make('dt', {}, term), make('dd', {}, prose(words)));
  const shut = mounts.some(({ seen }) => seen === null);
  byId('mounts-words').append(
    make('span', {}, 'seen on average with one camera only, at a mount: 0 %', make('i', { class: 'ramp' }), '100 %'),
    ...(shut ? [make('span', {}, make('i', { class: 'spot nothing' }), 'in the way')] : []),
    make('span', {}, 'point at a ball to read its name'),
  );
}
