const atomOf = (literal) => literal.replace(/^not /, '');

// What a sample says about an atom, or null where no formula requires it.
const found = (sample, atom) => sample.literals[atom] ?? sample.literals[`not ${atom}`] ?? null;

// Where everything was at each time of a run: rows of changes become whole states.
function unroll({ t, joints, q, held, objects }) {
  const changes = t.map(() => ({}));
  for (const [name, rows] of Object.entries(objects))
    for (const [index, ...pose] of rows) changes[index][name] = poseRows(pose);
  let current = {};
  return t.map((time, i) => {
    current = { ...current, ...changes[i] };
    const positions = Object.fromEntries(joints.map((name, column) => [name, q[i][column]]));
    return { t: time, q: positions, held: held[i], objects: current };
  });
}

// The motion of a candidate: what was computed at its samples, and what lies between them. Of a run: what images showed
// at its samples; where everything was is kept apart from them.

class Motion {
  constructor(detail) {
    this.detail = detail;
    this.samples = detail.samples;
    this.t = this.samples.map((sample) => sample.t);
    this.time = detail.time;
    this.ofImages = Boolean(detail.of_images);
    this.places = detail.track ? unroll(detail.track) : this.samples;
    this.placeTimes = detail.track ? detail.track.t : this.t;
  }

  // Index of the last sample at or before t; of two at the same instant the second.
  before(t, times = this.t) {
    let low = 0,
      high = times.length - 1;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (times[middle] <= t) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  // The sample whose verdicts hold at t: the nearest one; of images the last, as later ones are not known yet.
  at(t) {
    const i = this.before(t);
    if (this.ofImages) return this.samples[i];
    const next = Math.min(i + 1, this.t.length - 1);
    return this.samples[this.t[next] - t < t - this.t[i] ? next : i];
  }

  // Where everything is before and after t, and how far t is on the way from the first to the second.
  around(t) {
    const times = this.placeTimes,
      i = this.before(t, times),
      next = Math.min(i + 1, times.length - 1),
      step = times[next] - times[i];
    return [this.places[i], this.places[next], step > 0 ? Math.min(1, (t - times[i]) / step) : 0];
  }

  // The atoms: one target decides a literal and its negation, so both are one row.
  get atoms() {
    return [...new Set(this.samples.flatMap((sample) => Object.keys(sample.literals).map(atomOf)))];
  }

  // An atom in words.
  words(atom) {
    const { targets, says } = this.detail;
    return (targets[atom] ?? targets[`not ${atom}`])?.says ?? says?.[atom] ?? atom;
  }

  // Stretches in which `look(sample)` gives the same kind: [{start, end, key, value}], those without a key left out.
  // A change lies half way between two samples; of images, where the first of them shows it.
  runs(look) {
    const runs = [];
    let current = null;
    this.samples.forEach((sample, i) => {
      const value = look(sample),
        key = value && value.key;
      const edge = i === 0 || this.ofImages ? sample.t : (this.t[i - 1] + sample.t) / 2;
      if (current && current.key === key) {
        current.end = sample.t;
        return;
      }
      if (current) current.end = edge;
      current = value ? { ...value, start: edge, end: sample.t } : null;
      if (current) runs.push(current);
    });
    return runs.filter((run) => run.end > run.start);
  }

  // Share of the time that `look` says is covered, counted between neighbouring samples as Q is.
  share(look) {
    let asked = 0,
      seen = 0;
    for (let i = 0; i + 1 < this.samples.length; i++) {
      const [a, b] = [look(this.samples[i]), look(this.samples[i + 1])];
      if (a === null || b === null) continue;
      asked += this.t[i + 1] - this.t[i];
      if (a && b) seen += this.t[i + 1] - this.t[i];
    }
    return asked ? seen / asked : null;
  }
}
