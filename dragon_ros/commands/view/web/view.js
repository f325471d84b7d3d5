// Plays a run: frames come from the server in chunks, and plotly.js draws them in the colours of view.css.
'use strict';

const COLOUR = {body: '#56B4E9', head: '#D55E00', touching: '#E69F00'};
const OUTLINE = 0.035;      // width of an outline as a fraction of a bench's width; at most 2.5 pixels
const NARROW = window.matchMedia('(max-width: 800px)');
const DARK = window.matchMedia('(prefers-color-scheme: dark)');
const AT_ONCE = {mode: 'immediate', transition: {duration: 0}, frame: {duration: 0, redraw: false}};
const SETTINGS = {responsive: true, displaylogo: false, scrollZoom: true, showSendToCloud: false, plotlyServerURL: '',
  modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d', 'zoomIn2d', 'zoomOut2d']};
const PACES = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50];
const MOST_CHUNKS = 24;
const NEAR_LENGTHS = 6, FAR_LENGTHS = 8;      // sizes of a window that follows the head, in bench lengths
const CLOSER = 1.25;        // factor of one zoom step
const element = (id) => document.getElementById(id);

let run, curve = null, contact = null;
let query = location.search;            // selects the run to show if the server has several
let asking = new AbortController();     // cancels the requests about the shown run
let prepare = async () => {};           // try.js replaces this first step
const chunks = new Map();
const player = {whole: true, t: 0, tick: 0, playing: false, pace: 1, last: 0, drawing: false, wanted: null, turn: Promise.resolve()};

/** Change the scene's plot after earlier changes: the two axes lose their common scale if a change overtakes another. */
function inTurn(change) {
  player.turn = player.turn.catch(() => null).then(change);
  return player.turn;
}

/** A colour of view.css, in light or dark mode. */
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** The server's answer about the run of this address, or the data in the page itself. */
async function get(path) {
  if (window.EMBEDDED) return new Response(Uint8Array.from(atob(window.EMBEDDED[path]), (letter) => letter.charCodeAt(0)));
  const answer = await fetch(path + query, {signal: asking.signal});
  if (!answer.ok) throw new Error(`${path}: ${await answer.text()}`);
  return answer;
}

const json = async (path) => (await get(path)).json();

// ---- data

const valuesEach = () => 8 * run.drawn + 2 * run.placed + run.handles.length;

function chunk(number) {
  if (!chunks.has(number)) {
    const entry = {values: null};
    entry.ready = get(`frames/${number}`).then((answer) => answer.arrayBuffer())
      .then((bytes) => { entry.values = new Float32Array(bytes); })
      .catch((error) => { chunks.delete(number); complain(error); });
    chunks.set(number, entry);
    for (const old of chunks.keys()) {
      if (chunks.size <= MOST_CHUNKS) break;
      if (old !== number) chunks.delete(old);
    }
  }
  return chunks.get(number);
}

/** The frame of a tick, which is null until the frame has arrived. The next chunk is requested in advance. */
function frameOf(tick) {
  const number = Math.floor(tick / run.frames_each);
  const entry = chunk(number);
  if ((number + 1) * run.frames_each < run.times_s.length) chunk(number + 1);
  if (!entry.values) return null;
  const start = (tick - number * run.frames_each) * valuesEach();
  return entry.values.subarray(start, start + valuesEach());
}

/** The last tick at or before t. */
function tickAt(t) {
  let low = 0, high = run.times_s.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (run.times_s[middle] <= t + 1e-9) low = middle; else high = middle - 1;
  }
  return low;
}

// ---- drawing

function rectangles(frame, benches) {
  const x = [], y = [];
  for (const bench of benches) {
    for (let corner = 0; corner < 5; corner++) {
      const at = 8 * bench + 2 * (corner % 4);
      x.push(frame[at]); y.push(frame[at + 1]);
    }
    x.push(null); y.push(null);
  }
  return {x, y};
}

/** The benches of the body, the head, and the benches of the first contact; the head keeps its colour. */
function groups() {
  const touching = contact ? contact.benches.filter((bench) => bench > 0 && bench < run.drawn) : [];
  const body = Array.from({length: run.drawn - 1}, (_, n) => n + 1).filter((bench) => !touching.includes(bench));
  return [body, [0], touching];
}

function sceneData(frame) {
  return run.drawn ? groups().map((benches) => rectangles(frame, benches)) : [{x: [], y: []}, {x: [], y: []}, {x: [], y: []}];
}

function speedData(frame) {
  return Array.from(frame.subarray(8 * run.drawn + 2 * run.placed));
}

function axis(title, more = {}) {
  return {title: {text: title, standoff: 6}, gridcolor: colour('grid'), zeroline: false, linecolor: colour('quiet'), ticks: 'outside',
    tickcolor: colour('quiet'), automargin: true, ...more};
}

function layout(more) {
  return {margin: {l: 64, r: 16, t: 8, b: 44}, paper_bgcolor: 'rgba(0,0,0,0)', plot_bgcolor: 'rgba(0,0,0,0)', showlegend: false,
    modebar: {bgcolor: 'rgba(0,0,0,0)', color: colour('quiet'), activecolor: colour('ink')},
    font: {family: 'system-ui, sans-serif', size: 12, color: colour('ink')}, hovermode: 'closest', ...more};
}

/** On a narrow page, dragging scrolls the page, and there is no space for a toolbar. */
const settings = () => ({...SETTINGS, displayModeBar: NARROW.matches ? false : 'hover'});
const dragging = (mode) => (NARROW.matches ? false : mode);

function wholeRange() {
  const [[left, bottom], [right, top]] = run.window_m;
  return {'xaxis.range': [left, right], 'yaxis.range': [bottom, top]};
}

/** Width of an outline in pixels, which scales with the benches. */
function outline() {
  const {_length: pixels, range} = element('scene')._fullLayout.xaxis;
  return Math.min(2.5, OUTLINE * run.width_m * pixels / Math.abs(range[1] - range[0]));
}

const pixelsWide = () => element('scene')._fullLayout.xaxis._length / Math.abs(shownSpan());
const shownSpan = () => element('scene')._fullLayout.xaxis.range[1] - element('scene')._fullLayout.xaxis.range[0];

/** Fit outlines to the zoom, and show how wide a bench is on the screen. */
async function scaleOutlines() {
  const width = outline();
  if (run.drawn && width !== player.outline) {
    player.outline = width;
    await inTurn(() => Plotly.restyle('scene', {'line.width': width}, [1, 2, 3]));
  }
  drawMany(player.frame);
  sayScale();
}

function sayScale() {
  const wide = run.width_m * pixelsWide(), long = run.length_m * pixelsWide();
  const size = (pixels) => pixels.toFixed(pixels < 9.95 ? 1 : 0);
  const each = run.placed ? say(cost.webgl ? 'by_webgl' : 'by_canvas', {kb: Math.round(4 * valuesEach() / 1000), calls: cost.calls}) +
    (player.rate ? say('rate', {rate: player.rate.toFixed(0)}) : '') : '';
  element('scale').textContent = say('scale', {long: size(long), wide: size(wide)}) + each;
}

/** Draw a dragon of many benches. */
function drawMany(frame) {
  if (!run.placed || !frame || !element('scene')._fullLayout) return;
  const touching = contact ? contact.benches.filter((bench) => bench > 0) : [];
  drawBenches(element('scene'), run.track, frame.subarray(0, 2 * run.placed), player.halves, touching);
}

/** Draw many benches by WebGL instead of on the canvas, or vice versa. */
function otherDrawing() {
  if (!run.placed) return;
  drawBy(!cost.webgl);
  drawMany(player.frame);
  player.rate = player.since = null;
  sayScale();
}

/** The middle of the head bench in a frame. */
function headOf(frame) {
  const places = run.drawn ? 4 : 2, sum = [0, 0];
  for (let n = 0; n < 2 * places; n++) sum[n % 2] += frame[n] / places;
  return sum;
}

/** Show the whole window, also after later changes of the page's size, which would otherwise only enlarge it. */
function lookAtWhole() {
  player.whole = true;
  return inTurn(() => Plotly.relayout('scene', wholeRange()));
}

/** Show a window around a place; `ratio` changes its size. */
function lookAt([x, y], ratio = 1) {
  player.whole = false;
  return inTurn(() => {
    const {xaxis, yaxis} = element('scene')._fullLayout;
    const [wide, high] = [xaxis, yaxis].map(({range}) => 0.5 * ratio * (range[1] - range[0]));
    return Plotly.relayout('scene', {'xaxis.range': [x - wide, x + wide], 'yaxis.range': [y - high, y + high]});
  });
}

/** Zoom about the middle of the window, where the head is while the window follows the head. */
function zoom(ratio) {
  const {xaxis, yaxis} = element('scene')._fullLayout;
  return lookAt([xaxis, yaxis].map(({range}) => 0.5 * (range[0] + range[1])), ratio);
}

/** Store a choice for a year in a cookie, which pages on any port share, or, for a file, in local storage. */
function remember(name, value) {
  document.cookie = `${name}=${value}; max-age=31536000; path=/; SameSite=Strict`;
  try { localStorage.setItem(name, value); } catch { /* without storage, the choice is not remembered */ }
}

function remembered(name) {
  const cookie = document.cookie.split('; ').find((one) => one.startsWith(`${name}=`));
  if (cookie) return cookie.slice(name.length + 1);
  try { return localStorage.getItem(name); } catch { return null; }
}

/** Follow the head, or stop following; zoom in from a large window. The choice is stored for the next page. */
async function follow(on) {
  player.following = on;
  element('follow').setAttribute('aria-pressed', on);
  remember('follow', on ? 'yes' : 'no');
  if (!on || !player.frame || !built('scene')) return;
  const far = shownSpan() > FAR_LENGTHS * run.length_m;
  await lookAt(headOf(player.frame), far ? NEAR_LENGTHS * run.length_m / shownSpan() : 1);
}

/** Zoom with two fingers about the point between them. */
function pinch(scene) {
  let before = 0;
  const apart = ([a, b]) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
  scene.addEventListener('touchstart', (event) => { before = event.touches.length === 2 ? apart(event.touches) : 0; });
  scene.addEventListener('touchmove', (event) => {
    if (event.touches.length !== 2 || !before) return;
    event.preventDefault();
    const {xaxis, yaxis} = scene._fullLayout, box = scene.getBoundingClientRect(), [a, b] = event.touches;
    const x = xaxis.p2d((a.clientX + b.clientX) / 2 - box.left - xaxis._offset);
    const y = yaxis.p2d((a.clientY + b.clientY) / 2 - box.top - yaxis._offset);
    const now = apart(event.touches), ratio = before / now;
    before = now;
    player.whole = false;
    const about = ({range}, at) => range.map((end) => at + ratio * (end - at));
    Plotly.relayout(scene, {'xaxis.range': about(xaxis, x), 'yaxis.range': about(yaxis, y)});
  }, {passive: false});
}

function legend() {
  const parts = [['', COLOUR.body, say('body')], ['', COLOUR.head, say('head')]];
  if (groups()[2].length) parts.push(['', COLOUR.touching, say(contact.benches[0] ? 'touching' : 'touched')]);
  if (run.track) parts.push(['line', colour('track'), say('track')]);
  if (run.walls) parts.push(['line', colour('quiet'), say('walls')]);
  if (contact) parts.push(['ring', colour('ink'), say('contact')]);
  element('legend').replaceChildren(...parts.map(([kind, shade, text]) => {
    const part = document.createElement('span'), sign = document.createElement('i');
    sign.className = kind;
    sign.style[kind ? 'borderColor' : 'backgroundColor'] = shade;
    part.append(sign, text);
    return part;
  }));
}

async function drawScene(frame) {
  const names = ['body', 'head', 'touching'];
  const fills = [COLOUR.body, COLOUR.head, COLOUR.touching];
  const benches = sceneData(frame).slice(0, 3).map((data, n) => ({...data, type: 'scatter', mode: 'lines', fill: 'toself',
    fillcolor: fills[n], line: {color: colour('outline'), width: 0.5, simplify: false}, name: names[n], hoveron: 'points',
    text: groups()[n].flatMap((bench) => Array(6).fill(say('bench', {bench}))), hovertemplate: '%{text}<br>%{x:.4f}, %{y:.4f} m<extra></extra>',
  }));
  const own = run.track && run.drawn;         // the canvas shows the track if there are many benches
  const track = {x: own ? run.track[0] : [], y: own ? run.track[1] : [], type: 'scatter', mode: 'lines', name: say('track'),
    line: {color: colour('track'), width: 0.8}, hoverinfo: 'skip'};
  const point = {x: contact ? [contact.point_m[0]] : [], y: contact ? [contact.point_m[1]] : [],
    type: 'scatter', mode: 'markers', name: say('contact'),
    marker: {symbol: 'circle-open', size: 15, color: colour('ink'), line: {width: 1.6}}, hovertemplate: say('contact') + '<br>%{x:.6f}, %{y:.6f} m<extra></extra>'};
  const walls = run.walls ? [{x: run.walls[0], y: run.walls[1], type: 'scatter', mode: 'lines', name: say('walls'),
    line: {color: colour('quiet'), width: 1.6, simplify: false}, hoverinfo: 'skip'}] : [];
  const range = wholeRange(), shown = player.whole ? null : element('scene').layout;
  await Plotly.newPlot('scene', [track, ...benches, point, ...walls], layout({dragmode: 'pan', margin: {l: 72, r: 16, t: 8, b: 50},
    xaxis: axis('x (m)', {automargin: false, range: shown ? shown.xaxis.range : range['xaxis.range']}),
    yaxis: axis('y (m)', {automargin: false, range: shown ? shown.yaxis.range : range['yaxis.range'], scaleanchor: 'x'})}),
  {...settings(), responsive: false});          // refit does it
  player.outline = null;
  await scaleOutlines();
  element('scene').on('plotly_relayout', (change) => {
    if ('xaxis.range[0]' in change) player.whole = false;       // dragged or zoomed by the mouse
    scaleOutlines().catch(complain);
  });
  element('scene').on('plotly_relayouting', () => { drawMany(player.frame); sayScale(); });
  legend();
}

async function drawClearance() {
  const known = curve.gap_mm.filter((gap) => gap !== null);
  const low = Math.min(0, ...known), high = Math.max(1, ...known);
  const margin = 0.05 * (high - low);
  player.low = low - margin; player.high = high + margin;
  const shapes = low < 0 ? [{type: 'rect', xref: 'paper', x0: 0, x1: 1, y0: player.low, y1: 0, fillcolor: COLOUR.head, opacity: 0.08,
    line: {width: 0}, layer: 'below'}] : [];
  const touch = contact ? {x: [contact.t_s], y: [0]} : {x: [], y: []};
  await Plotly.newPlot('clearance', [
    {x: curve.t_s, y: curve.gap_mm, type: 'scatter', mode: 'lines', line: {color: colour('line'), width: 1.4},
      hovertemplate: '%{x:.2f} s: %{y:.3f} mm<extra></extra>'},
    {...touch, type: 'scatter', mode: 'markers', marker: {color: COLOUR.head, size: 9, line: {color: colour('ink'), width: 0.8}},
      hovertemplate: say('contact_at') + ' %{x:.6f} s<extra></extra>'},
    {x: [player.t, player.t], y: [player.low, player.high], type: 'scatter', mode: 'lines', line: {color: colour('ink'), width: 1}, hoverinfo: 'skip'},
  ], layout({shapes, xaxis: axis(say('time_s'), {range: [curve.t_s[0], curve.t_s.at(-1)]}),
    yaxis: axis(say('clearance_mm'), {range: [player.low, player.high]}), dragmode: dragging('zoom')}), settings());
  element('clearance').on('plotly_click', (event) => { pause(); seek(event.points[0].x); });
}

async function drawSpeeds(frame) {
  const speeds = run.speeds ? speedData(frame) : [];
  await Plotly.newPlot('speeds', [{x: run.handles, y: speeds, type: 'scatter', mode: 'lines', line: {color: colour('line'), width: 1.6, simplify: false},
    hovertemplate: say('handle') + ' %{x}: %{y:.6f} m/s<extra></extra>'}],
  layout({xaxis: axis(say('handle_axis'), {range: [0, run.handles.at(-1)]}), dragmode: dragging('zoom'),
    yaxis: axis(say('speed_m_s'), {range: speedRange(speeds)})}), settings());
}

function speedRange(speeds) {
  const low = Math.min(...speeds), high = Math.max(...speeds);
  if (!(low <= high)) return [0, 1];
  const margin = Math.max(0.1 * (high - low), 1e-4);
  return [low - margin, high + margin];
}

/** Draw a frame; while a frame is being drawn, only the newest request waits. */
async function show(frame, t) {
  player.wanted = {frame, t};
  if (player.drawing) return;
  player.drawing = true;
  try {
    while (player.wanted) {
      const now = player.wanted;
      player.wanted = null;
      await draw(now.frame, now.t);
    }
  } finally {
    player.drawing = false;
  }
}

/** Whether a plot has been drawn, so that it can be changed. */
const built = (id) => Boolean(element(id)._fullLayout);

async function draw(frame, t) {
  player.frame = frame;
  const exact = contact && t === contact.t_s, scene = sceneData(frame), speeds = run.speeds ? speedData(frame) : null;
  element('time').textContent = `${t.toFixed(exact ? 6 : 2)} s`;
  element('scrub').value = player.tick;
  if (player.following && built('scene')) await lookAt(headOf(frame));
  if (!run.drawn) { drawMany(frame); countFrames(); } else if (built('scene')) {
    await inTurn(() => Plotly.animate('scene', {data: scene, traces: [1, 2, 3]}, AT_ONCE));
  }
  if (curve && built('clearance')) {
    await Plotly.animate('clearance', {data: [{x: [t, t], y: [player.low, player.high]}], traces: [2]}, AT_ONCE);
  }
  if (speeds && built('speeds')) await drawSpeedsNow(speeds);
}

/** Count frames, and show their rate once per second. */
function countFrames() {
  const now = performance.now();
  if (!player.since || now - player.since > 3000) [player.since, player.count] = [now, 0];
  player.count += 1;
  if (now - player.since > 1000) {
    player.rate = 1000 * (player.count - 1) / (now - player.since);
    [player.since, player.count] = [now, 1];
    sayScale();
  }
}

async function drawSpeedsNow(speeds) {
  const [low, high] = speedRange(speeds);
  const [bottom, top] = element('speeds').layout.yaxis.range;
  if (low < bottom || high > top || top - bottom > 3 * (high - low)) await Plotly.relayout('speeds', {'yaxis.range': [low, high]});
  await Plotly.animate('speeds', {data: [{y: speeds}], traces: [0]}, AT_ONCE);
}

// ---- playing

async function goTo(tick) {
  player.tick = Math.max(0, Math.min(run.times_s.length - 1, tick));
  player.t = run.times_s[player.tick];
  const wanted = player.tick;
  if (!frameOf(wanted)) await chunk(Math.floor(wanted / run.frames_each)).ready;
  const frame = frameOf(wanted);
  if (frame && wanted === player.tick) await show(frame, run.times_s[wanted]);
}

const seek = (t) => goTo(tickAt(t));

function step(now) {
  if (!player.playing) return;
  const passed = Math.min(0.25, (now - player.last) / 1000);
  player.last = now;
  const t = player.t + passed * player.pace;
  const tick = tickAt(t);
  const frame = frameOf(tick);
  if (frame) {          // playing pauses until the chunk has arrived
    player.t = t;
    if (tick !== player.tick) { player.tick = tick; show(frame, run.times_s[tick]); }
    if (tick === run.times_s.length - 1) pause();
  }
  requestAnimationFrame(step);
}

function play() {
  if (player.tick === run.times_s.length - 1) { player.tick = 0; player.t = run.times_s[0]; }
  player.playing = true;
  player.last = performance.now();
  element('play').textContent = say('pause');
  requestAnimationFrame(step);
}

function pause() {
  player.playing = false;
  element('play').textContent = say('play');
}

async function zoomToContact() {
  pause();
  await follow(false);
  player.whole = false;
  const [x, y] = contact.point_m, reach = 0.65 * run.length_m;
  player.tick = tickAt(contact.t_s);
  player.t = run.times_s[player.tick];
  await inTurn(() => Plotly.relayout('scene', {'xaxis.range': [x - reach, x + reach], 'yaxis.range': [y - reach, y + reach]}));
  const bytes = await (await get('frames/contact')).arrayBuffer();
  await show(new Float32Array(bytes), contact.t_s);
}

/** Go to the moment in the address, which is #contact or a time such as #t=410. */
async function goToHash() {
  const t = parseFloat(location.hash.replace('#t=', ''));
  if (location.hash === '#contact' && contact) await zoomToContact();
  else if (Number.isFinite(t)) await seek(t);
  else if (!document.body.dataset.ready) await goTo(player.tick);
}

// ---- the page

function complain(error) {
  if (error.name === 'AbortError') return;      // another run has been requested
  element('note').textContent = `${error.message || error}; ${say('server')}`;
}

function connect() {
  const toggle = () => { if (run) (player.playing ? pause() : play()); };      // nothing can be played before the run is known
  const closer = (ratio) => { if (built('scene')) zoom(ratio); };
  const by = (ticks) => to(player.tick + ticks);
  const to = (tick) => { if (!run) return; pause(); goTo(tick).catch(complain); };
  element('play').addEventListener('click', toggle);
  element('back').addEventListener('click', () => by(-1));
  element('forward').addEventListener('click', () => by(1));
  element('scrub').addEventListener('input', (event) => to(Number(event.target.value)));
  element('pace').addEventListener('change', (event) => { player.pace = Number(event.target.value); });
  element('whole').addEventListener('click', async () => { if (!built('scene')) return; await follow(false); await lookAtWhole(); });
  element('follow').addEventListener('click', () => follow(!player.following).catch(complain));
  pinch(element('scene'));
  element('contact').addEventListener('click', () => zoomToContact().catch(complain));
  document.addEventListener('keydown', (event) => {
    const action = {' ': toggle, ArrowLeft: () => by(-1), ArrowRight: () => by(1), Home: () => to(0), End: () => to(run ? run.times_s.length - 1 : 0),
      f: () => follow(!player.following), g: otherDrawing, '+': () => closer(1 / CLOSER), '=': () => closer(1 / CLOSER), '-': () => closer(CLOSER)}[event.key];
    const own = {INPUT: event.key !== ' ', SELECT: true, BUTTON: event.key === ' '}[event.target.tagName];    // keys of the element
    if (action && !own && !event.ctrlKey && !event.altKey && !event.metaKey) { event.preventDefault(); action(); }
  });
}

function describe() {
  const [first, last] = [run.times_s[0], run.times_s.at(-1)];
  document.title = `${run.name}: dragon_ros`;
  element('name').textContent = run.name;
  element('facts').textContent = say(run.benches === 1 ? 'facts_one' : 'facts',
    {benches: run.benches, first: first.toFixed(2), last: last.toFixed(2)});
  element('note').textContent = run.note;
  element('speeds-title').textContent = say(run.speeds ? 'speeds' : 'no_speeds');
  element('gap-title').textContent = say(run.obstacles ? 'smallest_gap_obstacles' : 'smallest_gap');
  element('scrub').max = run.times_s.length - 1;
}

function offerPaces() {
  player.pace = run.pace || 1;
  const paces = [...new Set([...PACES, player.pace])].sort((a, b) => a - b);
  for (const pace of paces) element('pace').add(new Option(`${pace}×`, pace, pace === player.pace, pace === player.pace));
}

function wordsOfContact() {
  const {benches: [first, second], obstacle} = contact;
  return say(obstacle === null ? 'touch' : 'touch_obstacle', {first, second, obstacle, t: contact.t_s.toFixed(6)});
}

function describeContact() {
  const late = contact && contact.t_s > run.times_s.at(-1) ? say('late') : '';
  element('facts').textContent += (CHINESE ? '；' : '; ') + (contact ? wordsOfContact() + late : say('no_touch'));
  element('contact').hidden = !contact;
}

/** Fit the dragon's axes to their element, which shrinks if the legend above needs another line. */
async function refit() {
  if (!player.frame || !element('scene')._fullLayout) return;
  await inTurn(() => Plotly.Plots.resize('scene'));
  if (player.whole) await lookAtWhole();
  await scaleOutlines();
}

/** Redraw everything after a change of the colours or of the page's width. */
async function redraw() {
  if (!player.frame) return;
  await drawScene(player.frame);
  await drawSpeeds(player.frame);
  if (curve) await drawClearance();
}

/** Fetch and draw a run at the current time or the nearest time of the run. */
async function load() {
  const loaded = await json('run.json');
  chunks.clear();
  [run, contact, curve, player.wanted] = [loaded, null, null, null];
  describe();
  player.t = Math.max(run.times_s[0], Math.min(run.times_s.at(-1), player.t));
  const tick = player.tick = tickAt(player.t);
  await chunk(Math.floor(tick / run.frames_each)).ready;
  player.frame = frameOf(tick);
  player.halves = run.placed ? sizesOf(run.sizes) : null;
  if (canvas) canvas.hidden = !run.placed;
  element('scrub').value = player.tick;
  await drawScene(player.frame);
  await drawSpeeds(player.frame);
  if (player.tick !== tick) await goTo(player.tick);      // a key or a button came meanwhile
  document.body.dataset.drawn = 'yes';
}

async function loadContact() {
  contact = await json('contact.json');
  describeContact();
  await drawScene(player.frame);
  curve = await json('clearance.json');
  await drawClearance();
}

async function start() {
  translate();
  player.t = -Infinity;
  connect();
  await prepare();
  await load();
  offerPaces();
  new ResizeObserver(() => refit().catch(complain)).observe(element('scene'));
  await loadContact();
  await goToHash();
  for (const changed of [DARK, NARROW]) changed.addEventListener('change', () => redraw().catch(complain));
  window.addEventListener('hashchange', () => { pause(); goToHash().catch(complain); });
  if (remembered('follow') === 'yes') await follow(true);
  document.body.dataset.ready = 'yes';
}

document.addEventListener('DOMContentLoaded', () => start().catch((error) => { complain(error); throw error; }));
