// The page: one candidate and one time are chosen; table, plot, timeline, list and scene all show them.

class Page {
  constructor(overview) {
    this.overview = overview;
    this.entries = overview.entries;
    this.details = new Map();
    this.cell = null;
    this.time = overview.opens_at;
    this.head();
    const select = (i) => this.select(i);
    this.table = new EntryTable(this.entries, select, overview.placement !== null);
    if (overview.of_images) explained.clear(); // a run has no table
    this.plot = new ParetoPlot(this.entries, select, overview.compared);
    this.controls();
  }

  head() {
    byId('title').replaceChildren(named(this.overview.title));
    byId('summary').replaceChildren(prose(this.overview.summary));
    byId('ranking-title').textContent = this.overview.heading;
    for (const [term, value] of this.overview.about)
      byId('about').append(make('dt', {}, named(term)), make('dd', {}, term === 'command' ? named(value) : prose(value)));
    const compared = this.entries.some((e) => e.candidate || e.reasons.length);
    document.querySelector('.overview').hidden = this.overview.of_images || !compared;
    document.body.classList.toggle('ran', this.overview.of_images);
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
        (name) => this.cameraClicked(name),
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
    slider.addEventListener('input', () => this.go(slider.valueAsNumber));
    slider.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: -0.1, ArrowDown: -0.1, ArrowRight: 0.1, ArrowUp: 0.1, PageUp: 1, PageDown: -1 }[
        event.key
      ];
      if (!step) return;
      event.preventDefault();
      this.go(this.time + step);
    });
    byId('play').addEventListener('click', () => (this.playing ? this.pause() : this.play()));
    for (const id of ['show-boxes', 'show-lines', 'show-frusta', 'show-mounts'])
      byId(id).addEventListener('change', () => this.seek(this.time));
    attachTip(byId('view'), (x, y) => this.scene?.mounts.at(x, y)); // once: the scenes in it come and go
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
      { reasons, name } = entry,
      told = toldOf(entry);
    byId('name').textContent = name;
    byId('place').textContent = placeOf(entry);
    byId('verdict').replaceChildren(prose(told));
    byId('reasons').replaceChildren(...reasons.map((reason) => make('li', {}, prose(reason))));
    byId('study').hidden = !entry.moves;
    byId('spoken').textContent = `${name}: ${spoken([...(told ? [told] : []), ...reasons].join('; '))}`;
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
    const { cameras } = this.motion.detail;
    this.timeline = new Timeline(
      this.motion,
      Object.keys(cameras),
      (t) => this.go(t),
      (name) => this.look(name),
    );
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

  // Show in the table when of each entry all is seen.
  async lanes() {
    for (const [i, { moves }] of this.entries.entries()) {
      if (!moves) continue;
      const known = this.details.get(i) ?? unpack(`detail-${i}`).then((detail) => new Motion(detail));
      this.table.fill(i, await known);
    }
  }

  // The figures of an entry, and those of each fault, the worst first.
  figures({ candidate, figures, retried }) {
    const rows = figures.map(([name, value, meaning]) => [meaning ? term(meaning, named(name)) : named(name), value]);
    const faults = byWorst(candidate?.faults ?? {});
    if (candidate) {
      const { q_eoi: qEoi, q_avg: qAvg, time } = candidate;
      rows.push([term('critical time seen'), percent(qEoi)], [term('time seen'), percent(qAvg)], [term('time'), seconds(time)]);
    }
    byId('figures').replaceChildren(
      ...rows.map(([name, value]) => make('div', {}, make('dt', {}, name), make('dd', {}, value))),
    );
    byId('faults').hidden = !faults.length;
    if (!faults.length) return;
    const again = faults.some(([name]) => retried.includes(name));
    const heads = [term('fault'), term('noticed after'), term('at the latest'), term('longest time unseen')];
    if (again) heads.push(term('done after a retry'));
    const cells = ([name, fault]) => [
      prose(candidate.happens[name] ?? name),
      ...[fault.delay_mean, fault.delay_worst, fault.blind_longest].map((t) => stated(t ?? Infinity, seconds(t ?? Infinity))),
      ...(again ? [retried.includes(name) ? seconds(fault.expected_time ?? Infinity, 1) : '–'] : []),
    ];
    const row = (kind, texts) =>
      make('tr', {}, ...texts.map((text, i) => make(kind, { class: i ? 'number' : null }, text)));
    byId('faults').replaceChildren(row('th', heads), ...faults.map((fault) => row('td', cells(fault))));
  }

  // The steps of a task of several, each with its figures, and which of them is seen worst.
  steps(played) {
    byId('steps').hidden = !played.length;
    document.querySelector('.steps').replaceChildren(
      ...played.map(({ name, start, end, q_eoi: qEoi, q_avg: qAvg, verdict, seen_worst: worst }) => {
        const go = () => this.go(start);
        return make(
          'li',
          { class: worst ? 'worst' : null },
          make('button', { type: 'button', onclick: go, 'aria-label': `Go to step ${name}` }, named(name)),
          make('span', {}, `critical time seen ${percent(qEoi)}, time seen ${percent(qAvg)}, takes ${seconds(end - start)}`),
          ...(worst ? [make('b', {}, 'seen worst')] : []),
          make('span', { class: 'faint' }, prose(verdict)),
        );
      }),
    );
  }

  // Times of a run to go to, and what is shown of it.
  moments({ moments = [], note = '' }) {
    byId('note').replaceChildren(...(note ? [prose(note)] : []));
    this.moment = moments.map(({ t, text }) => [
      t,
      make('button', { type: 'button', onclick: () => this.go(t) }, make('b', {}, seconds(t)), ' ', prose(text)),
    ]);
    byId('moments').replaceChildren(...this.moment.map(([, button]) => button));
  }

  // Stop there.
  go(t) {
    this.pause();
    this.seek(t);
  }

  seek(t) {
    if (!this.motion) return;
    this.time = Math.max(0, Math.min(t, this.motion.time));
    const text = seconds(this.time),
      primitive = this.motion.detail.primitives.filter((p) => p.start <= this.time + 1e-9).pop();
    byId('time').value = this.time;
    byId('time').setAttribute('aria-valuetext', `${text}, ${primitive ? doing(primitive) : ''}`);
    byId('clock').textContent = text;
    this.timeline.show(this.time, this.motion.at(this.time));
    this.moment.forEach(([at, button]) => button.setAttribute('aria-pressed', String(Math.abs(at - this.time) < 1e-6)));
    if (!this.scene || this.entries[this.selected].scene === null) return;
    this.scene.seek(this.time);
    const tool = this.scene.toolPosition().map((x) => fixed(x, 3));
    const held = this.motion.detail.track && this.scene.place.held;
    byId('tool').replaceChildren(`tool at ${tool.join(', ')} m`, ...(held ? [', holds ', named(held)] : []));
    const hiding = [...this.scene.culprits];
    byId('hiding').replaceChildren(...(hiding.length ? ['red, in the way: ', named(hiding.join(', '))] : []));
    const eye = this.scene.through ? `as ${this.scene.through} sees it` : 'from outside';
    const state = sentence(this.motion, this.motion.at(this.time));
    byId('view').setAttribute('aria-label', `The cell at ${text}, ${eye}. ${state}`);
  }

  // The name of a camera was clicked in the picture.
  cameraClicked(name) {
    this.look(name);
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

function sentence(motion, sample) {
  const parts = Object.entries(sample.literals).map(
    ([literal, state]) => `${motion.words(atomOf(literal))}: ${KINDS[stateOf(state)][2]}`,
  );
  return parts.length ? `${[...new Set(parts)].join('; ')}.` : 'Nothing has to be seen.';
}
