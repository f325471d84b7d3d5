// Fields and sliders that change the values of the scene. The address contains the changed values, and only the
// address selects the dragon on the server. A change cancels the questions about the previous dragon.
'use strict';

const UNITS = {m: 'm', m_s: 'm/s', m_s2: 'm/s²', s: 's', deg: '°', hz: 'Hz', rad: 'rad'};
const QUESTIONS = ['contact', 'speed', 'room', 'pitch', 'clearance'];     // in the order of the time of an answer
const WAIT_MS = 40;         // delay after the last move of a slider
const fields = new Map();   // by key: the value in the scene's file, and the field's elements
let waiting = null;

/** An element with properties and children. */
function make(name, properties = {}, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

/** A part of a key as a word. */
const named = (part) => (CHINESE && NAMES[part]) || part.replaceAll('_', ' ');

/** The key of a field as words, and its unit. */
function wordsOf(key) {
  const parts = key.split('.').slice(1), last = parts.pop();
  const unit = Object.keys(UNITS).sort((a, b) => b.length - a.length).find((end) => last.endsWith(`_${end}`));
  const name = unit ? last.slice(0, -unit.length - 1) : last;
  return [[...parts.map((part) => (/^\d+$/.test(part) ? part : named(part.replace(/s$/, '')))), named(name)].join(' '),
    unit ? UNITS[unit] : ''];
}

/** Show the address with the changed values, so that the user can store and share the address. */
function keepAddress() {
  const changed = new URLSearchParams();
  for (const [key, {own, number}] of fields) if (number.value !== textOf(own)) changed.set(key, number.value);
  query = changed.size ? `?${changed}` : '';
  history.replaceState(null, '', `${location.pathname}${query}${location.hash}`);
  scene.href = `scene.yaml${query}`;
}

const textOf = (value) => (value === null ? '' : String(value));

function addField(box, {key, value, own, low, high, step}) {
  value = new URLSearchParams(location.search).get(key) ?? value;
  const [words, unit] = wordsOf(key), name = `value-${key}`;
  const number = make('input', {type: 'number', id: name, step, value: textOf(value), placeholder: say('the_end')});
  const slider = make('input', {type: 'range', min: low, max: high, step, value: value ?? high, tabIndex: -1});
  slider.setAttribute('aria-hidden', 'true');       // screen readers use the field, which has the same value
  number.setAttribute('aria-describedby', `${name}-error`);
  const error = make('p', {id: `${name}-error`, hidden: true});
  error.setAttribute('role', 'alert');
  const row = make('div', {className: 'value', title: say('slider', {key, low, high})},
    make('label', {htmlFor: name, textContent: words}), number, make('span', {textContent: unit}),
    make('div', {className: 'range'}, make('span', {textContent: low}), slider, make('span', {textContent: high})), error);
  number.addEventListener('input', () => { if (number.value !== '') slider.value = number.value; changed(); });
  slider.addEventListener('input', () => { number.value = slider.value; changed(); });
  fields.set(key, {own, number, slider, error, row});
  box.append(row);
}

/** Show which values have been changed. */
function mark() {
  for (const {own, number, row} of fields.values()) row.classList.toggle('changed', number.value !== textOf(own));
}

/** Show an error beside its field. */
function tell(error) {
  for (const {error: place, row} of fields.values()) { place.hidden = true; row.classList.remove('wrong'); }
  general.hidden = true;
  if (!error) return;
  const field = fields.get(error.key);
  const place = field ? field.error : general;
  place.textContent = error.text;
  place.hidden = false;
  field?.row.classList.add('wrong');
}

function changed() {
  mark();
  clearTimeout(waiting);
  waiting = setTimeout(() => follow().catch(complain), WAIT_MS);
}

/** Update the dragon and all answers; if a value is impossible, show the reason and keep the dragon. */
async function follow() {
  asking.abort();
  asking = new AbortController();
  pause();
  keepAddress();
  const {error} = await json('form.json');
  tell(error);
  if (error) { forget(); return; }
  await Promise.all([load().then(loadContact), answerAll()]);
}

/** Clear the answers, because the values are impossible. */
function forget() {
  for (const place of Object.values(answers)) place.replaceChildren('–');
}

/** Ask the questions in turn; each question shows a progress bar until its answer arrives. */
async function answerAll() {
  const mine = asking;
  for (const place of Object.values(answers)) {
    const bar = make('progress');
    bar.setAttribute('aria-label', say('working'));
    place.replaceChildren(bar);
  }
  for (const question of QUESTIONS) {
    const {key, values, how, until_contact: until} = await json(`answers/${question}`).catch((error) => {
      if (error.name === 'AbortError') throw error;
      return {key: 'refused', values: {text: error.message}};
    });
    if (mine !== asking) return;
    answers[question].replaceChildren(say(key, values) + (until ? say('until_contact') : ''),
      ...(how ? [make('i', {className: how, textContent: say(how)})] : []));
  }
}

const general = make('p', {hidden: true});
general.setAttribute('role', 'alert');
const answers = Object.fromEntries(QUESTIONS.map((question) => [question, make('dd')]));
const list = make('dl', {id: 'answers'}, ...QUESTIONS.flatMap((question) =>
  [make('dt', {textContent: say(`ask_${question}`)}), answers[question]]));
list.setAttribute('aria-live', 'polite');
const scene = make('a', {id: 'scene-file', href: 'scene.yaml', download: 'scene.yaml', textContent: 'scene.yaml'});
const reset = make('button', {id: 'reset', textContent: say('as_it_was')});
reset.addEventListener('click', () => {
  for (const {own, number, slider} of fields.values()) { number.value = textOf(own); slider.value = own ?? slider.max; }
  changed();
});

/** Build the panel from the server's answer about the address. */
async function open() {
  const panel = element('values'), form = await json('form.json');
  panel.append(make('h2', {textContent: say('what_if')}), list, make('menu', {}, reset, scene), general);
  const boxes = new Map();
  for (const field of form.fields) {
    const section = field.key.split('.')[0];
    if (!boxes.has(section)) {
      boxes.set(section, make('fieldset', {}, make('legend', {textContent: named(section)})));
      panel.append(boxes.get(section));
    }
    addField(boxes.get(section), field);
  }
  if (form.left_out) panel.append(make('p', {textContent: say('more', {count: form.left_out})}));
  panel.hidden = false;
  document.querySelector('main').classList.add('trying');
  keepAddress();
  mark();
  tell(form.error);
  if (form.error) { forget(); query = ''; return; }     // the original scene is shown
  answerAll().then(() => { document.body.dataset.answered = 'yes'; }).catch(complain);
}

prepare = open;
