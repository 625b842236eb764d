// Coverage over time: a row per literal and camera, a coloured run per cause. One stop of the tab key; arrows move.

class Timeline {
  constructor(motion, cameras, seek) {
    this.motion = motion;
    this.seek = seek;
    const detail = motion.detail,
      rows = [];
    if (detail.played?.length)
      rows.push(
        this.row(
          'step',
          'axis',
          detail.played.map((step) =>
            this.span('primitive', step, step.name, `${step.name}: ${seconds(step.start)} to ${seconds(step.end)}`),
          ),
          '',
        ),
      );
    rows.push(
      this.row(
        '',
        'axis',
        detail.primitives.map((p) =>
          this.span('primitive', p, p.name, `${p.name}: ${seconds(p.start)} to ${seconds(p.end)}`),
        ),
        '',
      ),
    );
    const interest = this.stretches(detail.formulas.filter((f) => f.operator === 'eventually'));
    if (interest.length)
      rows.push(
        this.row(
          'event of interest',
          'axis',
          interest.map((s) =>
            this.span('interest', s, '', `event of interest: ${seconds(s.start)} to ${seconds(s.end)}`),
          ),
          '',
        ),
      );
    for (const { label, spans } of detail.marks ?? [])
      rows.push(
        this.row(
          label,
          'axis',
          spans.map((span) => this.span('interest', span, '', span.text)),
          '',
        ),
      );
    rows.push(
      this.coverage('all literals', ({ covered, kind }) => (covered === null ? null : { covered, kind })),
    );
    for (const atom of motion.atoms) {
      rows.push(this.coverage(atom, (sample) => found(sample, atom)));
      if (motion.samples.some((sample) => truthOf(found(sample, atom) ?? {}))) rows.push(this.truth(atom));
      for (const camera of cameras) rows.push(this.camera(atom, camera));
    }
    this.grid = make(
      'div',
      { role: 'grid', 'aria-label': 'Coverage over time; arrow keys move, Enter goes there', 'aria-readonly': 'true' },
      ...rows,
    );
    this.cursor = make('i', {});
    byId('timeline').replaceChildren(this.grid, make('div', { id: 'cursor' }, this.cursor));
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

  stretches(formulas) {
    const merged = [];
    for (const { start, end } of [...formulas].sort((a, b) => a.start - b.start)) {
      const last = merged[merged.length - 1];
      if (last && start <= last.end) last.end = Math.max(last.end, end);
      else merged.push({ start, end });
    }
    return merged;
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

  row(label, kind, runs, share) {
    return make(
      'div',
      { class: `row ${kind}`, role: 'row' },
      make('div', { class: 'label', role: 'rowheader', title: label }, named(label)),
      make('div', { class: 'lane', role: 'presentation' }, ...runs),
      make('div', { class: 'share', role: 'gridcell' }, share),
    );
  }

  runs(label, look) {
    return this.motion.runs(look).map((run) => {
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

  // state: what a sample says, or null where no formula requires it.
  coverage(label, state) {
    const look = (sample) => {
      const literal = state(sample);
      if (literal === null) return null;
      const kind = stateOf(literal);
      return { key: kind, kind, words: KINDS[kind][2] };
    };
    return this.row(
      label,
      'literal',
      this.runs(label, look),
      this.shareText((sample) => state(sample)?.covered ?? null),
    );
  }

  camera(atom, camera) {
    const verdict = (sample) => found(sample, atom)?.cameras[camera] ?? null;
    const look = (sample) => {
      const seen = verdict(sample);
      return seen && { key: because(seen), kind: kindOf(seen), words: because(seen) };
    };
    const share = this.shareText((sample) => verdict(sample)?.covered ?? null);
    return this.row(camera, 'camera', this.runs(`${camera}, ${atom}`, look), share);
  }

  // The true values, to compare with what is seen.
  truth(atom) {
    const look = (sample) => {
      const kind = truthOf(found(sample, atom) ?? {});
      return kind && { key: kind, kind, words: KINDS[kind][2] };
    };
    return this.row('in truth', 'camera truth', this.runs(`in truth, ${atom}`, look), '');
  }

  shareText(covered) {
    const share = this.motion.share(covered);
    return share === null ? '' : percent(share);
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

  show(t) {
    this.cursor.style.left = `${(100 * t) / this.motion.time}%`;
  }
}
