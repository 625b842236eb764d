// The table of candidates: sorted by a click on a title, filtered by words.

class RankingTable {
  constructor(candidates, names, select) {
    this.candidates = candidates;
    this.names = names;
    this.sorting = { column: 0, descending: false };
    const faults = [...new Set(candidates.flatMap((c) => Object.keys(c.faults)))];
    this.columns = [
      { title: '#', value: (c) => c.rank ?? Infinity, cell: (c) => this.place(c) },
      { title: 'candidate', value: (c, i) => names[i], cell: (c, i) => this.button(i, select) },
      { title: 'Q_eoi', value: (c) => c.q_eoi, cell: (c) => this.quality(c.q_eoi), most: true },
      { title: 'Q_avg', value: (c) => c.q_avg, cell: (c) => this.quality(c.q_avg), most: true },
      { title: 'time [s]', value: (c) => c.time, cell: (c) => this.figure(c.time), number: true },
      ...faults.flatMap((fault) => [
        { title: `${fault} seen [s]`, value: (c) => c.faults[fault]?.delay_mean, cell: (c) => this.figure(c.faults[fault]?.delay_mean), number: true },
        { title: 'at worst', value: (c) => c.faults[fault]?.delay_worst, cell: (c) => this.figure(c.faults[fault]?.delay_worst), number: true },
        { title: 'all done', value: (c) => c.faults[fault]?.expected_time, cell: (c) => this.figure(c.faults[fault]?.expected_time, 1), number: true },
      ]),
    ];
    this.rows = candidates.map((c, i) => make('tr', { onclick: () => select(i) }, ...this.cells(c, i)));
    this.heads = this.columns.map((column, i) => make('th', { scope: 'col', class: column.number ? 'number' : null },
      make('button', { type: 'button', onclick: () => this.sort(i) }, named(column.title))));
    byId('ranking').tHead.append(make('tr', {}, ...this.heads));
    for (const id of ['filter', 'pareto-only', 'feasible-only']) byId(id).addEventListener('input', () => this.show());
    this.show();
  }

  cells(c, i) {
    const shown = c.feasible ? this.columns : this.columns.slice(0, 2);
    const cells = shown.map((column) => make('td', { class: column.number ? 'number' : null }, column.cell(c, i)));
    if (!c.feasible) cells.push(make('td', { class: 'faint', colspan: this.columns.length - 2 }, 'infeasible: ', named(c.reasons[0])));
    return cells;
  }

  place(c) {
    if (c.rank === null) return '–';
    return make('span', {}, String(c.rank), c.pareto ? make('span', { class: 'star', title: 'Pareto-optimal', role: 'img', 'aria-label': ' Pareto-optimal' }, ' ★') : '');
  }

  button(i, select) {
    return make('button', { type: 'button', onclick: (event) => { event.stopPropagation(); select(i); } }, named(this.names[i]));
  }

  quality(share) {
    if (share === null) return '–';
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
    const { column, descending } = this.sorting, value = this.columns[column].value;
    const missing = (v) => v === null || v === undefined || v === Infinity;
    const compare = (a, b) => {
      const [x, y] = [value(this.candidates[a], a), value(this.candidates[b], b)];
      if (missing(x) || missing(y)) return missing(x) - missing(y) || a - b;
      const order = typeof x === 'string' ? x.localeCompare(y, undefined, { numeric: true }) : x - y;
      return (descending ? -order : order) || a - b;
    };
    const words = byId('filter').value.toLowerCase().split(/\s+/).filter(Boolean);
    const chosen = this.candidates.map((c, i) => i).filter((i) => {
      const c = this.candidates[i], text = `${this.names[i]} ${Object.entries(c.parameters).map(([k, v]) => `${k}=${v}`).join(' ')}`.toLowerCase();
      return words.every((word) => text.includes(word)) && (c.pareto || !byId('pareto-only').checked) && (c.feasible || !byId('feasible-only').checked);
    }).sort(compare);
    byId('ranking').tBodies[0].replaceChildren(...chosen.map((i) => this.rows[i]));
    byId('shown').textContent = chosen.length < this.candidates.length ? `${chosen.length} of ${this.candidates.length}` : '';
    this.heads.forEach((head, i) => {
      if (i === column) head.setAttribute('aria-sort', descending ? 'descending' : 'ascending');
      else head.removeAttribute('aria-sort');
    });
  }

  mark(selected) {
    this.rows.forEach((row, i) => row.setAttribute('aria-selected', String(i === selected)));
    this.rows[selected].scrollIntoView({ block: 'nearest' });
  }
}
