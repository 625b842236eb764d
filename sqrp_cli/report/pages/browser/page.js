// The page: one candidate and one time are chosen; table, plot, timeline, list and scene all show them.

// Words of the legend where one entry stands for several kinds, or kinds share their words.
const LEGEND = {
  too_far: 'too far or near',
  oblique: 'too flat an angle, or too small',
  nothing: 'no image of this camera shows it',
};

class Page {
  constructor(overview) {
    this.overview = overview;
    this.entries = overview.entries;
    this.details = new Map();
    this.cell = null;
    this.time = 0;
    this.head();
    const select = (i) => this.select(i);
    this.table = new EntryTable(this.entries, select, overview.placement !== null);
    this.plot = new ParetoPlot(this.entries, select);
    this.controls();
    this.legend();
  }

  head() {
    byId('title').replaceChildren(named(this.overview.title));
    byId('summary').replaceChildren(named(this.overview.summary));
    byId('ranking-title').textContent = this.overview.heading;
    for (const [term, value] of this.overview.about)
      byId('about').append(make('dt', {}, named(term)), make('dd', {}, named(value)));
    const compared = this.entries.some((e) => e.candidate || e.reasons.length);
    document.querySelector('.overview').hidden = this.overview.of_images || !compared;
    const some = (test) => this.entries.some((e) => e.candidate && test(e.candidate));
    byId('pareto-only').parentElement.hidden = !some((c) => c.pareto);
    byId('feasible-only').parentElement.hidden = !some((c) => !c.feasible);
    const { placement } = this.overview;
    document.body.classList.toggle('placing', placement !== null);
    if (placement) showPlacement(placement, (name) => this.look(name));
    else byId('placement').remove();
  }

  // Show another cell.
  enter(index, model) {
    const cell = this.overview.scenes[index];
    this.cell = index;
    this.scene?.close();
    this.scene = null;
    byId('view').replaceChildren(make('div', { id: 'labels' }));
    try {
      this.scene = new Scene3D(
        model,
        cell,
        byId('view'),
        (name) => this.look(name),
        this.overview.placement?.mounts ?? [],
      );
    } catch (error) {
      byId('view').replaceChildren(
        make('p', { class: 'missing' }, `This browser cannot draw in three dimensions: ${error.message}`),
      );
    }
    this.viewNames = [null, ...Object.keys(cell.cameras)];
    this.views = this.viewNames.map((name) =>
      make(
        'button',
        { type: 'button', 'aria-pressed': String(name === null), onclick: () => this.look(name) },
        name === null ? 'look around' : named(name),
      ),
    );
    byId('views').replaceChildren(...this.views);
  }

  controls() {
    const slider = byId('time');
    slider.addEventListener('input', () => {
      this.pause();
      this.seek(slider.valueAsNumber);
    });
    slider.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: -0.1, ArrowDown: -0.1, ArrowRight: 0.1, ArrowUp: 0.1, PageUp: 1, PageDown: -1 }[
        event.key
      ];
      if (!step) return;
      event.preventDefault();
      this.pause();
      this.seek(this.time + step);
    });
    byId('play').addEventListener('click', () => (this.playing ? this.pause() : this.play()));
    for (const id of ['show-boxes', 'show-lines', 'show-frusta', 'show-mounts'])
      byId(id).addEventListener('change', () => this.seek(this.time));
    const follow = byId('follow');
    follow.parentElement.hidden = !this.overview.of_images;
    follow.addEventListener('change', () => {
      this.scene?.follow(follow.checked);
      this.seek(this.time);
    });
    byId('theme').addEventListener('click', () =>
      this.dress(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark'),
    );
    const dark = matchMedia('(prefers-color-scheme: dark)');
    dark.addEventListener('change', () => this.dress(dark.matches ? 'dark' : 'light'));
    this.dress(dark.matches ? 'dark' : 'light');
  }

  legend() {
    const predicted = ['covered', 'hidden', 'same_colour', 'out_of_image', 'too_far', 'oblique'];
    const ofImages = ['shown_true', 'shown_false', 'unseen', 'nothing'];
    const shown = (this.overview.of_images ? ofImages : predicted).map((kind) => {
      const [style, sign] = KINDS[kind],
        words = LEGEND[kind] ?? KINDS[kind][2];
      return make('span', {}, make('i', { class: `spot ${style}` }), `${words}${sign ? ` (${sign})` : ''}`);
    });
    byId('legend').append(...shown, make('span', {}, 'empty: no formula asks'));
  }

  dress(theme) {
    document.documentElement.dataset.theme = theme;
    if (this.motion && this.scene) {
      this.scene.colour();
      this.scene.draw();
    }
  }

  // Show an entry once it is decoded, unless another one has been selected by then.
  async select(i) {
    this.pause();
    const turn = (this.turn = {});
    this.selected = i;
    this.table.choose(i);
    this.plot.choose(i);
    const entry = this.entries[i],
      { candidate, reasons, name } = entry,
      verdict = candidate?.verdict || '';
    byId('name').textContent = name;
    byId('place').textContent = placeOf(entry);
    byId('verdict').replaceChildren(entry.moves ? named(verdict) : '');
    byId('reasons').replaceChildren(...reasons.map((reason) => make('li', {}, named(reason))));
    byId('study').hidden = !entry.moves;
    byId('spoken').textContent = `${name}: ${[...(entry.moves ? [verdict] : []), ...reasons].join('; ')}`;
    this.motion = null;
    if (!entry.moves) return;
    byId('study').classList.toggle('flat', entry.scene === null);
    const enters = entry.scene !== null && entry.scene !== this.cell;
    const [motion, model] = await Promise.all([this.detail(i), enters ? unpack(`model-${entry.scene}`) : null]);
    if (this.turn !== turn) return;
    if (enters) this.enter(entry.scene, model);
    this.motion = motion;
    this.figures(entry);
    this.steps(this.motion.detail.played ?? []);
    this.moments(this.motion.detail);
    this.timeline = new Timeline(this.motion, Object.keys(this.motion.detail.cameras), (t) => {
      this.pause();
      this.seek(t);
    });
    byId('time').max = this.motion.time;
    this.scene?.load(this.motion);
    this.seek(Math.min(this.time, this.motion.time));
  }

  // The motion of an entry, decoded once.
  detail(i) {
    if (!this.details.has(i))
      this.details.set(
        i,
        unpack(`detail-${i}`).then((detail) => new Motion(detail)),
      );
    return this.details.get(i);
  }

  // Show in the table when each entry is covered.
  async lanes() {
    for (const [i, { moves }] of this.entries.entries()) {
      if (!moves) continue;
      const known = this.details.get(i) ?? unpack(`detail-${i}`).then((detail) => new Motion(detail));
      this.table.fill(i, await known);
    }
  }

  figures({ candidate, figures, retried }) {
    const rows = [...figures];
    if (candidate) {
      const { q_eoi: qEoi, q_avg: qAvg, time, faults } = candidate;
      rows.push(['Q_eoi', percent(qEoi)], ['Q_avg', percent(qAvg)], ['time', seconds(time)]);
      for (const [name, fault] of Object.entries(faults))
        rows.push(
          [`${name}: noticed after`, seconds(fault.delay_mean)],
          ['at worst', seconds(fault.delay_worst)],
          ['longest blind stretch', seconds(fault.blind_longest)],
          ...(retried.includes(name) ? [['done after one retry', seconds(fault.expected_time, 1)]] : []),
        );
    }
    byId('figures').replaceChildren(
      ...rows.map(([term, value]) => make('div', {}, make('dt', {}, named(term)), make('dd', {}, value))),
    );
  }

  // The steps of a task of several, each with its figures, and which of them is seen worst.
  steps(played) {
    byId('steps').hidden = !played.length;
    if (played.length) byId('verdict').replaceChildren();
    document.querySelector('.steps').replaceChildren(
      ...played.map(({ name, start, end, q_eoi: qEoi, q_avg: qAvg, verdict, seen_worst: worst }) => {
        const go = () => {
          this.pause();
          this.seek(start);
        };
        return make(
          'li',
          { class: worst ? 'worst' : null },
          make('button', { type: 'button', onclick: go, 'aria-label': `Go to step ${name}` }, named(name)),
          make('span', {}, `Q_eoi ${percent(qEoi)}, Q_avg ${percent(qAvg)}, ${seconds(end - start)}`),
          ...(worst ? [make('b', {}, 'seen worst')] : []),
          make('span', { class: 'faint' }, named(verdict)),
        );
      }),
    );
  }

  // Times of a run to go to, and what is shown of it.
  moments({ moments = [], note = '' }) {
    byId('note').replaceChildren(...(note ? [named(note)] : []));
    byId('moments').replaceChildren(
      ...moments.map(({ t, text }) =>
        make(
          'button',
          {
            type: 'button',
            onclick: () => {
              this.pause();
              this.seek(t);
            },
          },
          make('b', {}, seconds(t)),
          ' ',
          named(text),
        ),
      ),
    );
  }

  seek(t) {
    if (!this.motion) return;
    this.time = Math.max(0, Math.min(t, this.motion.time));
    const text = seconds(this.time),
      primitive = this.motion.detail.primitives.filter((p) => p.start <= this.time + 1e-9).pop();
    byId('time').value = this.time;
    byId('time').setAttribute('aria-valuetext', `${text}, ${primitive?.name ?? ''}`);
    byId('clock').textContent = text;
    byId('now-time').textContent = `${text}, ${primitive?.name ?? ''}`;
    this.timeline.show(this.time);
    this.now(this.motion.at(this.time));
    if (!this.scene || this.entries[this.selected].scene === null) return;
    this.scene.seek(this.time);
    const tool = this.scene.toolPosition().map((x) => x.toFixed(3));
    const held = this.motion.detail.track && this.scene.place.held;
    byId('tool').replaceChildren(`tool at ${tool.join(', ')} m`, ...(held ? [', holds ', named(held)] : []));
    const eye = this.scene.through ? `as ${this.scene.through} sees it` : 'from outside';
    const state = sentence(this.motion.at(this.time));
    byId('view').setAttribute('aria-label', `The cell at ${text}, ${eye}. ${state}`);
  }

  // What every camera sees now, in words.
  now(sample) {
    const required = this.motion.atoms.map((atom) => [atom, found(sample, atom)]).filter(([, state]) => state);
    const literals = required.map(([atom, state]) =>
      make(
        'section',
        {},
        make(
          'h4',
          {},
          make('i', { class: `spot ${KINDS[stateOf(state)][0]}` }),
          named(atom),
          make('span', { class: 'faint' }, KINDS[stateOf(state)][2]),
        ),
        make(
          'ul',
          {},
          ...truthLine(state),
          ...Object.entries(state.cameras).map(([camera, verdict]) =>
            make(
              'li',
              {},
              make('i', { class: `spot ${KINDS[kindOf(verdict)][0]}` }),
              make(
                'button',
                { type: 'button', 'aria-label': `Look through ${camera}`, onclick: () => this.look(camera) },
                named(camera),
              ),
              make('span', {}, named(because(verdict))),
              ...sharesOf(state, camera).map((text) => make('span', { class: 'faint shares' }, named(text))),
            ),
          ),
        ),
      ),
    );
    byId('now').replaceChildren(
      ...(literals.length ? literals : [make('p', { class: 'faint' }, nothing(this.motion))]),
    );
  }

  look(name) {
    if (!this.scene) return;
    this.scene.look(name);
    this.views.forEach((button, i) => button.setAttribute('aria-pressed', String(this.viewNames[i] === name)));
    const camera = name && this.overview.scenes[this.cell].cameras[name];
    byId('spoken').textContent = name
      ? `Looking through ${name}${camera.D.some(Boolean) ? ', without its lens distortion' : ''}`
      : 'Looking from outside';
    this.seek(this.time);
  }

  play() {
    if (!this.motion) return;
    if (this.time >= this.motion.time) this.seek(0);
    const turn = (this.playing = {});
    byId('play').textContent = '❚❚';
    byId('play').setAttribute('aria-label', 'Pause');
    let last = null;
    const step = (now) => {
      if (this.playing !== turn) return;
      if (last !== null) this.seek(this.time + ((now - last) / 1000) * Number(byId('speed').value));
      last = now;
      if (this.time >= this.motion.time) this.pause();
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  pause() {
    this.playing = null;
    byId('play').textContent = '▶';
    byId('play').setAttribute('aria-label', 'Play');
  }
}

// The true value, if it is known from a simulation.
function truthLine(state) {
  const kind = truthOf(state);
  if (kind === null) return [];
  const parts = [make('i', { class: `spot ${KINDS[kind][0]}` }), make('em', {}, 'in truth'), KINDS[kind][2]];
  return [make('li', {}, ...parts)];
}

const nothing = ({ ofImages }) =>
  ofImages ? 'No image shows anything that a formula requires now.' : 'No formula requires anything now.';

function sentence(sample) {
  const parts = Object.entries(sample.literals).map(([literal, state]) =>
    state.kind
      ? `${atomOf(literal)}: ${KINDS[state.kind][2]}`
      : `${atomOf(literal)} is ${state.covered ? 'covered' : 'not covered'}`,
  );
  return parts.length ? `${[...new Set(parts)].join('; ')}.` : 'No formula requires anything.';
}
