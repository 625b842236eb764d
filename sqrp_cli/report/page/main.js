// The page: one candidate and one time are chosen; table, plot, timeline, list and scene all show them.

class Page {
  constructor(overview, model) {
    this.overview = overview;
    this.candidates = overview.ranking.candidates;
    this.names = candidateNames(this.candidates);
    this.details = new Map();
    this.time = 0;
    this.head();
    const select = (i) => this.select(i);
    this.table = new RankingTable(this.candidates, this.names, select);
    this.plot = new ParetoPlot(this.candidates, this.names, select);
    this.scene = this.openScene(model);
    this.controls();
    this.legend();
  }

  head() {
    const { ranking, title, about } = this.overview;
    byId('title').replaceChildren(named(title));
    const feasible = this.candidates.filter((c) => c.feasible);
    byId('summary').textContent = `${feasible.length} of ${this.candidates.length} candidates can be done` +
      (feasible.length ? `; best first by ${ranking.by}.` : '.');
    const { mode, error, max_gap: gap, ...how } = ranking.sampling;
    const sampling = `${mode} (${Object.entries(how).map(([key, value]) => `${key} ${value}`).join(', ')})` +
      (error === null ? '' : `; Q is within ${Math.max(100 * error, 0.001).toPrecision(2)} points`) +
      (gap === null ? '' : `, save for events shorter than ${gap.toPrecision(2)} s`);
    for (const [term, value] of [...about, ['sampling', sampling]]) byId('about').append(make('dt', {}, term), make('dd', {}, named(value)));
  }

  openScene(model) {
    try {
      return new Scene3D(model, this.overview.scene, byId('view'), (name) => this.look(name));
    } catch (error) {
      byId('view').replaceChildren(make('p', { class: 'missing' }, `This browser cannot draw in three dimensions: ${error.message}`));
      return null;
    }
  }

  controls() {
    const slider = byId('time');
    slider.addEventListener('input', () => { this.pause(); this.seek(slider.valueAsNumber); });
    slider.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: -0.1, ArrowDown: -0.1, ArrowRight: 0.1, ArrowUp: 0.1, PageUp: 1, PageDown: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      this.pause();
      this.seek(this.time + step);
    });
    byId('play').addEventListener('click', () => (this.playing ? this.pause() : this.play()));
    for (const id of ['show-boxes', 'show-lines', 'show-frusta']) byId(id).addEventListener('change', () => this.seek(this.time));
    byId('theme').addEventListener('click', () => this.dress(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark'));
    const dark = matchMedia('(prefers-color-scheme: dark)');
    dark.addEventListener('change', () => this.dress(dark.matches ? 'dark' : 'light'));
    this.dress(dark.matches ? 'dark' : 'light');
    const views = [null, ...Object.keys(this.overview.scene.cameras)];
    this.views = views.map((name) => make('button', { type: 'button', 'aria-pressed': String(name === null), onclick: () => this.look(name) }, name === null ? 'look around' : named(name)));
    byId('views').append(...this.views);
    this.viewNames = views;
  }

  legend() {
    const shown = ['covered', 'hidden', 'out_of_image', 'too_far', 'oblique'].map((kind) => {
      const [style, sign] = KINDS[kind], words = { too_far: 'too far or near', oblique: 'too flat an angle, or too small' }[kind] || KINDS[kind][2];
      return make('span', {}, make('i', { class: `spot ${style}` }), `${words}${sign ? ` (${sign})` : ''}`);
    });
    byId('legend').append(...shown, make('span', {}, 'empty: no formula asks'));
  }

  dress(theme) {
    document.documentElement.dataset.theme = theme;
    if (this.motion && this.scene) { this.scene.tell(); this.scene.draw(); }
  }

  async select(i) {
    this.pause();
    this.selected = i;
    this.table.mark(i);
    this.plot.mark(i);
    const c = this.candidates[i];
    byId('name').textContent = this.names[i];
    byId('place').textContent = c.rank === null ? 'infeasible' : `rank ${c.rank}${c.pareto ? ', Pareto-optimal' : ''}`;
    byId('verdict').replaceChildren(c.feasible ? named(c.verdict) : '');
    byId('reasons').replaceChildren(...c.reasons.map((reason) => make('li', {}, named(reason))));
    byId('study').hidden = !c.feasible;
    byId('spoken').textContent = `${this.names[i]}: ${c.feasible ? c.verdict : c.reasons.join('; ')}`;
    this.motion = null;
    if (!c.feasible) return;
    if (!this.details.has(i)) this.details.set(i, new Motion(await unpack(`detail-${i}`)));
    if (this.selected !== i) return;
    this.motion = this.details.get(i);
    this.figures(c);
    this.timeline = new Timeline(this.motion, Object.keys(this.overview.scene.cameras), (t) => { this.pause(); this.seek(t); });
    byId('time').max = this.motion.time;
    this.scene?.load(this.motion);
    this.seek(Math.min(this.time, this.motion.time));
  }

  figures(c) {
    const figures = [['Q_eoi', percent(c.q_eoi)], ['Q_avg', percent(c.q_avg)], ['time', seconds(c.time)]];
    for (const [name, fault] of Object.entries(c.faults)) {
      figures.push([`${name}: noticed after`, seconds(fault.delay_mean)], ['at worst', seconds(fault.delay_worst)],
        ['longest blind stretch', seconds(fault.blind_longest)], ['done after one retry', seconds(fault.expected_time, 1)]);
    }
    byId('figures').replaceChildren(...figures.map(([term, value]) => make('div', {}, make('dt', {}, named(term)), make('dd', {}, value))));
  }

  seek(t) {
    if (!this.motion) return;
    this.time = Math.max(0, Math.min(t, this.motion.time));
    const text = seconds(this.time), primitive = this.motion.detail.primitives.filter((p) => p.start <= this.time + 1e-9).pop();
    byId('time').value = this.time;
    byId('time').setAttribute('aria-valuetext', `${text}, ${primitive?.name ?? ''}`);
    byId('clock').textContent = text;
    byId('now-time').textContent = `${text}, ${primitive?.name ?? ''}`;
    this.timeline.show(this.time);
    this.now(this.motion.at(this.time));
    if (!this.scene) return;
    this.scene.seek(this.time);
    byId('tool').textContent = `tool at ${this.scene.toolPosition().map((x) => x.toFixed(3)).join(', ')} m`;
    byId('view').setAttribute('aria-label', `The cell at ${text}, ${this.scene.through ? `as ${this.scene.through} sees it` : 'from outside'}. ${sentence(this.motion.at(this.time))}`);
  }

  // What every camera sees now, in words.
  now(sample) {
    const asked = this.motion.atoms.map((atom) => [atom, found(sample, atom)]).filter(([, state]) => state);
    const literals = asked.map(([atom, state]) => make('section', {},
      make('h4', {}, make('i', { class: `spot ${state.covered ? 'covered' : 'missed'}` }), named(atom), make('span', { class: 'faint' }, state.covered ? 'covered' : 'not covered')),
      make('ul', {}, ...Object.entries(state.cameras).map(([camera, verdict]) => make('li', {},
        make('i', { class: `spot ${KINDS[kindOf(verdict)][0]}` }),
        make('button', { type: 'button', 'aria-label': `Look through ${camera}`, onclick: () => this.look(camera) }, named(camera)),
        make('span', {}, named(because(verdict))))))));
    byId('now').replaceChildren(...(literals.length ? literals : [make('p', { class: 'faint' }, 'No formula asks for anything now.')]));
  }

  look(name) {
    if (!this.scene) return;
    this.scene.look(name);
    this.views.forEach((button, i) => button.setAttribute('aria-pressed', String(this.viewNames[i] === name)));
    const camera = name && this.overview.scene.cameras[name];
    byId('spoken').textContent = name ? `Looking through ${name}${camera.D.some(Boolean) ? ', without its lens distortion' : ''}` : 'Looking from outside';
    this.seek(this.time);
  }

  play() {
    if (this.time >= this.motion.time) this.seek(0);
    this.playing = true;
    byId('play').textContent = '❚❚';
    byId('play').setAttribute('aria-label', 'Pause');
    let last = null;
    const step = (now) => {
      if (!this.playing) return;
      if (last !== null) this.seek(this.time + ((now - last) / 1000) * Number(byId('speed').value));
      last = now;
      if (this.time >= this.motion.time) this.pause(); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  pause() {
    this.playing = false;
    byId('play').textContent = '▶';
    byId('play').setAttribute('aria-label', 'Play');
  }
}

function sentence(sample) {
  const told = Object.entries(sample.literals).map(([literal, state]) => `${atomOf(literal)} is ${state.covered ? 'covered' : 'not covered'}`);
  return told.length ? `${[...new Set(told)].join('; ')}.` : 'No formula asks for anything.';
}

Promise.all([unpack('overview'), unpack('model')]).then(([overview, model]) => {
  const page = new Page(overview, model);
  window.sqrp = page;
  return page.select(0);
}).then(() => { document.documentElement.dataset.ready = 'true'; });
