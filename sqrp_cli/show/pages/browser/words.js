// What the words and signs of the page mean, and the tip that says so under pointer and keyboard focus.

const TERMS = {
  candidate: 'One choice of the objects and settings that the task leaves to you.',
  way: 'How the robot does it: how the arm is bent, from which side, how far the tool is turned.',
  'critical time': 'When a fault may happen that the skill looks for, such as while a part is lifted.',
  'critical time seen': 'Share of the critical time in which the cameras see all that must be seen then.',
  'time seen': 'Share of all the time in which something must be seen, and the cameras see all of it.',
  time: 'How long the motion of the robot takes.',
  '★': 'No other row is better in everything: in the critical time seen, the time seen and the time.',
  fact: 'Something that is so or is not, such as: the tool holds g2. Cameras tell it by what they see of the things in it.',
  seen: 'Enough cameras see what tells the fact: inside the image, near and large enough, not hidden.',
  'all that must be seen': 'Whether the cameras see every fact that the skill asks for at that time.',
  fault: 'What may go wrong, as the skill says it. The worst is the one that may be noticed latest.',
  'noticed after': 'How long after a fault an image shows it, on average over all times at which it may happen. Of several faults: the longest.',
  'at the latest':
    'The longest that it may take until an image shows the fault. Where all is seen, too: a lost part has to be clear of the tool before an image tells.',
  'longest time unseen': 'The longest time within the critical time in which the cameras do not see all that must be seen.',
  'done after a retry': 'When the task is done if the fault happens: noticed, stopped, moved back and done once more; on average.',
  'in truth': 'What was so in the simulation. The monitors do not know it: they judge by images alone.',
  'predicted images that showed it': 'Of the images that the program says show a fact, the share that did.',
  'it was noticed after': 'From when the fault happened until an image showed it.',
  predicted: 'The most that the program says it takes.',
};

// A word with its definition as a tip; stops: whether the tab key stops there.
const explained = new Set();
function term(name, text = name, stops = true) {
  explained.add(name);
  const word = make('dfn', { tabindex: stops ? '0' : null }, text);
  attachTip(word, () => TERMS[name]);
  return word;
}

// List the words that this page uses.
function showWords() {
  const used = Object.keys(TERMS).filter((name) => explained.has(name));
  if (byId('words').children.length === 2 * used.length) return;
  byId('words').replaceChildren(...used.flatMap((name) => [make('dt', {}, name), make('dd', {}, TERMS[name])]));
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
    tip.style.top = `${y > size.height + 14 ? y - size.height - 10 : y + 16}px`; // above: the answer stands below a word
  };
  const hide = () => {
    tip.hidden = true;
    element.removeAttribute('aria-describedby');
  };
  element.addEventListener('pointermove', (event) => show(event.clientX, event.clientY));
  element.addEventListener('pointerleave', hide);
  element.addEventListener('focus', () => {
    const place = element.getBoundingClientRect();
    show(place.left + place.width / 2, place.top);
    element.setAttribute('aria-describedby', 'tip');
  });
  element.addEventListener('blur', hide);
  element.addEventListener('keydown', (event) => event.key === 'Escape' && hide());
}

// Kinds of verdicts, predicted or of images: style, sign within a run, words for legend and tips.
const KINDS = {
  covered: ['covered', '', 'seen'],
  missed: ['missed', '–', 'not seen'],
  hidden: ['hidden', 'h', 'hidden'],
  same_colour: ['same', 'c', 'same colour behind'],
  too_dark: ['same', 'd', 'too dark'],
  too_bright: ['same', 'b', 'too bright'],
  out_of_image: ['out', 'o', 'outside its image'],
  too_far: ['range', 'f', 'too far'],
  behind: ['range', 'l', 'behind the camera'],
  too_near: ['range', 'n', 'too near'],
  detector_far: ['range', 'f', 'too far for its detector'],
  detector_near: ['range', 'n', 'too near for its detector'],
  oblique: ['angle', 'a', 'seen too flat'],
  too_small: ['angle', 's', 'too small'],
  known: ['covered', '', 'images show all'],
  unknown: ['missed', '–', 'images do not show all'],
  shown_true: ['covered', 't', 'images show: true'],
  shown_false: ['out', 'f', 'images show: false'],
  unseen: ['missed', '–', 'no image shows it'],
  nothing: ['nothing', '', 'does not show it'],
  truly_true: ['covered', 't', 'true'],
  truly_false: ['out', 'f', 'false'],
  interest: ['interest', '', 'critical time'],
  unnoticed: ['missed', '', 'fault not noticed yet'],
  handled: ['range', '', 'fault noticed, robot responds'],
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

const EDGES = { left: 'left of', right: 'right of', top: 'above', bottom: 'below' };

function reasonOf(verdict) {
  const words = KINDS[kindOf(verdict)][2];
  if (verdict.cause === 'hidden') return `behind ${verdict.by}`;
  if (verdict.cause === 'same_colour') return `of the same colour as ${verdict.by} behind it`;
  if (verdict.cause === 'too_dark' && verdict.by) return `${words} in the shadow of ${verdict.by}`;
  if (verdict.cause === 'too_bright') return `${words} in the light of ${verdict.by}`;
  return verdict.cause === 'out_of_image' ? `${EDGES[verdict.by] ?? 'outside'} its image` : words;
}

// How much of the box that a camera does not see is hidden, and what each part hides; nothing where it is not hidden.
function sharesOf(state, camera) {
  const box = (state.boxes ?? []).find((one) => one?.cameras[camera]?.covered === false);
  const parts = box?.cameras[camera].hidden_by ?? [];
  if (!parts.length) return '';
  const told = parts.map(({ name, share }) => `${name} ${percent(share)}`);
  return `; hidden ${percent(parts.reduce((sum, { share }) => sum + share, 0))}: ${told.join(', ')}`;
}
