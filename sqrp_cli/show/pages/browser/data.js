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

// A sentence: what stands between backticks in a text is a name, or something to type, and is shown as code.
const TYPED = /`([^`]+)`/;
const prose = (text) => make('bdi', {}, ...text.split(TYPED).map((part, i) => (i % 2 ? make('code', {}, part) : part)));
const spoken = (text) => text.split(TYPED).join('');

const absent = (value) => value === null || value === undefined;
const percent = (share) => (absent(share) ? '–' : (100 * share).toFixed(1) + ' %');
const fixed = (value, digits) => (+value.toFixed(digits) + 0).toFixed(digits); // no -0.00
const figure = (value, digits = 2) => (absent(value) ? '–' : value === Infinity ? 'never' : fixed(value, digits));
const stated = (value, shown) => (value === Infinity ? make('span', { class: 'never' }, shown) : shown);
const seconds = (t, digits = 2) => (absent(t) ? '–' : t === Infinity ? 'never' : t.toFixed(digits) + ' s');

// What a primitive action does; its name in the skill where that does not say it.
const doing = ({ name, does }) => does ?? name;

// How an entry fares, in words.
const placeOf = ({ mark, candidate }) =>
  `${/^\d+$/.test(mark) ? 'rank ' : ''}${mark}${candidate?.pareto ? ' ★' : ''}`;

// All that is said of an entry beside its figures; of a task of several steps, where it is not seen stands at each.
const toldOf = ({ moves, said, candidate }) =>
  moves && candidate ? [...said, ...(candidate.steps?.length ? [] : [candidate.verdict])].join(' ') : '';

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
