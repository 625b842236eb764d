// What is seen over time: a row per literal and camera, a run per cause, and beside it how it is now. One stop of the tab
// key; arrows move.

class Timeline {
  // seek: called with a time; look: called with a camera that is clicked.
  constructor(motion, cameras, seek, look) {
    Object.assign(this, { motion, seek, look, kinds: new Set(), saying: [] });
    const detail = motion.detail;
    explained.add('fact').add('seen');
    const rows = [...this.axes(detail), this.state()];
    for (const atom of motion.atoms) {
      rows.push(this.literal(atom));
      if (motion.samples.some((sample) => truthOf(found(sample, atom) ?? {}))) rows.push(this.truth(atom));
      for (const camera of cameras) rows.push(this.camera(atom, camera));
    }
    const label = 'What is seen over time; arrow keys move, Enter goes there';
    this.grid = make('div', { role: 'grid', 'aria-label': label, 'aria-readonly': 'true' }, ...rows);
    this.cursor = make('i', {});
    byId('timeline').replaceChildren(this.grid, make('div', { id: 'cursor' }, this.cursor));
    byId('legend').replaceChildren(...this.legend());
    showWords();
    this.grid.addEventListener('keydown', (event) => this.move(event));
    this.grid.addEventListener('click', (event) => {
      const lane = event.target.closest('.lane');
      if (!lane) return;
      const place = lane.getBoundingClientRect();
      seek(((event.clientX - place.left) / place.width) * motion.time);
    });
    const first = this.grid.querySelector('.run');
    if (first) first.tabIndex = 0;
  }

  // What is done when: steps, primitive actions, events of interest and faults.
  *axes({ played = [], primitives, formulas, marks = [] }) {
    const words = (span) => `${doing(span)}: ${seconds(span.start)} to ${seconds(span.end)}`;
    const span = (one) => this.span('primitive', one, one.does ?? one.name, words(one));
    if (played.length) yield this.axis('step', played, played.map(span), doing);
    yield this.axis('robot does', primitives, primitives.map(span), doing);
    const interest = merged(formulas.filter((formula) => formula.operator === 'eventually'));
    if (interest.length) {
      this.kinds.add('interest');
      const text = (s) => `critical time: ${seconds(s.start)} to ${seconds(s.end)}`;
      const shown = interest.map((s) => this.span('interest', s, '', text(s)));
      yield this.axis(term('critical time', 'critical time', false), interest, shown, () => 'yes');
    }
    for (const { label, spans } of marks) {
      const shown = spans.map((one) => {
        this.kinds.add(one.kind);
        return this.span(`mark ${KINDS[one.kind][0]}`, one, '', one.text);
      });
      yield this.axis(named(label), spans, shown, ({ kind }) => KINDS[kind][2]);
    }
  }

  axis(label, spans, shown, words) {
    const now = (t) => spans.filter(({ start, end }) => start <= t + 1e-9 && t < end - 1e-9).pop();
    return this.row(label, 'axis', shown, '', (sample, t) => (now(t) ? { words: words(now(t)) } : null));
  }

  // Whether all that has to be seen is seen.
  state() {
    const look = (sample) => (sample.covered === null ? null : this.told(stateOf(sample)));
    const label = term('all that must be seen', 'all that must be seen', false);
    return this.row(
      label,
      'literal',
      this.runs('all that must be seen', look),
      this.share((sample) => sample.covered),
      look,
    );
  }

  literal(atom) {
    const look = (sample) => (found(sample, atom) ? this.told(stateOf(found(sample, atom))) : null);
    const share = this.share((sample) => found(sample, atom)?.covered ?? null);
    const words = this.motion.words(atom);
    return this.row(named(words), 'literal', this.runs(words, look), share, look);
  }

  camera(atom, camera) {
    const verdict = (sample) => found(sample, atom)?.cameras[camera] ?? null;
    const look = (sample) => {
      const seen = verdict(sample);
      return seen && { key: because(seen), kind: kindOf(seen), words: because(seen) };
    };
    const now = (sample) => {
      const told = look(sample);
      return told && { ...told, more: sharesOf(found(sample, atom), camera) };
    };
    const eye = {
      type: 'button',
      tabindex: '-1',
      'aria-label': `Look through ${camera}`,
      onclick: () => this.look(camera),
    };
    const share = this.share((sample) => verdict(sample)?.covered ?? null);
    return this.row(make('button', eye, named(camera)), 'camera', this.runs(`${camera}, ${this.motion.words(atom)}`, look), share, now);
  }

  // The true values, to compare with what is seen.
  truth(atom) {
    const look = (sample) => {
      const kind = truthOf(found(sample, atom) ?? {});
      return kind && this.told(kind);
    };
    return this.row(
      term('in truth', 'in truth', false),
      'camera truth',
      this.runs(`in truth, ${this.motion.words(atom)}`, look),
      '',
      look,
    );
  }

  told(kind) {
    return { key: kind, kind, words: KINDS[kind][2] };
  }

  // now: what is said of a sample and a time, {kind, words, more}, or null.
  row(label, kind, runs, share, now) {
    const spot = make('i', {}),
      words = named('');
    const cell = make('div', { class: 'now', role: 'gridcell' }, spot, words);
    attachTip(cell, () => cell.dataset.all ?? '');
    this.saying.push({ now, spot, words, cell });
    return make(
      'div',
      { class: `row ${kind}`, role: 'row' },
      make('div', { class: 'label', role: 'rowheader', title: label.textContent }, label),
      make('div', { class: 'lane', role: 'presentation' }, ...runs),
      cell,
      make('div', { class: 'share', role: 'gridcell' }, share),
    );
  }

  place(element, { start, end }) {
    element.style.left = `${(100 * start) / this.motion.time}%`;
    element.style.width = `${(100 * (end - start)) / this.motion.time}%`;
    return element;
  }

  span(kind, stretch, text, tip) {
    const element = this.place(make('div', { class: kind, role: 'gridcell', 'aria-label': tip }, text), stretch);
    attachTip(element, () => tip);
    return element;
  }

  runs(label, look) {
    return this.motion.runs(look).map((run) => {
      this.kinds.add(run.kind);
      const [style, sign] = KINDS[run.kind],
        wide = (run.end - run.start) / this.motion.time > 0.025;
      const text = `${label}, ${run.start.toFixed(2)} s to ${run.end.toFixed(2)} s: ${run.words}`;
      const element = this.place(
        make('div', { class: `run ${style}`, role: 'gridcell', tabindex: '-1', 'aria-label': text }, wide ? sign : ''),
        run,
      );
      element.dataset.start = run.start;
      attachTip(element, () => text);
      return element;
    });
  }

  share(covered) {
    const share = this.motion.share(covered);
    return share === null ? '' : percent(share);
  }

  // The kinds that the rows have, each as it looks there.
  legend() {
    const looks = (kind) => KINDS[kind].slice(0, 2).join();
    const used = Object.keys(KINDS).filter((kind) => this.kinds.has(kind));
    const shown = used.filter((kind, i) => used.findIndex((other) => looks(other) === looks(kind)) === i);
    const swatch = (kind) => make('i', { class: `swatch ${KINDS[kind][0]}`, 'aria-hidden': 'true' }, KINDS[kind][1]);
    const entries = shown.map((kind) => make('span', {}, swatch(kind), KINDS[kind][2]));
    return [...entries, make('span', {}, make('i', { class: 'swatch lane' }), 'nothing has to be seen')];
  }

  move(event) {
    const current = document.activeElement.closest('.run');
    if (!current) return;
    if (event.key === 'Enter' || event.key === ' ') {
      event.preventDefault();
      this.seek(Number(current.dataset.start) + 1e-6);
      return;
    }
    const lanes = [...this.grid.querySelectorAll('.lane')].filter((lane) => lane.querySelector('.run'));
    const lane = current.closest('.lane'),
      runs = [...lane.querySelectorAll('.run')];
    const middle = (run) => parseFloat(run.style.left) + parseFloat(run.style.width) / 2;
    const nearest = (target) =>
      [...target.querySelectorAll('.run')].reduce((best, run) =>
        Math.abs(middle(run) - middle(current)) < Math.abs(middle(best) - middle(current)) ? run : best,
      );
    const next = {
      ArrowRight: () => runs[runs.indexOf(current) + 1],
      ArrowLeft: () => runs[runs.indexOf(current) - 1],
      Home: () => runs[0],
      End: () => runs[runs.length - 1],
      ArrowDown: () => lanes[lanes.indexOf(lane) + 1] && nearest(lanes[lanes.indexOf(lane) + 1]),
      ArrowUp: () => lanes[lanes.indexOf(lane) - 1] && nearest(lanes[lanes.indexOf(lane) - 1]),
    }[event.key]?.();
    if (!next) return;
    event.preventDefault();
    current.tabIndex = -1;
    next.tabIndex = 0;
    next.focus();
  }

  // How everything is at a time; sample: what holds then.
  show(t, sample) {
    this.cursor.style.left = `${(100 * t) / this.motion.time}%`;
    for (const { now, spot, words, cell } of this.saying) {
      const told = now(sample, t),
        text = told?.words ?? '',
        style = told?.kind ? `spot ${KINDS[told.kind][0]}` : '';
      if (words.textContent !== text) words.textContent = text;
      if (spot.className !== style) spot.className = style;
      cell.dataset.all = text + (told?.more ?? '');
    }
  }
}

// Stretches in the order of time, those that touch as one.
function merged(formulas) {
  const stretches = [];
  for (const { start, end } of [...formulas].sort((a, b) => a.start - b.start)) {
    const last = stretches[stretches.length - 1];
    if (last && start <= last.end) last.end = Math.max(last.end, end);
    else stretches.push({ start, end });
  }
  return stretches;
}
