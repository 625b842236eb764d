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

class ParetoPlot {
  constructor(entries, select) {
    const candidates = entries.map((e) => e.candidate),
      names = entries.map((e) => e.name);
    const feasible = entries.map((e, i) => i).filter((i) => candidates[i]?.feasible);
    const metric = feasible.some((i) => candidates[i].q_eoi !== null) ? 'q_eoi' : 'q_avg';
    const label = metric === 'q_eoi' ? 'Q_eoi' : 'Q_avg';
    this.dots = new Map();
    if (!feasible.length) {
      byId('plot').append(make('p', { class: 'faint' }, 'No candidate can be done.'));
      return;
    }
    const times = feasible.map((i) => candidates[i].time);
    const [low, high] = [Math.min(...times), Math.max(...times)],
      pad = 0.08 * (high - low || high || 1);
    const box = { left: 52, right: 462, top: 14, bottom: 258 };
    const x = (t) => box.left + ((t - low + pad) / (high - low + 2 * pad)) * (box.right - box.left);
    const y = (q) => box.bottom - q * (box.bottom - box.top);
    const chart = svg('svg', {
      viewBox: '0 0 480 300',
      role: 'group',
      'aria-label': `${label} against time, a dot per candidate; arrow keys move, Enter chooses; ★: Pareto-optimal`,
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
      const dot = svg('circle', {
        class: c.pareto ? 'dot pareto' : 'dot',
        cx,
        cy,
        r: crowded ? 5 : 7,
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
      if (!crowded || c.pareto) this.name(chart, `${names[i]}${c.pareto ? ' ★' : ''}`, cx, cy, taken, box);
    }
    byId('plot').append(chart);
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
        left + width < 478 &&
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

// A tip that follows pointer and keyboard focus. text: what it says at a place of the window; nothing: there is none.
function attachTip(element, text) {
  const tip = byId('tip');
  const show = (x, y) => {
    const words = text(x, y);
    tip.textContent = `\u2068${words}\u2069`;
    tip.hidden = !words;
    const size = tip.getBoundingClientRect();
    tip.style.left = `${Math.max(4, Math.min(x + 12, innerWidth - size.width - 8))}px`;
    tip.style.top = `${y + size.height + 24 > innerHeight ? y - size.height - 10 : y + 16}px`;
  };
  element.addEventListener('pointermove', (event) => show(event.clientX, event.clientY));
  element.addEventListener('pointerleave', () => {
    tip.hidden = true;
  });
  element.addEventListener('focus', () => {
    const place = element.getBoundingClientRect();
    show(place.left + place.width / 2, place.bottom - 10);
  });
  element.addEventListener('blur', () => {
    tip.hidden = true;
  });
}
