// Quality against time: every feasible candidate a dot that can be chosen.

function svg(tag, attributes, ...children) {
  const element = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

function niceStep(span, count) {
  const raw = span / count,
    power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
}

// A star of five points, as a path.
function star(x, y, size) {
  const tip = (i) => [(i % 2 ? 0.45 : 1) * size, (i * Math.PI) / 5];
  const at = ([r, turn]) => `${x + r * Math.sin(turn)} ${y - r * Math.cos(turn)}`;
  return `M${Array.from({ length: 10 }, (_, i) => at(tip(i))).join('L')}Z`;
}

class ParetoPlot {
  // compared: whether the entries are answers to one question.
  constructor(entries, select, compared) {
    const candidates = entries.map((e) => e.candidate),
      names = entries.map((e) => e.name);
    const feasible = entries.map((e, i) => i).filter((i) => candidates[i]?.feasible);
    const shown = (key) => new Set(feasible.map((i) => percent(candidates[i][key])));
    const metric = shown('q_eoi').size > 1 || shown('q_avg').has('–') ? 'q_eoi' : 'q_avg'; // one that tells them apart
    const label = metric === 'q_eoi' ? 'critical time seen' : 'time seen';
    this.dots = new Map();
    byId('against-time').hidden = !compared || feasible.length < 2;
    if (byId('against-time').hidden) return;
    const times = feasible.map((i) => candidates[i].time);
    const [low, high] = [Math.min(...times), Math.max(...times)],
      pad = 0.08 * (high - low || high || 1);
    const box = { left: 46, right: 388, top: 14, bottom: 196 };
    const x = (t) => box.left + ((t - low + pad) / (high - low + 2 * pad)) * (box.right - box.left);
    const y = (q) => box.bottom - q * (box.bottom - box.top);
    const chart = svg('svg', {
      viewBox: '0 0 400 236',
      role: 'group',
      'aria-label': `${label} against time, a dot per candidate, a star if no other is better in everything; arrow keys move, Enter chooses`,
    });
    for (let q = 0; q <= 1; q += 0.25) {
      chart.append(
        svg('line', { class: 'axis', x1: box.left, x2: box.right, y1: y(q), y2: y(q) }),
        svg('text', { x: box.left - 6, y: y(q) + 4, 'text-anchor': 'end' }, `${100 * q}`),
      );
    }
    const step = niceStep(high - low + 2 * pad, 6);
    for (let t = Math.ceil((low - pad) / step) * step; t <= high + pad; t += step) {
      chart.append(svg('text', { x: x(t), y: box.bottom + 18, 'text-anchor': 'middle' }, `${+t.toFixed(3)}`));
    }
    chart.append(
      svg('text', { x: box.right, y: box.bottom + 36, 'text-anchor': 'end' }, 'time [s]'),
      svg(
        'text',
        {
          x: 12,
          y: (box.top + box.bottom) / 2,
          transform: `rotate(-90 12 ${(box.top + box.bottom) / 2})`,
          'text-anchor': 'middle',
        },
        `${label} [%]`,
      ),
    );
    const front = feasible
      .filter((i) => candidates[i].pareto && candidates[i][metric] !== null)
      .sort((a, b) => candidates[a].time - candidates[b].time);
    if (front.length > 1)
      chart.append(
        svg('path', {
          class: 'front',
          d: 'M' + front.map((i) => `${x(candidates[i].time)} ${y(candidates[i][metric])}`).join('L'),
        }),
      );
    const crowded = feasible.length > 14,
      taken = feasible.map((i) => [x(candidates[i].time) - 7, y(candidates[i][metric] ?? 0) - 7, 14, 14]);
    const order = [...feasible].sort(
      (a, b) => candidates[a].pareto - candidates[b].pareto || candidates[a].time - candidates[b].time,
    );
    for (const i of order) {
      const c = candidates[i],
        [cx, cy] = [x(c.time), y(c[metric] ?? 0)];
      const text = `${names[i]}: ${label} ${percent(c[metric])}, time ${seconds(c.time)}, ${placeOf(entries[i])}`;
      const size = crowded ? 5 : 7;
      const dot = svg(c.pareto ? 'path' : 'circle', {
        class: c.pareto ? 'dot pareto' : 'dot',
        ...(c.pareto ? { d: star(cx, cy, 1.4 * size) } : { cx, cy, r: size }),
        tabindex: '-1',
        role: 'button',
        'aria-label': text,
        'aria-pressed': 'false',
      });
      dot.addEventListener('click', () => select(i));
      dot.addEventListener('keydown', (event) => this.key(event, i, select));
      attachTip(dot, () => text);
      chart.append(dot);
      this.dots.set(i, dot);
      if (!crowded || c.pareto) this.name(chart, names[i], cx, cy, taken, box);
    }
    const words = `Up: more is seen. Left: faster. `;
    const optimal = front.length ? [term('★'), ': no other is better in both.'] : [];
    byId('plot').append(chart, make('p', { class: 'faint' }, words, ...optimal));
    this.byTime = [...feasible].sort((a, b) => candidates[a].time - candidates[b].time);
    this.dots.get(this.byTime[0]).setAttribute('tabindex', '0');
  }

  // One stop of the tab key: arrows go from dot to dot by time, Enter chooses.
  key(event, i, select) {
    const step = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key];
    const next = this.dots.get(this.byTime[this.byTime.indexOf(i) + step]);
    if (event.key === 'Enter' || event.key === ' ') select(i);
    else if (next) this.reach(next).focus();
    else return;
    event.preventDefault();
  }

  reach(dot) {
    this.dots.forEach((other) => other.setAttribute('tabindex', other === dot ? '0' : '-1'));
    return dot;
  }

  // A name beside its dot, where there is room for it.
  name(chart, text, cx, cy, taken, box) {
    const width = 7 * [...text].length + 4;
    const places = [
      [cx + 10, cy - 8],
      [cx - 10 - width, cy - 8],
      [cx - width / 2, cy - 24],
      [cx - width / 2, cy + 9],
    ];
    const free = places.find(
      ([left, top]) =>
        left > box.left &&
        left + width < 398 &&
        top > -2 &&
        taken.every(([x, y, w, h]) => left + width < x || x + w < left || top + 15 < y || y + h < top),
    );
    if (!free) return;
    taken.push([...free, width, 15]);
    chart.append(svg('text', { class: 'name', x: free[0] + 2, y: free[1] + 12 }, `\u2068${text}\u2069`));
  }

  choose(selected) {
    this.dots.forEach((dot, i) => dot.setAttribute('aria-pressed', String(i === selected)));
    if (this.dots.has(selected)) this.reach(this.dots.get(selected));
  }
}
