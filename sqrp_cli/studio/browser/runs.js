// A run in the simulated cell as it happens: what images show, what is noticed, the images, and the robot in the picture.

class Runs {
  // scene: gives the picture of the cell.
  constructor(tell, scene) {
    Object.assign(this, { tell, scene, images: new Map(), going: false, newest: new Map() });
    byId('run').addEventListener('click', () => this.run());
    byId('run-stop').addEventListener('click', () => tell({ do: 'stop' }));
    byId('run-slip').addEventListener('click', () => tell({ do: 'fault', name: 'slip' }));
  }

  run() {
    const faults = byId('faults-wanted').value.split(/[\s,;]+/).filter(Boolean);
    this.tell({ do: 'run', file: byId('program').value.trim(), faults });
  }

  began({ file, cameras, faults }) {
    this.going = true;
    byId('running').hidden = false;
    document.body.classList.add('live');
    byId('run-what').replaceChildren(named(file), ...(faults.length ? [' with ', named(faults.join(', '))] : []));
    byId('run-events').replaceChildren();
    byId('run-atoms').replaceChildren();
    this.images = new Map(
      cameras.map((name) => [name, make('img', { alt: `What ${name} sees`, width: 320, height: 240 })]),
    );
    const framed = ([name, image]) => make('figure', {}, image, make('figcaption', {}, named(name)));
    byId('run-images').replaceChildren(...[...this.images].map(framed));
    for (const id of ['run-stop', 'run-slip']) byId(id).hidden = false;
  }

  // Show something at the next frame, and only the newest of its kind: a slow page does not fall behind the run.
  soon(kind, show) {
    if (!this.newest.size) requestAnimationFrame(() => this.catchUp());
    this.newest.set(kind, show);
  }

  catchUp() {
    for (const show of this.newest.values()) show();
    this.newest.clear();
  }

  image({ camera, data }) {
    const image = this.images.get(camera);
    if (image) image.src = `data:image/jpeg;base64,${data}`;
  }

  clock(t) {
    byId('run-time').textContent = seconds(t);
  }

  doing({ t, text }) {
    this.clock(t);
    byId('run-doing').replaceChildren(named(text));
  }

  evidence({ t, literals }) {
    this.clock(t);
    byId('run-atoms').replaceChildren(...Object.entries(literals).map(([atom, shown]) => this.atom(atom, shown)));
  }

  atom(atom, { says, value, asked, predicted, cameras }) {
    const blind = value === 'blind',
      style = { true: 'covered', false: 'out', blind: 'missed' }[value],
      by = Object.entries(cameras).filter(([, one]) => one !== 'blind');
    return make(
      'li',
      { class: asked ? null : 'faint' },
      make('i', { class: `spot ${asked ? style : 'nothing'}` }),
      named(says),
      make('b', {}, blind ? (predicted ? 'not seen' : 'not seen, as predicted') : value),
      make('span', { class: 'faint' }, by.map(([name]) => name).join(', ')),
    );
  }

  event({ t, text, kind }) {
    const row = make('li', { class: kind }, ...(t === null ? [] : [make('b', {}, seconds(t)), ' ']), prose(text));
    byId('run-events').append(row);
    byId('run-events').scrollTop = 1e6;
  }

  // The robot and the objects where they really are in the simulation.
  state({ q, objects, held }) {
    const scene = this.scene();
    if (!scene || !this.going) return;
    const places = Object.fromEntries(Object.entries(objects).map(([name, pose]) => [name, poseRows(pose)]));
    const now = { t: 0, q, objects: places, held },
      sample = { t: 0, covered: null, literals: {} };
    scene.motion = { detail: { still: {} }, around: () => [now, now, 0], at: () => sample };
    scene.seek(0);
  }

  ended(report) {
    const { outcome, time, faults } = report;
    this.report = report;
    const told = faults.map(({ name, happened, detected, recovered }) => {
      if (happened === null) return `${name} never came true`;
      if (detected === null) return `${name} at ${seconds(happened)} was never seen`;
      const after = `${name} at ${seconds(happened)}, noticed after ${seconds(detected - happened)}`;
      return recovered === null ? after : `${after}, done after all at ${seconds(recovered)}`;
    });
    const end = { done: 'the program is done', missed: 'a fault was missed' }[outcome] ?? 'the robot has stopped';
    this.event({ t: time, text: [end, ...told].join('; '), kind: outcome });
  }

  over() {
    this.going = false;
    document.body.classList.remove('live');
    for (const id of ['run-stop', 'run-slip']) byId(id).hidden = true;
  }
}
