// The table: sorted by a click on a title, filtered by words.

// Faults by name, the one first that may be seen latest.
const byWorst = (faults) =>
  Object.entries(faults).sort(([, a], [, b]) => b.unseen - a.unseen || b.delay_worst - a.delay_worst);

const MOST_LABELS = 4; // that have a column each; those of more share one

class EntryTable {
  // lanes: whether a column shows when of each entry all is seen, once its motion is there.
  constructor(entries, select, lanes) {
    this.entries = entries;
    this.lanes = entries.map(() => make('div', { class: 'lane brief' }));
    this.sorting = { column: 0, descending: false };
    const marked = entries.some((e) => e.mark) ? [this.places()] : [];
    const told = [...marked, ...this.labels(select)];
    this.telling = told.length;
    this.columns = [...told, ...this.figures(lanes), ...this.faults()];
    this.rows = entries.map((e, i) => make('tr', { onclick: () => select(i) }, ...this.cells(e, i)));
    this.heads = this.columns.map((column, i) => this.head(column, i));
    byId('ranking').tHead.replaceChildren(make('tr', {}, ...this.heads));
    for (const id of ['filter', 'pareto-only', 'feasible-only']) byId(id).oninput = () => this.show();
    this.show();
  }

  // Rank or status.
  places() {
    const ranked = ({ mark }) => /^#?\d+$/.test(mark);
    const some = this.entries.some(ranked);
    const place = (e) => (ranked(e) ? Number(e.mark.replace('#', '')) : e.mark === '' ? 0 : null);
    return {
      title: some ? '#' : 'status',
      value: (e) => (e.candidate?.feasible === false ? null : some ? place(e) : e.mark),
      cell: (e) => this.mark(e),
    };
  }

  // What sets the entries apart: a column each, the first one with the button that chooses.
  labels(select) {
    const [first, ...others] = Object.keys(this.entries[0].labels);
    const text = (names) => (e) =>
      names.map((name) => `${others.length < MOST_LABELS ? '' : `${name} `}${e.labels[name]}`).join(', ');
    const column = (title, read) => {
      const counted = this.entries.every((e) => /^-?[\d.]+( \w+)?$/.test(read(e)));
      return {
        title,
        value: (e) => (counted ? parseFloat(read(e)) : read(e)),
        number: counted,
        cell: (e) => named(read(e)),
      };
    };
    const rest =
      others.length < MOST_LABELS ? others.map((name) => column(name, text([name]))) : [column('with', text(others))];
    const name = column(first, (e) => e.labels[first]);
    return [{ ...name, number: false, cell: (e, i) => this.button(i, e.labels[first], select) }, ...rest];
  }

  figures(lanes) {
    const quality = (title, key) => {
      const value = (e) => e.candidate?.[key];
      return { title, value, cell: (e) => changed(this.quality(value(e)), e, value, 100, 1), most: true, means: title };
    };
    const covered = { title: 'seen over time', value: (e) => e.candidate?.q_avg, cell: (e, i) => this.lanes[i] };
    return [
      quality('critical time seen', 'q_eoi'),
      quality('time seen', 'q_avg'),
      this.timed('time [s]', (e) => e.candidate?.time, 'time'),
      ...(lanes ? [covered] : []),
    ];
  }

  // The worst of the faults: with many, too wide a table would hide it.
  faults() {
    const of = (e) => byWorst(e.candidate?.faults ?? {});
    const names = [...new Set(this.entries.flatMap((e) => of(e).map(([name]) => name)))];
    if (!names.length) return [];
    const longest = (key) => (e) =>
      of(e).length ? Math.max(...of(e).map(([, fault]) => fault[key] ?? Infinity)) : null; // null: never
    const done = (e) => {
      const times = of(e)
        .filter(([name]) => e.retried.includes(name))
        .map(([, fault]) => fault.expected_time ?? Infinity);
      return times.length ? Math.max(...times) : null;
    };
    const only = names.length === 1;
    const worst = this.timed('at the latest', longest('delay_worst'), 'at the latest');
    const who = {
      title: 'worst fault',
      value: (e) => of(e)[0]?.[0] ?? null,
      cell: (e) => prose(of(e).map(([name]) => e.candidate.happens[name] ?? name)[0] ?? '–'),
      means: 'fault',
    };
    return [
      ...(only ? [] : [who]),
      this.timed('noticed after [s]', longest('delay_mean'), 'noticed after'),
      worst,
      ...(this.entries.some((e) => done(e) !== null) ? [this.timed('done after a retry', done, 'done after a retry', 1)] : []),
    ];
  }

  timed(title, value, means, digits) {
    return { title, value, cell: (e) => changed(stated(value(e), figure(value(e), digits)), e, value, 1, digits), number: true, means };
  }

  head(column, i) {
    if (column.means) explained.add(column.means);
    const button = make('button', { type: 'button', onclick: () => this.sort(i) }, named(column.title));
    attachTip(button, () => TERMS[column.means ?? column.title] ?? '');
    return make('th', { scope: 'col', class: column.number ? 'number' : null }, button);
  }

  cells(e, i) {
    const shown = e.candidate?.feasible ? this.columns : this.columns.slice(0, this.telling);
    const cells = shown.map((column) => make('td', { class: column.number ? 'number' : null }, column.cell(e, i)));
    if (shown !== this.columns)
      cells.push(
        make('td', { class: 'faint', colspan: this.columns.length - this.telling }, prose(e.reasons.length ? `cannot be done: ${e.reasons[0]}` : '')),
      );
    return cells;
  }

  // Show when of an entry all is seen.
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
    if (e.candidate?.pareto) explained.add('★');
    const star = () => make('span', { class: 'star', role: 'img', 'aria-label': ' no other row is better in everything' }, ' ★');
    const not = e.candidate?.feasible === false;
    const shown = not ? make('span', { role: 'img', 'aria-label': e.mark }, '✕') : e.mark;
    const cell = make('span', { class: `mark ${not ? 'not' : e.mark}` }, shown, e.candidate?.pareto ? star() : '');
    if (e.candidate?.pareto) attachTip(cell, () => `★ ${TERMS['★']}`);
    return cell;
  }

  button(i, text, select) {
    const choose = (event) => {
      event.stopPropagation();
      select(i);
    };
    return make('button', { type: 'button', 'aria-label': this.entries[i].name, onclick: choose }, named(text));
  }

  quality(share) {
    if (absent(share)) return '–';
    const level = share >= 0.9 ? '' : share >= 0.5 ? 'middling' : 'poor';
    const filled = make('b', { class: level });
    filled.style.width = `${100 * share}%`;
    return make('span', { class: 'quality' }, make('i', { 'aria-hidden': 'true' }, filled), percent(share));
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
    const compare = (a, b) => {
      const [x, y] = [value(this.entries[a]), value(this.entries[b])];
      if (absent(x) || absent(y)) return absent(x) - absent(y) || a - b;
      const order = typeof x === 'string' ? x.localeCompare(y, undefined, { numeric: true }) : x - y;
      return (descending ? -order : order) || a - b;
    };
    const words = byId('filter').value.toLowerCase().split(/\s+/).filter(Boolean);
    const chosen = this.entries.map((e, i) => i).filter((i) => this.fits(this.entries[i], words));
    byId('ranking').tBodies[0].replaceChildren(...chosen.sort(compare).map((i) => this.rows[i]));
    byId('shown').textContent = chosen.length < this.entries.length ? `${chosen.length} of ${this.entries.length}` : '';
    this.heads.forEach((head, i) => {
      if (i === column) head.setAttribute('aria-sort', descending ? 'descending' : 'ascending');
      else head.removeAttribute('aria-sort');
    });
  }

  // Whether an entry has all words, and is of the kinds that are asked for.
  fits({ name, mark, labels, candidate }, words) {
    const values = [...Object.entries(labels), ...Object.entries(candidate?.parameters ?? {})];
    const text = [name, mark, ...values.map(([key, value]) => `${key}=${value}`)].join(' ').toLowerCase();
    return (
      words.every((word) => text.includes(word)) &&
      (candidate?.pareto || !byId('pareto-only').checked) &&
      (candidate?.feasible || !byId('feasible-only').checked)
    );
  }

  choose(selected) {
    this.rows.forEach((row, i) => row.setAttribute('aria-selected', String(i === selected)));
    this.rows[selected]?.scrollIntoView({ block: 'nearest' }); // a new ranking may be shorter
  }
}

// A figure, with how it differs from what it was (`was` of the entry), where that is known and shows in so many decimals.
function changed(shown, entry, value, scale, digits = 2) {
  const was = entry.was ? value({ ...entry, candidate: entry.was }) : null;
  const difference = changeOf(value(entry), was, scale, digits);
  return difference ? make('span', { class: 'changed' }, shown, difference) : shown;
}

function changeOf(value, was, scale, digits, title = 'against the saved file') {
  if (absent(value) || absent(was) || !isFinite(value - was)) return null;
  const text = (scale * (value - was)).toFixed(digits);
  if (Number(text) === 0) return null;
  return make('small', { title }, Number(text) > 0 ? `+${text}` : text.replace('-', '−'));
}
