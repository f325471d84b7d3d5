// Draws a dragon of many benches with WebGL, as benches.js does on a canvas: one upload and one draw call per frame. Six
// vertices of that call form a rectangle, which is a piece of the track, a bench or its outline. Each pixel is shaded
// by the fraction of it that the rectangle covers. Positions are in pixels, computed by the page in double precision.
// (Instances would need only four vertices, but software renderers draw them one by one, a hundred times more slowly.)
'use strict';

const ROW = 1024;           // number of positions per row of a texture
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

const VERTEX = `#version 300 es
precision highp float;
uniform highp sampler2D places;     // positions of handles, followed by those of the track, in pixels
uniform highp sampler2D halves;     // half lengths and half widths of benches, in m
uniform vec2 size;                  // size of the canvas, in pixels
uniform float scale;                // pixels per m
uniform int benches, track;         // number of benches, and number of pieces of the track
uniform float trackWidth, lineWidth, headWidth, outline;    // in pixels; benches are a line if lineWidth is not 0
uniform ivec2 touching;             // benches, or -1
uniform vec3 shades[5];             // colours of the body, the head, benches that touch, outlines and the track
out vec2 at;                        // position along and across the rectangle, from its middle
flat out vec2 reach;                // half its length and half its width
flat out float edge;                // half the width of its outline; 0 to fill it, -1 for a piece of a line
flat out vec3 shade;

vec2 of(highp sampler2D values, int n) { return texelFetch(values, ivec2(n % ${ROW}, n / ${ROW}), 0).xy; }

void main() {
  int rectangle = gl_VertexID / 6, vertex = gl_VertexID % 6;
  int id = rectangle - track, bench = id, first = id;
  float width = 0.0;
  edge = 0.0;
  shade = shades[0];
  bool left_out = false;
  if (id < 0) {
    first = benches + 1 + rectangle;
    width = trackWidth;
    shade = shades[4];
  } else if (lineWidth > 0.0) {
    bool head = id == benches;
    first = head ? 0 : id;
    width = head ? headWidth : lineWidth;
    if (head) shade = shades[1];
  } else {
    int extra = id - 2 * benches;   // the head, followed by touching benches, over the body
    bool outlined = extra < 0 ? id >= benches : extra == 1 || extra > 3;
    bench = extra < 0 ? id % benches : extra < 2 ? 0 : extra % 2 == 0 ? touching.x : touching.y;
    left_out = extra < 0 ? bench == 0 || bench == touching.x || bench == touching.y : bench < 0;
    first = max(bench, 0);
    shade = outlined ? shades[3] : shades[extra < 0 ? 0 : extra < 2 ? 1 : 2];
    edge = outlined ? 0.5 * outline : 0.0;
  }
  vec2 from = of(places, first), to = of(places, first + 1), along = to - from;
  float distance = length(along);
  along = distance > 0.0 ? along / distance : vec2(1.0, 0.0);
  if (width > 0.0) {
    edge = -1.0;
    reach = 0.5 * vec2(distance, width);
  } else {
    reach = scale * of(halves, first);
  }
  vertex = vertex < 3 ? vertex : vertex - 2;      // two triangles on corners 0 to 3
  vec2 corner = vec2(vertex & 1, vertex >> 1) * 2.0 - 1.0;
  at = corner * (reach + max(edge, 0.0) + 1.0);
  vec2 pixel = 0.5 * (from + to) + at.x * along + at.y * vec2(-along.y, along.x);
  gl_Position = left_out ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(pixel / size * vec2(2.0, -2.0) + vec2(-1.0, 1.0), 0.0, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
in vec2 at;
flat in vec2 reach;
flat in float edge;
flat in vec3 shade;
out vec4 colour;

// The share of a pixel at x that lies between -h and h.
float covered(float x, float h) { return clamp(min(h, x + 0.5) - max(-h, x - 0.5), 0.0, 1.0); }
float inside(vec2 h) { return h.x > 0.0 && h.y > 0.0 ? covered(at.x, h.x) * covered(at.y, h.y) : 0.0; }

void main() {
  // A pixel at the joint of two pieces of a line belongs to the piece beside its middle, so no pixel is counted twice.
  float share = edge < 0.0 ? (at.x >= -reach.x && at.x < reach.x ? covered(at.y, reach.y) : 0.0)
    : edge > 0.0 ? inside(reach + edge) - inside(reach - edge) : inside(reach);
  colour = vec4(shade, 1.0) * share;
}`;

/** Red, green and blue from 0 to 1 of a colour such as #1af or #56B4E9. */
function partsOf(shade) {
  const digits = (shade.length - 1) / 3;
  return [0, 1, 2].map((n) => parseInt(shade.slice(1 + digits * n, 1 + digits * (n + 1)), 16) / (16 ** digits - 1));
}

/** Whether this machine draws with a graphics processor instead of software that emulates a graphics processor. */
function hasProcessor() {
  const gl = document.createElement('canvas').getContext('webgl2', {failIfMajorPerformanceCaveat: true});
  if (!gl) return false;
  const named = gl.getExtension('WEBGL_debug_renderer_info');
  const name = gl.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return !SOFTWARE.test(name);
}

function programOf(gl) {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return gl.getProgramParameter(program, gl.LINK_STATUS) ? program : null;
}

/** A texture of pairs of numbers: `put` uploads the numbers, to a larger texture if they no longer fit. */
function pairsOf(gl, unit) {
  let rows = 0, values = null;
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  return {
    room(count) {
      if (Math.ceil(count / ROW) > rows) {
        rows = Math.ceil(count / ROW);
        values = new Float32Array(2 * ROW * rows);
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG32F, ROW, rows, 0, gl.RG, gl.FLOAT, null);
      }
      return values;
    },
    put() {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, ROW, rows, gl.RG, gl.FLOAT, values);
    },
  };
}

/** A function that draws on a canvas like paintOnCanvas, or null without WebGL 2. */
function webglPainter(surface) {
  const gl = surface.getContext('webgl2', {antialias: false, depth: false});
  const program = gl && programOf(gl);
  if (!program) return null;
  gl.useProgram(program);
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  const places = pairsOf(gl, 0), halvesOnIt = pairsOf(gl, 1), known = {};
  const uniform = (name) => (known[name] ??= gl.getUniformLocation(program, name));
  gl.uniform1i(uniform('places'), 0);
  gl.uniform1i(uniform('halves'), 1);
  let held = null;
  return (scale, track, p, halves, touching, width, line) => {
    const many = halves.length / 2, pieces = track ? track[0].length - 1 : 0;
    const rectangles = !width, [first = -1, second = -1] = touching;
    if (held !== halves) { halvesOnIt.room(many).set(halves); halvesOnIt.put(); held = halves; }
    const values = places.room(many + 1 + pieces + 1);
    for (let n = 0; n < 2 * many + 2; n += 2) {
      values[n] = (p[n] - scale.left) * scale.x;
      values[n + 1] = (scale.top - p[n + 1]) * scale.y;
    }
    for (let n = 0, at = 2 * many + 2; track && n <= pieces; n++) {
      values[at++] = (track[0][n] - scale.left) * scale.x;
      values[at++] = (scale.top - track[1][n]) * scale.y;
    }
    places.put();
    gl.viewport(0, 0, surface.width, surface.height);
    gl.uniform2f(uniform('size'), surface.width, surface.height);
    gl.uniform1i(uniform('benches'), many);
    gl.uniform1i(uniform('track'), pieces);
    gl.uniform2i(uniform('touching'), first, second);
    const numbers = {scale: scale.x, trackWidth: TRACK_PX * scale.ratio, lineWidth: width, outline: line,
      headWidth: Math.max(width, HEAD_PX * scale.ratio)};
    for (const [name, value] of Object.entries(numbers)) gl.uniform1f(uniform(name), value);
    const shades = [COLOUR.body, COLOUR.head, COLOUR.touching, colour('outline'), colour('track')];
    gl.uniform3fv(uniform('shades'), shades.flatMap(partsOf));
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.drawArrays(gl.TRIANGLES, 0, 6 * (pieces + (rectangles ? 2 * many + 6 : many + 1)));
    [cost.calls, cost.drawn] = [1, many];
  };
}
