// What the page carries, how figures read, and how elements are made: text is only ever set as text.

async function unpack(id) {
  const packed = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Response(stream).json();
}

const byId = (id) => document.getElementById(id);

function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
    else if (value !== undefined && value !== null && value !== false)
      element.setAttribute(name, value === true ? '' : value);
  }
  element.append(...children);
  return element;
}

// A name from a file: isolated, so that right-to-left text in it leaves what is around it alone.
const named = (text) => make('bdi', {}, text);

const percent = (share) => (share === null ? '–' : (100 * share).toFixed(1) + ' %');
const seconds = (t, digits = 2) => (t === null ? '–' : t.toFixed(digits) + ' s');

// Kinds of verdicts, predicted or of images: colour class, sign within a run, words for the legend.
const KINDS = {
  covered: ['covered', '', 'covered'],
  hidden: ['hidden', 'h', 'hidden'],
  same_colour: ['hidden', 'c', 'same colour behind'],
  out_of_image: ['out', 'o', 'out of image'],
  too_far: ['range', 'f', 'too far'],
  too_near: ['range', 'n', 'too near'],
  detector_far: ['range', 'f', 'too far for its detector'],
  detector_near: ['range', 'n', 'too near for its detector'],
  oblique: ['angle', 'a', 'seen at too flat an angle'],
  too_small: ['angle', 's', 'too small'],
  shown_true: ['covered', 't', 'images show that it is true'],
  shown_false: ['out', 'f', 'images show that it is false'],
  unseen: ['missed', '–', 'no image shows it'],
  nothing: ['nothing', '–', 'no image shows it'],
  truly_true: ['covered', 't', 'true'],
  truly_false: ['out', 'f', 'false'],
  known: ['covered', '', 'images show every required literal'],
  unknown: ['missed', '–', 'images do not show every required literal'],
  missed: ['missed', '–', 'not covered'],
};

const kindOf = (verdict) => verdict.kind ?? (verdict.covered ? 'covered' : verdict.cause || 'missed');

// The kind of a literal or of a whole state.
const stateOf = (state) => state.kind ?? (state.covered ? 'covered' : 'missed');

// The kind of the true value, which only a simulation knows; null where it is unknown.
const truthOf = ({ really }) => (typeof really === 'boolean' ? `truly_${really}` : null);

function because(verdict) {
  const reason = reasonOf(verdict);
  return verdict.box ? `box ${verdict.box} is ${reason}` : reason;
}

function reasonOf(verdict) {
  const words = KINDS[kindOf(verdict)][2];
  if (verdict.cause === 'hidden') return `hidden by ${verdict.by}`;
  if (verdict.cause === 'same_colour') return `same colour as ${verdict.by} behind it`;
  return verdict.cause === 'out_of_image' ? `${words} (${verdict.by})` : words;
}

// How much of the box that a camera does not see is hidden, and what each part hides; none where it is not hidden.
function sharesOf(state, camera) {
  const box = (state.boxes ?? []).find((one) => one?.cameras[camera]?.covered === false);
  const parts = box?.cameras[camera].hidden_by ?? [];
  if (!parts.length) return [];
  const told = parts.map(({ name, share }) => `${name} ${percent(share)}`);
  return [`${percent(parts.reduce((sum, { share }) => sum + share, 0))}: ${told.join(', ')}`];
}

// How an entry fares, in words.
const placeOf = ({ mark, candidate }) =>
  `${/^\d+$/.test(mark) ? 'rank ' : ''}${mark}${candidate?.pareto ? ', Pareto-optimal' : ''}`;

const shownValue = (value) => (typeof value === 'string' ? value : String(+value.toPrecision(4)));

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
