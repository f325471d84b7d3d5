// Plays a run: frames come from the server in chunks, plotly.js draws them.
'use strict';

const COLOUR = {body: '#56B4E9', head: '#D55E00', touched: '#E69F00', track: '#999999', line: '#0072B2', quiet: '#555555'};
const AT_ONCE = {mode: 'immediate', transition: {duration: 0}, frame: {duration: 0, redraw: false}};
const SETTINGS = {responsive: true, displaylogo: false, scrollZoom: true, showSendToCloud: false, plotlyServerURL: '',
  modeBarButtonsToRemove: ['select2d', 'lasso2d', 'autoScale2d', 'zoomIn2d', 'zoomOut2d']};
const PACES = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 20, 50];
const MOST_CHUNKS = 24;
const element = (id) => document.getElementById(id);

let run, curve;
const chunks = new Map();
const player = {t: 0, tick: 0, playing: false, pace: 1, last: 0, drawing: false, wanted: null};

/** What the server answers, or what stands in the page itself. */
async function get(path) {
  if (window.EMBEDDED) return new Response(Uint8Array.from(atob(window.EMBEDDED[path]), (letter) => letter.charCodeAt(0)));
  const answer = await fetch(path);
  if (!answer.ok) throw new Error(`${path}: ${answer.status} ${answer.statusText}`);
  return answer;
}

// ---- data

const valuesEach = () => 8 * run.drawn + 2 * run.rest.length + run.handles.length;

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

/** The frame of a tick; null while it is on its way. The next chunk is asked for ahead of time. */
function frameOf(tick) {
  const number = Math.floor(tick / run.frames_each);
  const entry = chunk(number);
  if ((number + 1) * run.frames_each < run.times_s.length) chunk(number + 1);
  if (!entry.values) return null;
  const start = (tick - number * run.frames_each) * valuesEach();
  return entry.values.subarray(start, start + valuesEach());
}

/** The last tick that is not after t. */
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

const touchedBench = () => (run.contact && run.contact.benches[1] < run.drawn ? run.contact.benches[1] : null);

function groups() {
  const touched = touchedBench();
  const body = Array.from({length: run.drawn - 1}, (_, n) => n + 1).filter((bench) => bench !== touched);
  return [body, [0], touched === null || touched === 0 ? [] : [touched]];
}

function sceneData(frame) {
  const rest = {x: [], y: []};
  const from = 8 * run.drawn;
  run.rest.forEach((_, n) => { rest.x.push(frame[from + 2 * n]); rest.y.push(frame[from + 2 * n + 1]); });
  return [...groups().map((benches) => rectangles(frame, benches)), rest];
}

function speedData(frame) {
  return Array.from(frame.subarray(8 * run.drawn + 2 * run.rest.length));
}

function axis(title, more = {}) {
  return {title: {text: title, standoff: 6}, gridcolor: '#E6E6E6', zeroline: false, linecolor: COLOUR.quiet, ticks: 'outside',
    tickcolor: COLOUR.quiet, ...more};
}

function layout(title, more) {
  return {title: {text: title, x: 0, xref: 'paper', xanchor: 'left', font: {size: 14}}, margin: {l: 60, r: 16, t: 36, b: 46},
    font: {family: 'system-ui, sans-serif', size: 12, color: '#222'}, showlegend: false, hovermode: 'closest', ...more};
}

function wholeRange() {
  return {'xaxis.range': [-run.size_m, run.size_m], 'yaxis.range': [-run.size_m, run.size_m]};
}

async function drawScene(frame) {
  const names = ['body', 'head', 'bench that is touched'];
  const fills = [COLOUR.body, COLOUR.head, COLOUR.touched];
  const benches = sceneData(frame).slice(0, 3).map((data, n) => ({...data, type: 'scatter', mode: 'lines', fill: 'toself',
    fillcolor: fills[n], line: {color: '#111', width: 0.8, simplify: false}, name: names[n], hoveron: 'points',
    text: groups()[n].flatMap((bench) => Array(6).fill(`bench ${bench}`)), hovertemplate: '%{text}<br>%{x:.4f}, %{y:.4f} m<extra></extra>',
    showlegend: groups()[n].length > 0}));
  const rest = {...sceneData(frame)[3], type: 'scatter', mode: 'lines', line: {color: COLOUR.body, width: 2, simplify: false},
    hoverinfo: 'skip', showlegend: false};
  const track = {x: run.track ? run.track[0] : [], y: run.track ? run.track[1] : [], type: 'scatter', mode: 'lines', name: 'track',
    line: {color: COLOUR.track, width: 0.8}, hoverinfo: 'skip', showlegend: run.track !== null};
  const contact = {x: run.contact ? [run.contact.point_m[0]] : [], y: run.contact ? [run.contact.point_m[1]] : [],
    type: 'scatter', mode: 'markers', name: 'first contact', showlegend: run.contact !== null,
    marker: {symbol: 'circle-open', size: 15, color: '#000', line: {width: 1.6}}, hovertemplate: 'first contact<br>%{x:.6f}, %{y:.6f} m<extra></extra>'};
  await Plotly.newPlot('scene', [track, ...benches, rest, contact], layout('the dragon from above (drag moves, wheel zooms)', {
    xaxis: axis('x (m)', {range: [-run.size_m, run.size_m], constrain: 'domain'}), dragmode: 'pan', showlegend: true,
    yaxis: axis('y (m)', {range: [-run.size_m, run.size_m], scaleanchor: 'x', constrain: 'domain'}),
    legend: {orientation: 'h', x: 0, y: -0.09, yanchor: 'top'}}), SETTINGS);
}

async function drawClearance() {
  const known = curve.gap_mm.filter((gap) => gap !== null);
  const low = Math.min(0, ...known), high = Math.max(1, ...known);
  const margin = 0.05 * (high - low);
  player.low = low - margin; player.high = high + margin;
  const shapes = low < 0 ? [{type: 'rect', xref: 'paper', x0: 0, x1: 1, y0: player.low, y1: 0, fillcolor: COLOUR.head, opacity: 0.08,
    line: {width: 0}, layer: 'below'}] : [];
  const contact = run.contact ? {x: [run.contact.t_s], y: [0]} : {x: [], y: []};
  await Plotly.newPlot('clearance', [
    {x: curve.t_s, y: curve.gap_mm, type: 'scatter', mode: 'lines', line: {color: COLOUR.line, width: 1.4},
      hovertemplate: '%{x:.2f} s: %{y:.3f} mm<extra></extra>'},
    {...contact, type: 'scatter', mode: 'markers', marker: {color: COLOUR.head, size: 9, line: {color: '#111', width: 0.8}},
      hovertemplate: 'contact at %{x:.6f} s<extra></extra>'},
    {x: [player.t, player.t], y: [player.low, player.high], type: 'scatter', mode: 'lines', line: {color: '#111', width: 1}, hoverinfo: 'skip'},
  ], layout('smallest gap of all benches (click: go there)', {shapes, xaxis: axis('time (s)', {range: [curve.t_s[0], curve.t_s.at(-1)]}),
    yaxis: axis('clearance (mm)', {range: [player.low, player.high]}), dragmode: 'zoom', margin: {l: 82, r: 16, t: 36, b: 46}}), SETTINGS);
  element('clearance').on('plotly_click', (event) => { pause(); seek(event.points[0].x); });
}

async function drawSpeeds(frame) {
  const speeds = run.speeds ? speedData(frame) : [];
  await Plotly.newPlot('speeds', [{x: run.handles, y: speeds, type: 'scatter', mode: 'lines', line: {color: COLOUR.line, width: 1.6, simplify: false},
    hovertemplate: 'handle %{x}: %{y:.6f} m/s<extra></extra>'}],
  layout(run.speeds ? 'speed along the chain, from head to tail' : 'this bag has no velocities', {
    xaxis: axis('handle', {range: [0, run.handles.at(-1)]}), yaxis: axis('speed (m/s)', {range: speedRange(speeds)}), margin: {l: 82, r: 16, t: 36, b: 46}}), SETTINGS);
}

function speedRange(speeds) {
  const low = Math.min(...speeds), high = Math.max(...speeds);
  if (!(low <= high)) return [0, 1];
  const margin = Math.max(0.1 * (high - low), 1e-4);
  return [low - margin, high + margin];
}

/** Draw a frame; while one is being drawn only the newest request waits. */
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

async function draw(frame, t) {
  const exact = run.contact && t === run.contact.t_s;
  element('time').textContent = `${t.toFixed(exact ? 6 : 2)} s`;
  element('scrub').value = player.tick;
  await Plotly.animate('scene', {data: sceneData(frame), traces: [1, 2, 3, 4]}, AT_ONCE);
  await Plotly.animate('clearance', {data: [{x: [t, t], y: [player.low, player.high]}], traces: [2]}, AT_ONCE);
  if (run.speeds) await drawSpeedsNow(speedData(frame));
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
  if (frame) {          // while a chunk is on its way, time stands still
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
  element('play').textContent = 'Pause';
  requestAnimationFrame(step);
}

function pause() {
  player.playing = false;
  element('play').textContent = 'Play';
}

async function zoomToContact() {
  pause();
  const [x, y] = run.contact.point_m, reach = 0.65 * run.length_m;
  player.tick = tickAt(run.contact.t_s);
  player.t = run.times_s[player.tick];
  await Plotly.relayout('scene', {'xaxis.range': [x - reach, x + reach], 'yaxis.range': [y - reach, y + reach]});
  const bytes = await (await get('frames/contact')).arrayBuffer();
  await show(new Float32Array(bytes), run.contact.t_s);
}

/** Go where the address says: #contact, or a time as in #t=410. */
async function goToHash() {
  const t = parseFloat(location.hash.replace('#t=', ''));
  if (location.hash === '#contact' && run.contact) await zoomToContact();
  else if (Number.isFinite(t)) await seek(t);
  else if (!document.body.dataset.ready) await goTo(0);
}

// ---- the page

function complain(error) {
  element('note').textContent = `${error.message || error}; is the server still running?`;
}

function connect() {
  const toggle = () => (player.playing ? pause() : play());
  const by = (ticks) => { pause(); goTo(player.tick + ticks); };
  element('play').addEventListener('click', toggle);
  element('back').addEventListener('click', () => by(-1));
  element('forward').addEventListener('click', () => by(1));
  element('scrub').addEventListener('input', (event) => { pause(); goTo(Number(event.target.value)); });
  element('pace').addEventListener('change', (event) => { player.pace = Number(event.target.value); });
  element('whole').addEventListener('click', () => Plotly.relayout('scene', wholeRange()));
  element('contact').addEventListener('click', () => zoomToContact().catch(complain));
  document.addEventListener('keydown', (event) => {
    if (['INPUT', 'SELECT', 'BUTTON'].includes(event.target.tagName)) return;
    const action = {' ': toggle, ArrowLeft: () => by(-1), ArrowRight: () => by(1)}[event.key];
    if (action) { event.preventDefault(); action(); }
  });
}

function describe() {
  const [first, last] = [run.times_s[0], run.times_s.at(-1)];
  document.title = `${run.name}: dragon_ros`;
  element('name').textContent = run.name;
  const contact = run.contact ? `benches ${run.contact.benches.join(' and ')} touch at ${run.contact.t_s.toFixed(6)} s` : 'no benches touch';
  element('facts').textContent = `${run.benches} benches, ${first.toFixed(2)} to ${last.toFixed(2)} s; ${contact}`;
  element('note').textContent = run.note;
  element('contact').hidden = !run.contact;
  element('scrub').max = run.times_s.length - 1;
  player.pace = run.pace || 1;
  const paces = [...new Set([...PACES, player.pace])].sort((a, b) => a - b);
  for (const pace of paces) element('pace').add(new Option(`${pace}×`, pace, pace === player.pace, pace === player.pace));
}

async function start() {
  run = await (await get('run.json')).json();
  describe();
  player.t = run.times_s[0];
  await chunk(0).ready;
  const frame = frameOf(0);
  await drawScene(frame);
  await drawSpeeds(frame);
  curve = await (await get('clearance.json')).json();
  await drawClearance();
  await goToHash();
  connect();
  window.addEventListener('hashchange', () => { pause(); goToHash().catch(complain); });
  document.body.dataset.ready = 'yes';
}

start().catch((error) => { complain(error); throw error; });
