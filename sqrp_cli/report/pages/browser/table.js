// The table: sorted by a click on a title, filtered by words.

class EntryTable {
  // lanes: whether a column shows when each entry is covered, once its motion is there.
  constructor(entries, select, lanes) {
    this.entries = entries;
    this.lanes = entries.map(() => make('div', { class: 'lane brief' }));
    this.sorting = { column: 0, descending: false };
    const labels = Object.keys(entries[0].labels);
    const figures = (e) => e.candidate ?? { faults: {} };
    const faults = [...new Set(entries.flatMap((e) => Object.keys(figures(e).faults)))];
    const done = (e, fault) => (e.retried.includes(fault) ? figures(e).faults[fault]?.expected_time : undefined);
    const timed = (title, value, digits) => ({
      title,
      value,
      cell: (e) => this.figure(value(e), digits),
      number: true,
    });
    const quality = (title, value) => ({ title, value, cell: (e) => this.quality(value(e)), most: true });
    const marked = entries.some((e) => e.mark);
    const status = [
      {
        title: entries.some((e) => /^\d+$/.test(e.mark)) ? '#' : '',
        value: (e) => (/^\d+$/.test(e.mark) ? Number(e.mark) : e.candidate && !e.candidate.feasible ? null : e.mark),
        cell: (e) => this.mark(e),
      },
    ];
    this.columns = [
      ...(marked ? status : []),
      ...labels.map((title, place) => ({
        title,
        value: (e) => e.labels[title],
        number: typeof entries[0].labels[title] !== 'string',
        cell: (e, i) =>
          place ? named(shownValue(e.labels[title])) : this.button(i, shownValue(e.labels[title]), select),
      })),
      quality('Q_eoi', (e) => figures(e).q_eoi),
      quality('Q_avg', (e) => figures(e).q_avg),
      timed('time [s]', (e) => figures(e).time),
      ...(lanes ? [{ title: 'covered over time', value: (e) => figures(e).q_avg, cell: (e, i) => this.lanes[i] }] : []),
      ...faults.flatMap((fault) => [
        timed(`${fault} seen [s]`, (e) => figures(e).faults[fault]?.delay_mean),
        timed('at worst', (e) => figures(e).faults[fault]?.delay_worst),
        ...(entries.some((e) => done(e, fault) !== undefined) ? [timed('all done', (e) => done(e, fault), 1)] : []),
      ]),
    ];
    this.telling = Number(marked) + labels.length;
    this.rows = entries.map((e, i) => make('tr', { onclick: () => select(i) }, ...this.cells(e, i)));
    this.heads = this.columns.map((column, i) =>
      make(
        'th',
        { scope: 'col', class: column.number ? 'number' : null },
        make(
          'button',
          { type: 'button', onclick: () => this.sort(i) },
          column.title ? named(column.title) : make('span', { class: 'unseen' }, 'status'),
        ),
      ),
    );
    byId('ranking').tHead.append(make('tr', {}, ...this.heads));
    for (const id of ['filter', 'pareto-only', 'feasible-only']) byId(id).addEventListener('input', () => this.show());
    this.show();
  }

  cells(e, i) {
    const shown = e.candidate?.feasible ? this.columns : this.columns.slice(0, this.telling);
    const cells = shown.map((column) => make('td', { class: column.number ? 'number' : null }, column.cell(e, i)));
    if (shown !== this.columns)
      cells.push(
        make('td', { class: 'faint', colspan: this.columns.length - this.telling }, named(e.reasons[0] ?? '')),
      );
    return cells;
  }

  // Show when an entry is covered.
  fill(i, motion) {
    const runs = motion.runs(({ covered }) => {
      const kind = covered ? 'covered' : 'missed';
      return covered === null ? null : { key: kind, kind };
    });
    const placed = runs.map(({ kind, start, end }) => {
      const run = make('div', { class: `run ${kind}` });
      run.style.left = `${(100 * start) / motion.time}%`;
      run.style.width = `${(100 * (end - start)) / motion.time}%`;
      attachTip(run, () => `${seconds(start)} to ${seconds(end)}: ${KINDS[kind][2]}`);
      return run;
    });
    this.lanes[i].replaceChildren(...placed);
  }

  mark(e) {
    const star = make(
      'span',
      { class: 'star', title: 'Pareto-optimal', role: 'img', 'aria-label': ' Pareto-optimal' },
      ' ★',
    );
    return make('span', { class: `mark ${e.mark}` }, e.mark, e.candidate?.pareto ? star : '');
  }

  button(i, text, select) {
    const choose = (event) => {
      event.stopPropagation();
      select(i);
    };
    return make('button', { type: 'button', 'aria-label': this.entries[i].name, onclick: choose }, named(text));
  }

  quality(share) {
    if (share === null || share === undefined) return '–';
    const level = share >= 0.9 ? '' : share >= 0.5 ? 'middling' : 'poor';
    const filled = make('b', { class: level });
    filled.style.width = `${100 * share}%`;
    return make('span', { class: 'quality' }, make('i', { 'aria-hidden': 'true' }, filled), percent(share));
  }

  figure(value, digits = 2) {
    return value === null || value === undefined ? '–' : value.toFixed(digits);
  }

  sort(column) {
    const same = this.sorting.column === column;
    this.sorting = { column, descending: same ? !this.sorting.descending : Boolean(this.columns[column].most) };
    this.show();
  }

  // Rows without a figure come last in either order.
  show() {
    const { column, descending } = this.sorting,
      value = this.columns[column].value;
    const missing = (v) => v === null || v === undefined;
    const compare = (a, b) => {
      const [x, y] = [value(this.entries[a]), value(this.entries[b])];
      if (missing(x) || missing(y)) return missing(x) - missing(y) || a - b;
      const order = typeof x === 'string' ? x.localeCompare(y, undefined, { numeric: true }) : x - y;
      return (descending ? -order : order) || a - b;
    };
    const words = byId('filter').value.toLowerCase().split(/\s+/).filter(Boolean);
    const chosen = this.entries
      .map((e, i) => i)
      .filter((i) => {
        const { name, mark, labels, candidate } = this.entries[i],
          values = { ...labels, ...candidate?.parameters };
        const text = [name, mark, ...Object.entries(values).map(([key, value]) => `${key}=${value}`)]
          .join(' ')
          .toLowerCase();
        return (
          words.every((word) => text.includes(word)) &&
          (candidate?.pareto || !byId('pareto-only').checked) &&
          (candidate?.feasible || !byId('feasible-only').checked)
        );
      })
      .sort(compare);
    byId('ranking').tBodies[0].replaceChildren(...chosen.map((i) => this.rows[i]));
    byId('shown').textContent = chosen.length < this.entries.length ? `${chosen.length} of ${this.entries.length}` : '';
    this.heads.forEach((head, i) => {
      if (i === column) head.setAttribute('aria-sort', descending ? 'descending' : 'ascending');
      else head.removeAttribute('aria-sort');
    });
  }

  choose(selected) {
    this.rows.forEach((row, i) => row.setAttribute('aria-selected', String(i === selected)));
    this.rows[selected].scrollIntoView({ block: 'nearest' });
  }
}
