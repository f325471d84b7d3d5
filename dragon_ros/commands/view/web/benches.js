// Draws the visible part of a dragon of many benches on a canvas over the axes, at the density of the screen. If there
// is a graphics processor, webgl.js draws the same picture. Benches several pixels wide are rectangles. Narrower
// benches are drawn as a line through all handles, as wide as a bench. If several layers share a pixel, their shades
// mix in proportion to area. No line connects one layer with another.
'use strict';

const LEAST_PX = 2.5;       // smallest width of a bench that is drawn as a rectangle
const STEP_PX = 0.5;        // a line omits handles that are closer than this to the last handle drawn
const EACH = 400;           // number of benches that are filled, or of a line's steps that are stroked, at once
const TRACK_PX = 0.8, HEAD_PX = 2;      // width of the track, and smallest width of the head

const cost = {calls: 0, drawn: 0, webgl: false};
let canvas = null, paint = null;        // the surface, and the function that draws on it

/** Draw on a new canvas, by WebGL if WebGL is wanted and available, otherwise by the processor. */
function drawBy(webgl) {
  canvas?.remove();
  canvas = document.createElement('canvas');
  canvas.id = 'benches';
  paint = webgl ? webglPainter(canvas) : null;
  cost.webgl = paint !== null;
  if (webgl && !paint) { drawBy(false); return; }
  paint ??= paintOnCanvas;
  const mine = canvas;
  canvas.addEventListener('webglcontextlost', () => {
    if (canvas === mine) { drawBy(false); drawMany(player.frame); sayScale(); }
  });
}

/** Half lengths and half widths of all benches, from groups of consecutive equal benches. */
function sizesOf(runs) {
  const total = runs.reduce((sum, [count]) => sum + count, 0), halves = new Float32Array(2 * total);
  let at = 0;
  for (const [count, length, width] of runs) for (let n = 0; n < count; n++) { halves[at++] = length; halves[at++] = width; }
  return halves;
}

/** The corners in m of bench n, whose handles are at p[2n], p[2n + 1] and p[2n + 2], p[2n + 3]. */
function cornersOf(p, halves, bench) {
  const [x, y, u, v] = p.subarray(2 * bench, 2 * bench + 4), long = Math.hypot(u - x, v - y) || 1;
  const [a, b] = [(x - u) / long, (y - v) / long], [l, w] = [halves[2 * bench], halves[2 * bench + 1]];
  const [cx, cy] = [0.5 * (x + u), 0.5 * (y + v)];
  return [cx + a * l - b * w, cy + b * l + a * w, cx - a * l - b * w, cy - b * l + a * w,
    cx - a * l + b * w, cy - b * l - a * w, cx + a * l + b * w, cy + b * l - a * w];
}

/** The map from metres to pixels of the canvas, which covers the axes and has their size. */
function scaleOf(plot) {
  const {xaxis, yaxis} = plot._fullLayout, ratio = window.devicePixelRatio || 1;
  if (canvas.parentNode !== plot.parentNode) plot.parentNode.append(canvas);
  const [width, height] = [Math.round(xaxis._length * ratio), Math.round(yaxis._length * ratio)];
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  Object.assign(canvas.style, {left: `${plot.offsetLeft + xaxis._offset}px`, top: `${plot.offsetTop + yaxis._offset}px`,
    width: `${xaxis._length}px`, height: `${yaxis._length}px`});
  const [[left, right], [bottom, top]] = [xaxis.range, yaxis.range];
  return {left, top, right, bottom, x: width / (right - left), y: height / (top - bottom), ratio};
}

/** Draw a line of a given width in pixels, without points that are out of view or on the last drawn pixel. */
function strokeLine(context, scale, count, xOf, yOf, shade, width) {
  const margin = width + 2, [wide, high] = [canvas.width, canvas.height];
  const toX = (n) => (xOf(n) - scale.left) * scale.x, toY = (n) => (scale.top - yOf(n)) * scale.y;
  Object.assign(context, {strokeStyle: shade, lineWidth: width, lineCap: 'butt', lineJoin: 'bevel'});
  context.beginPath();
  let lastX = toX(0), lastY = toY(0), open = 0, pen = false;      // whether the path ends at the last point
  for (let n = 1; n < count; n++) {
    const x = toX(n), y = toY(n);
    if (n < count - 1 && Math.abs(x - lastX) < STEP_PX && Math.abs(y - lastY) < STEP_PX) continue;
    const seen = Math.min(x, lastX) < wide + margin && Math.max(x, lastX) > -margin &&
      Math.min(y, lastY) < high + margin && Math.max(y, lastY) > -margin;
    if (seen && !pen) context.moveTo(lastX, lastY);
    if (seen) { context.lineTo(x, y); open += 1; }
    if (open === EACH) {        // many short paths are filled faster than one long path
      context.stroke();
      context.beginPath();
      context.moveTo(x, y);
      cost.calls += 1;
      open = 0;
    }
    [lastX, lastY, pen] = [x, y, seen];
  }
  context.stroke();
  cost.calls += 1;
}

/** Fill benches in view as rectangles. */
function fillBenches(context, scale, p, halves, benches, shade, line) {
  const {left, right, bottom, top} = scale;
  Object.assign(context, {fillStyle: shade, strokeStyle: colour('outline'), lineWidth: line});
  let open = 0;
  const flush = () => {
    if (!open) return;
    context.fill();
    context.stroke();
    cost.calls += 2;
    open = 0;
  };
  for (const bench of benches) {
    const x = p[2 * bench], y = p[2 * bench + 1], reach = 2 * halves[2 * bench];
    if (x < left - reach || x > right + reach || y < bottom - reach || y > top + reach) continue;
    if (!open) context.beginPath();
    const at = cornersOf(p, halves, bench);
    for (let corner = 0; corner < 8; corner += 2) {
      context[corner ? 'lineTo' : 'moveTo']((at[corner] - left) * scale.x, (top - at[corner + 1]) * scale.y);
    }
    context.closePath();
    cost.drawn += 1;
    if (++open === EACH) flush();
  }
  flush();
}

/** Draw the track and the dragon on the canvas by the processor. */
function paintOnCanvas(scale, track, p, halves, touching, width, line) {
  const context = canvas.getContext('2d'), many = halves.length / 2;
  [cost.calls, cost.drawn] = [0, 0];
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (track) strokeLine(context, scale, track[0].length, (n) => track[0][n], (n) => track[1][n], colour('track'), TRACK_PX * scale.ratio);
  if (width) {
    strokeLine(context, scale, many + 1, (n) => p[2 * n], (n) => p[2 * n + 1], COLOUR.body, width);
    strokeLine(context, scale, 2, (n) => p[2 * n], (n) => p[2 * n + 1], COLOUR.head, Math.max(width, HEAD_PX * scale.ratio));
    cost.drawn = many;
    return;
  }
  const others = function* () { for (let bench = 1; bench < many; bench++) if (!touching.includes(bench)) yield bench; };
  fillBenches(context, scale, p, halves, others(), COLOUR.body, line);
  fillBenches(context, scale, p, halves, [0], COLOUR.head, line);
  fillBenches(context, scale, p, halves, touching, COLOUR.touching, line);
}

/** Draw the track and the dragon; `touching` lists the benches of the first contact, but the head keeps its colour. */
function drawBenches(plot, track, p, halves, touching) {
  if (!paint) drawBy(hasProcessor());
  const scale = scaleOf(plot), width = 2 * halves[1] * scale.x;
  paint(scale, track, p, halves, touching, width < LEAST_PX * scale.ratio ? width : 0,
    Math.min(2.5 * scale.ratio, OUTLINE * width));
}
