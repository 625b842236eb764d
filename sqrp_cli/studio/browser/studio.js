// The studio: the page of a ranking, live. The server has the state; this shows it, and says what hands do.

const NOBODY = { name: 'ranking …', mark: '', labels: { candidate: 'being ranked …' }, candidate: null, reasons: [], scene: 0, moves: false, figures: [], retried: [], said: [] };

const TOGETHER = 50; // so long a picture of what a hand moves waits for its verdicts [ms]

const HELP = {
  advise: 'Look for the least changes after which the cameras see more of this candidate.',
  'place-cameras': 'Look for the best places of all cameras, on the mounts that the workspace states.',
  write: 'Append this candidate to the program file; of a cell with unsaved changes there is no program.',
  run: 'Run the program file in the simulated cell, and watch the images here.',
  'faults-wanted': 'What goes wrong in the run, and when: slip@lift+0.4 drops the part 0.4 s after the lift began.',
};

const BEFORE = 'against before it was taken in hand';

// Candidates in a column beside the picture: their ways and what comes after a retry have no room.
class NarrowTable extends EntryTable {
  labels(select) {
    return super.labels(select).filter(({ title }, i) => !i || title !== 'way');
  }

  faults() {
    return super.faults().filter(({ title }) => title !== 'done after a retry');
  }
}

class Studio extends Page {
  constructor(cell, tell) {
    super({
      title: '', summary: '', heading: 'Candidates', about: [], entries: [NOBODY], scenes: [cell.scene], of_images: false, placement: null, compared: false, opens_at: 0,
    });
    document.body.classList.add('studio');
    this.tell = tell;
    this.state = null;
    this.saved = new Map();
    this.answered = this.asked = 0;
    this.waiting = null;
    this.progress = '';
    this.sketchShown = this.detailShown = false;
    this.latencies = [];
    this.model = cell.model;
    this.fields = new Fields((move) => this.put(move));
    this.runs = new Runs(tell, () => this.scene);
    this.wire();
    this.enterCell(cell);
  }

  // What hands do

  wire() {
    const say = (id, message) => byId(id).addEventListener('click', () => this.tell(message()));
    say('undo', () => ({ do: 'undo' }));
    say('redo', () => ({ do: 'redo' }));
    say('save', () => ({ do: 'difference' }));
    say('save-now', () => ({ do: 'save' }));
    say('advise', () => ({ do: 'advise' }));
    say('place-cameras', () => ({ do: 'place' }));
    say('stop-search', () => ({ do: 'stop' }));
    say('write', () => ({ do: 'program', file: byId('program').value.trim() }));
    for (const id of ['save-now', 'save-not']) byId(id).addEventListener('click', () => byId('difference').close());
    const ask = () => this.tell({ do: 'task', text: byId('task').value.trim(), by: byId('by').value });
    byId('task').addEventListener('change', ask);
    byId('by').addEventListener('change', ask);
    byId('what').addEventListener('change', () => this.take(...JSON.parse(byId('what').value)));
    for (const [id, words] of Object.entries(HELP)) attachTip(byId(id), () => words);
    document.addEventListener('keydown', (event) => this.shortcut(event));
  }

  shortcut(event) {
    if (event.key === 'Escape') {
      const before = this.gizmo?.cancel();
      if (before) this.letGo(before);
      return;
    }
    if (!(event.ctrlKey || event.metaKey) || event.target.matches('input')) return;
    const act = { z: event.shiftKey ? 'redo' : 'undo', y: 'redo', s: 'difference' }[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    this.tell({ do: act });
  }

  take(kind, name) {
    this.taken = [kind, name];
    const move = this.state?.handles[kind]?.[name];
    if (!move) return;
    byId('what').value = JSON.stringify([kind, name]);
    this.fields.show(move);
    this.gizmo?.choose({ move, frame: this.frameOf(kind, name) });
    this.scene?.draw();
  }

  frameOf(kind, name) {
    const frame = kind === 'camera' ? this.state.handles.frames[name] : 'world';
    return this.scene.nodes.get(frame) ?? this.scene.world;
  }

  cameraClicked(name) {
    this.take('camera', name);
  }

  // A hand moves something: shown at once, sketched as fast as the server can.
  hold(move, since = performance.now()) {
    this.grasp(move);
    this.moveTo(move, TOGETHER);
    this.fields.show(move);
    if (this.asked > this.answered) {
      this.waiting = [move, since];
      return;
    }
    this.since = since;
    this.waiting = null;
    this.tell({ do: 'hold', move, number: ++this.asked });
  }

  // move: what a hand holds; null for nothing.
  grasp(move) {
    this.held = move;
    document.body.classList.toggle('held', move !== null);
    if (this.scene) this.scene.held = move !== null;
    if (!move) {
      this.waiting = null;
      this.answered = this.asked;
      this.sketchShown = false;
    }
    this.age();
  }

  // Dim what is not of the cell as it is, and say what is being computed.
  age() {
    const old = Boolean(this.held) || this.state?.number !== this.ranked;
    document.body.classList.toggle('old', old);
    document.body.classList.toggle('old-figures', old && !this.sketchShown);
    document.body.classList.toggle('old-time', old ? !this.sketchShown : !this.detailShown);
    byId('offers').classList.toggle('old', this.offered !== this.state?.number); // found before the cell was changed
    const of = this.entries[this.selected]?.name;
    const doing = this.held
      ? 'What is marked ≈ is of where the hand is; the ranking follows when it rests.'
      : old
        ? `Ranking ${this.state?.task ?? ''} …${this.progress}`
        : this.detailShown
          ? ''
          : `Looking at ${of} over time …`;
    byId('now').textContent = doing;
  }

  // Nothing is moved after all.
  letGo(before) {
    this.grasp(null);
    this.moveTo(before);
    this.fields.show(before);
    this.tell({ do: 'rest' });
  }

  put(move) {
    this.grasp(null);
    this.moveTo(move);
    this.tell({ do: 'put', move });
  }

  // Show something elsewhere; patience: see `draw`.
  moveTo(move, patience = 0) {
    if (!this.scene) return;
    const { kind, name, position, look_at: point, yaw } = move;
    if (kind === 'camera') {
      const camera = this.scene.cameras.find((one) => one.name === name);
      if (!camera) return;
      const pose = lookingAt(position, point, this.state.handles.ups[name]);
      if (!pose || !(move.fov > 0 && move.fov < Math.PI)) return; // the server says so
      camera.node.matrix.copy(pose);
      const { K, width } = camera.camera,
        scale = width / 2 / Math.tan(move.fov / 2) / K[0][0];
      K[0][0] *= scale;
      K[1][1] *= scale;
      camera.shapeFrustum();
    } else if (kind === 'object') {
      const node = this.scene.nodes.get(name);
      node.matrix.copy(turnedTo(node.matrix, yaw, position));
    } else moveBase(this.scene, turnedTo(this.scene.base, yaw, position));
    this.scene.world.updateMatrixWorld(true);
    if (kind !== 'camera') this.scene.renderer.shadowMap.needsUpdate = true;
    this.scene.draw(patience);
  }

  // What the server says

  hear(message) {
    this[`on_${message.do.replaceAll('-', '_')}`]?.(message);
  }

  on_cell(cell) {
    this.overview.scenes[0] = cell.scene;
    const same = Object.keys(cell.scene.cameras).join('\n') === this.scene?.cameras.map(({ name }) => name).join('\n');
    if (cell.model === null && same) {
      this.refresh(cell.scene);
      if (this.motion) this.scene?.load(this.motion);
    } else {
      this.model = cell.model ?? this.model;
      this.enterCell({ ...cell, model: this.model });
    }
    this.seek(this.time);
  }

  // Put everything where the text says that it is.
  refresh(scene) {
    this.scene.scene = scene;
    for (const camera of this.scene.cameras) {
      camera.camera = scene.cameras[camera.name];
      camera.node.matrix.copy(matrix(camera.camera.pose));
      camera.shapeFrustum();
    }
    moveBase(this.scene, matrix(scene.robot.base));
    for (const [name, { pose }] of Object.entries(scene.objects)) if (pose) this.scene.nodes.get(name).matrix.copy(matrix(pose));
    this.scene.draw();
  }

  enterCell({ scene, model }) {
    if (this.gizmo?.cancel()) {
      // What a hand holds is drawn anew, without the hand.
      this.grasp(null);
      this.tell({ do: 'rest' });
    }
    const view = this.scene && { orbit: this.scene.orbit, through: this.scene.through };
    this.enter(0, model);
    if (this.motion && !fits(this.motion, scene)) this.motion = null; // until the new one is there
    if (!this.scene) return;
    if (this.motion) this.scene.load(this.motion);
    else this.rest(scene);
    if (view) {
      const { target, distance, azimuth, elevation } = view.orbit;
      Object.assign(this.scene.orbit, { target, distance, azimuth, elevation });
      this.scene.orbit.update();
      if (view.through && view.through in scene.cameras) this.look(view.through);
    }
    this.scene.base = matrix(scene.robot.base);
    this.gizmo = new Gizmo(this.scene, {
      held: (move, since) => this.hold(move, since),
      put: (move) => this.put(move),
      taken: (kind, name) => this.take(kind, name),
    });
    this.scene.gizmo = this.gizmo;
    if (this.taken && this.state) this.take(...this.taken);
  }

  // The robot at home, until there is a motion to show.
  rest(scene) {
    const objects = Object.fromEntries(
      Object.entries(scene.objects).filter(([, one]) => one.pose).map(([name, one]) => [name, one.pose]),
    );
    const at = (t) => ({ t, q: scene.robot.home, objects, held: null, covered: null, literals: {} });
    const detail = { samples: [at(0), at(1)], time: 1, primitives: [], formulas: [], targets: {}, still: {}, cameras: {} };
    const motion = new Motion(detail);
    this.scene.load(motion);
    this.scene.seek(0);
  }

  on_state(state) {
    if (this.refusal && state.number !== this.state?.number) this.notice([], 'told'); // something else was done meanwhile
    this.state = state;
    byId('title').replaceChildren(named(state.workspace));
    if (document.activeElement !== byId('task')) byId('task').value = state.task;
    byId('by').value = state.by;
    byId('tasks').replaceChildren(...[...new Set([...state.tasks, ...state.skills])].map((text) => make('option', { value: text })));
    byId('undo').disabled = state.undo === null;
    byId('undo').title = state.undo ?? '';
    byId('redo').disabled = state.redo === null;
    byId('redo').title = state.redo ?? '';
    byId('motion').hidden = !state.parameters.length;
    byId('save').disabled = !state.dirty;
    byId('write').disabled = state.dirty;
    byId('unsaved').textContent = state.dirty ? `${state.unsaved.length} unsaved change${state.unsaved.length === 1 ? '' : 's'}` : 'as it is saved';
    byId('commands').hidden = !state.lines.length;
    byId('lines').replaceChildren(
      ...state.lines.map(({ what, line }) => make('li', {}, make('span', { class: 'faint' }, named(what)), make('code', {}, named(line)))).reverse(),
    );
    const kinds = ['camera', 'object', 'base'].flatMap((kind) => Object.keys(state.handles[kind]).map((name) => [kind, name]));
    byId('what').replaceChildren(
      ...kinds.map(([kind, name]) => make('option', { value: JSON.stringify([kind, name]) }, name || "the robot's base")),
    );
    rebuilt('parameters', () => this.parameters(state));
    this.take(...(kinds.find(([kind, name]) => kind === this.taken?.[0] && name === this.taken?.[1]) ?? kinds[0]));
    this.age();
  }

  // The motion parameters of the task's skill: choosing a value changes the words of the task. First stands what the
  // skill says, which holds as long as the task does not say it.
  parameters({ parameters, task }) {
    const words = task.split(/\s+/);
    byId('parameters').replaceChildren(
      ...parameters.map(({ name, values, words: possible }) => {
        const stated = words.find((word) => word.startsWith(`${name}=`))?.slice(name.length + 1) ?? '';
        const set = (value) => {
          const rest = words.filter((word) => !word.startsWith(`${name}=`));
          byId('task').value = [...rest, ...(value ? [`${name}=${value}`] : [])].join(' ');
          byId('task').dispatchEvent(new Event('change'));
        };
        const own = values.join(','),
          others = [...values, ...possible].filter((value) => value !== own);
        const options = [...new Set(['', ...others, stated])];
        const chosen = make('select', { 'aria-label': name, onchange: (event) => set(event.target.value) },
          ...options.map((value) => make('option', { value, selected: value === stated }, value || own)),
        );
        return make('label', {}, named(name), ' ', chosen);
      }),
    );
  }

  on_ranking({ entries, summary, number }) {
    this.ranked = number;
    this.progress = '';
    this.detailShown = false;
    if (this.wrong) this.notice([], 'told');
    byId('summary').replaceChildren(prose(summary));
    this.entries = this.overview.entries = entries;
    for (const entry of entries) entry.was = this.saved.get(entry.name);
    this.tabulate();
    const chosen = entries.findIndex(({ name }) => name === this.state.chosen);
    this.select(Math.max(0, chosen));
    this.age();
  }

  on_saved_ranking({ entries }) {
    this.saved = new Map(entries.map(({ name, candidate }) => [name, candidate]));
    for (const entry of this.entries) entry.was = this.saved.get(entry.name);
    if (this.entries[0] !== NOBODY) this.tabulate();
  }

  tabulate() {
    const sorting = this.table.sorting;
    rebuilt('ranking', () => {
      this.table = new NarrowTable(this.entries, (i) => this.wish(i), false);
      if (sorting.column < this.table.columns.length) Object.assign(this.table, { sorting });
      this.table.show();
      this.table.choose(this.selected ?? 0);
    });
  }

  // Whether all that is shown is computed from the text as it is.
  get settled() {
    return this.state?.number === this.ranked && this.answered === this.asked && !this.held;
  }

  on_progress({ done, of }) {
    this.progress = ` ${done} of ${of}`;
    this.age();
  }

  // A row was clicked: every browser follows.
  wish(i) {
    this.detailShown = false;
    this.tell({ do: 'choose', name: this.entries[i].name });
  }

  select(i) {
    this.selected = i;
    this.table.choose(i);
    const entry = this.entries[i];
    byId('name').textContent = entry.name;
    byId('place').textContent = placeOf(entry);
    byId('verdict').replaceChildren(prose(toldOf(entry)));
    byId('reasons').replaceChildren(...entry.reasons.map((reason) => make('li', {}, prose(reason))));
    this.figures(entry);
    this.age();
    return Promise.resolve();
  }

  on_detail({ name, detail }) {
    const index = this.entries.findIndex((entry) => entry.name === name);
    if (index < 0) return;
    if (index !== this.selected) this.select(index);
    this.detailShown = true;
    this.age();
    byId('study').classList.toggle('infeasible', detail === null);
    if (detail === null) return;
    this.show(new Motion(detail));
    this.shownName = name;
    document.documentElement.dataset.ready = 'true';
  }

  // Show a motion, at the time that is shown now.
  show(motion) {
    this.motion = motion;
    this.steps(motion.detail.played ?? []);
    this.moments(motion.detail);
    this.drawTimeline();
    byId('time').max = motion.time;
    this.scene?.load(motion);
    this.seek(Math.min(this.time, motion.time));
  }

  drawTimeline() {
    const cameras = Object.keys(this.motion.detail.cameras);
    rebuilt('timeline', () => {
      this.timeline = new Timeline(
        this.motion,
        cameras,
        (t) => this.go(t),
        (name) => this.look(name),
      );
    });
  }

  on_sketch({ number, seen, was, track, reasons }) {
    if (number === this.asked) this.answered = number;
    if (reasons) byId('verdict').replaceChildren(prose(reasons[0]));
    else if (seen && this.motion) this.sketch(seen, was, track);
    if (this.since !== undefined) {
      this.latencies.push(performance.now() - this.since);
      if (this.latencies.length > 1000) this.latencies.shift();
      this.since = undefined;
    }
    if (this.waiting) this.hold(...this.waiting);
  }

  on_held({ number }) {
    if (number === this.asked) this.answered = number;
    if (this.waiting) this.hold(...this.waiting);
  }

  // What the chosen candidate would be: verdicts at fixed times, the motion as it was unless a new one is there.
  sketch(seen, was, track) {
    const { places, placeTimes, detail } = this.motion,
      motion = new Motion({ ...detail, samples: decoded(seen), time: track ? track.t.at(-1) : detail.time });
    motion.places = track ? unroll(track) : places;
    motion.placeTimes = track ? track.t : placeTimes;
    if (track) motion.detail.still = {};
    this.motion = motion;
    this.drawTimeline();
    if (track) this.scene?.load(motion);
    else if (this.scene) this.scene.motion = motion;
    if (track || !this.scene) this.seek(Math.min(this.time, motion.time));
    else this.recolour();
    this.sketched(seen, was);
    this.sketchShown = Boolean(this.held);
    this.age();
  }

  // Nothing has moved but a camera, so that no shadow has to be drawn anew.
  recolour() {
    const sample = this.motion.at(this.time);
    this.timeline.show(this.time, sample);
    this.scene.sample = sample;
    this.scene.colour();
    this.scene.draw();
  }

  // was: the figures before it was taken in hand, looked at as coarsely.
  sketched({ q_eoi: qEoi, q_avg: qAvg, blind }, was) {
    const rows = [
      ['≈ critical time seen', percent(qEoi), changeOf(qEoi, was.q_eoi, 100, 1, BEFORE)],
      ['≈ time seen', percent(qAvg), changeOf(qAvg, was.q_avg, 100, 1, BEFORE)],
      ['≈ not all seen for', seconds(blind), null],
    ];
    byId('figures').replaceChildren(
      ...rows.map(([term, value, change]) => make('div', { class: 'coarse' }, make('dt', {}, term), make('dd', {}, value, ...(change ? [change] : [])))),
    );
  }

  // Another browser moves something.
  on_move({ move }) {
    if (this.held || this.gizmo?.drag) return;
    this.moveTo(move);
  }

  on_difference({ patch, line }) {
    byId('patch').replaceChildren(...patch.map((text) => make('span', { class: { '+': 'added', '-': 'removed' }[text[0]] ?? 'faint' }, `${text}\n`)));
    byId('difference-line').textContent = line || '–';
    byId('difference').showModal();
  }

  on_refused({ problems }) {
    this.notice(problems.map((one) => one.message), 'refused');
    this.refusal = true;
    if (!this.state || !this.taken) return;
    this.take(...this.taken);
    const [kind, name] = this.taken,
      move = this.state.handles[kind]?.[name];
    if (move && !this.gizmo?.drag) this.moveTo(move);
  }

  // What takes longer

  on_searching({ text }) {
    byId('searching').replaceChildren(prose(text));
    byId('stop-search').hidden = false;
  }

  on_offers({ title, changes, unwritten }) {
    const told = ({ q_eoi: qEoi, q_avg: qAvg, worse }) =>
      [
        absent(qEoi) ? '' : `critical time seen ${percent(qEoi)}`,
        absent(qAvg) ? '' : `time seen ${percent(qAvg)}`,
        worse.length ? `worse: ${worse.join(', ')}` : '',
      ].filter(Boolean);
    const apply = (i) => this.tell({ do: 'apply', number: i + 1 });
    const offer = (change, i) =>
      make(
        'li',
        {},
        make('span', {}, prose(change.words)),
        make('span', { class: 'faint' }, prose(told(change).join(', '))),
        make('button', { type: 'button', onclick: () => apply(i) }, 'Apply'),
      );
    const others = unwritten.map((words) => make('li', { class: 'faint' }, prose(words)));
    const heading = make('p', {}, prose(title));
    this.offered = this.state.number;
    byId('offers').replaceChildren(heading, make('ol', {}, ...changes.map(offer), ...others));
    this.age();
  }

  on_written({ file }) {
    this.notice([`${file} holds the program now; Run plays it.`], 'told');
  }

  on_job_ended() {
    byId('searching').replaceChildren();
    byId('stop-search').hidden = true;
    if (!this.runs.going) return;
    this.runs.catchUp();
    this.runs.over();
    if (this.motion) this.show(this.motion);
  }

  on_run_began(message) {
    this.pause();
    this.runs.began(message);
  }

  on_run_image(message) {
    this.runs.soon(`image of ${message.camera}`, () => this.runs.image(message));
  }

  on_run_doing(message) {
    this.runs.doing(message);
  }

  on_run_evidence(message) {
    this.runs.soon('evidence', () => this.runs.evidence(message));
  }

  on_run_event(message) {
    this.runs.event(message);
  }

  on_run_state(message) {
    this.runs.soon('state', () => this.runs.state(message));
  }

  on_run_fault({ faults }) {
    byId('faults-wanted').value = faults.join(' ');
  }

  on_run_ended(message) {
    this.runs.ended(message);
  }

  on_problems({ problems }) {
    this.notice(problems.map(placed), 'refused');
    this.wrong = true;
  }

  on_outside({ problems, lost, taken }) {
    const told = problems.map(placed);
    if (told.length) told.unshift('The file was changed elsewhere and cannot be read; the last good state stays.');
    else if (taken) told.push('The file was changed elsewhere; this is its new state.');
    for (const one of lost ?? []) told.push(`This unsaved change does not fit any more: ${one}`);
    this.notice(told, problems.length ? 'refused' : 'told');
  }

  notice(texts, kind) {
    this.wrong = this.refusal = false;
    byId('notices').replaceChildren(...texts.map((text) => make('p', { class: kind }, prose(text))));
  }
}

// Build a part of the page anew; who is there with the keyboard stays at what has the same name, or the same place.
function rebuilt(id, build) {
  const before = document.activeElement;
  if (!byId(id).contains(before)) return build();
  const stops = () => [...byId(id).querySelectorAll('button, select, .run')],
    place = stops().indexOf(before);
  build();
  const name = before.getAttribute('aria-label') ?? before.textContent,
    now = stops();
  const same = now.find((stop) => (stop.getAttribute('aria-label') ?? stop.textContent) === name);
  (same ?? now[Math.min(place, now.length - 1)])?.focus({ preventScroll: true });
}

const placed = ({ file, line, message }) => (file ? `${file}${line ? `:${line}` : ''}: ${message}` : message);

// Whether a motion is one of a cell with these objects and cameras.
function fits({ detail, places }, scene) {
  const shown = Object.keys({ ...detail.still, ...places[0].objects });
  return shown.every((name) => name in scene.objects) && Object.keys(scene.cameras).every((name) => name in detail.cameras);
}

// Verdicts as the server packs them: each different one once.
function decoded({ t, covered, verdicts, atoms }) {
  return t.map((time, i) => {
    const literals = {};
    for (const [atom, shown] of Object.entries(atoms))
      if (shown.covered[i] !== null)
        literals[atom] = {
          boxes: [],
          covered: shown.covered[i],
          cameras: Object.fromEntries(Object.entries(shown.cameras).map(([name, of]) => [name, verdicts[of[i]]])),
        };
    return { t: time, covered: covered[i], literals };
  });
}

// Put the robot elsewhere; `base` of the scene is where it was built.
function moveBase(scene, pose) {
  const move = pose.clone().multiply(scene.base.clone().invert());
  for (const joint of scene.joints.filter(({ parent }) => parent < 0)) {
    joint.built ??= joint.still;
    joint.still = move.clone().multiply(joint.built);
    joint.node.matrix.copy(joint.still);
  }
  for (const [name, link] of Object.entries(scene.links).filter(([, { joint }]) => joint < 0))
    scene.nodes.get(name).matrix.copy(move.clone().multiply(matrix(link.pose)));
}

// A pose with another angle about the vertical axis, elsewhere.
function turnedTo(from, yaw, position) {
  const [place, turn, scale] = [new THREE.Vector3(), new THREE.Quaternion(), new THREE.Vector3()];
  from.decompose(place, turn, scale);
  const now = new THREE.Euler().setFromQuaternion(turn, 'ZYX').z;
  const more = new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(0, 0, 1), yaw - now);
  return new THREE.Matrix4().compose(new THREE.Vector3(...position), more.multiply(turn), scale);
}

function connect() {
  const socket = new WebSocket(`ws://${location.host}${location.pathname}live`);
  let studio = null;
  const early = [];
  socket.onmessage = ({ data }) => {
    const message = JSON.parse(data);
    if (!studio && message.do === 'cell') {
      studio = window.sqrp = new Studio(message, (request) => socket.send(JSON.stringify(request)));
      for (const one of early.splice(0)) studio.hear(one);
      document.documentElement.dataset.drawn = 'true';
    } else if (studio) studio.hear(message);
    else early.push(message);
  };
  socket.onclose = () => {
    document.body.classList.add('closed');
    byId('notices').replaceChildren(make('p', { class: 'refused' }, 'The studio was closed; start it again with `sqrp studio`.'));
  };
}

connect();
