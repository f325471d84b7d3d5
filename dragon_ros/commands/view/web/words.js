// All text on the page, in English and Chinese; --lang or, by default, the browser selects the language.
'use strict';

const WORDS = {
  loading: ['loading', '正在加载'], above: ['The dragon from above', '俯视图'],
  smallest_gap: ['Smallest gap between benches', '板凳间的最小间隙'],
  smallest_gap_obstacles: ['Smallest gap between benches or to obstacles', '板凳间及板凳与障碍物间的最小间隙'], clearance_label: ['clearance over time', '间隙随时间的变化'],
  speeds: ['Speed along the chain', '各把手的速度'], no_speeds: ['This bag has no velocities', '此 bag 中没有速度'],
  play: ['Play', '播放'], pause: ['Pause', '暂停'], back: ['−1 tick', '−1 步'], forward: ['+1 tick', '+1 步'],
  space: ['space', '空格键'], left: ['arrow left', '左方向键'], right: ['arrow right', '右方向键'],
  pace: ['speed', '播放速度'], to_contact: ['Zoom to contact', '放大碰撞处'], whole: ['Whole dragon', '整条龙'],
  values: ['values of the scene', '场景的参数'],
  body: ['body', '龙身'], head: ['head', '龙头'], track: ['track', '轨迹'], walls: ['obstacles', '障碍物'], contact: ['first contact', '首次碰撞'],
  touching: ['benches of the first contact', '首次碰撞的板凳'], touched: ['bench that the head touches', '龙头碰到的板凳'],
  bench: ['bench {bench}', '第 {bench} 号板凳'], handle: ['handle', '把手'],
  contact_at: ['contact at', '碰撞时刻'], time_s: ['time (s)', '时间 (s)'], time: ['time', '时间'],
  clearance_mm: ['clearance (mm)', '间隙 (mm)'], handle_axis: ['handle (0 is the head)', '把手（0 为龙头前把手）'],
  speed_m_s: ['speed (m/s)', '速度 (m/s)'],
  facts: ['{benches} benches, {first} to {last} s', '{benches} 节板凳，{first} 至 {last} s'],
  facts_one: ['one bench, {first} to {last} s', '一节板凳，{first} 至 {last} s'],
  touch: ['benches {first} and {second} touch at {t} s', '{t} s 时第 {first} 号与第 {second} 号板凳相碰'],
  touch_obstacle: ['bench {first} touches {obstacle} at {t} s', '{t} s 时第 {first} 号板凳碰到 {obstacle}'],
  late: [', after the end of the period shown', '（在所示时间之后）'], no_touch: ['no contact', '没有碰撞'],
  server: ['is the server still running?', '服务器还在运行吗？'],
  follow: ['Follow head', '跟随龙头'],
  scale: ['one bench: {long} × {wide} pixels', '一节板凳：{long} × {wide} 像素'],
  by_canvas: ['; {kb} kB and {calls} draw calls per frame on a canvas', '；画布绘制，每帧 {kb} kB、{calls} 次绘制调用'],
  by_webgl: ['; {kb} kB and one draw call per frame with WebGL', '；WebGL 绘制，每帧 {kb} kB、一次绘制调用'],
  rate: [', {rate} frames per second', '，每秒 {rate} 帧'],
  // The values of --try
  what_if: ['What if', '试改参数'], as_it_was: ['Reset values', '恢复原值'], working: ['working', '正在计算'], the_end: ['the end', '到结束'],
  slider: ['{key}: the slider goes from {low} to {high}', '{key}：滑块范围 {low} 至 {high}'],
  more: ["further values in the scene's file: {count}", '场景文件中还有 {count} 个参数'],
  ask_contact: ['First contact', '首次碰撞'], ask_speed: ['Fastest handle', '最快的把手'], ask_room: ['Room required', '所需空间'],
  ask_pitch: ['Smallest pitch', '最小螺距'], ask_clearance: ['Smallest gap', '最小间隙'],
  no_contact: ['no contact in this run, which ends at {end} s', '本次运行到 {end} s 结束，没有碰撞'],
  meet: ['{t} s, benches {first} and {second}', '{t} s，第 {first} 号与第 {second} 号板凳'],
  graze: ['grazing, {t} s, benches {first} and {second}', '擦碰，{t} s，第 {first} 号与第 {second} 号板凳'],
  meet_obstacle: ['{t} s, bench {first} and obstacle {obstacle}', '{t} s，第 {first} 号板凳与障碍物 {obstacle}'],
  graze_obstacle: ['grazing, {t} s, bench {first} and obstacle {obstacle}', '擦碰，{t} s，第 {first} 号板凳与障碍物 {obstacle}'],
  no_gap: ['no two benches come near each other', '没有两节板凳彼此靠近'],
  least_gap: ['{gap} mm at {t} s, the smallest of {times} samples', '{t} s 时为 {gap} mm（取自 {times} 个时刻）'],
  none_faster: ['no handle is faster than the leader', '没有比领头把手更快的把手'],
  fastest: ['handle {handle}: {ratio} times as fast as the leader, with the leader {along} m along the track', '第 {handle} 号把手：为领头把手速度的 {ratio} 倍，此时领头把手位于轨迹 {along} m 处'],
  least_pitch: ['{pitch} m: no contact on the way in to a circle {circle} m in diameter; just below, benches overlap', '{pitch} m：盘入直径 {circle} m 的圆时没有碰撞，再略小则有板凳重叠'],
  no_spiral: ['only for a track that is a single spiral', '仅适用于单条螺线的轨迹'],
  gap_to: ['smallest gap {gap} m, to {name}; required {wanted} m', '最小间隙 {gap} m（到 {name}）；要求 {wanted} m'],
  touches: ['a bench touches {name}', '有板凳碰到{name}'],
  square: ['a square of {free} m, or of {centred} m about the origin', '边长 {free} m 的正方形；以原点为中心则为 {centred} m'],
  until_contact: ['; up to the contact', '；到碰撞为止'], refused: ['{text}', '无法计算：{text}'],
  proved: ['proved', '已证明'], sampled: ['sampled', '抽样'],
};
// Chinese names of values and of their sections. The English names are the words in the keys.
const NAMES = {
  dragon: '板凳龙', track: '轨迹', head: '龙头', run: '运行', venue: '场地', piece: '段', group: '组', benches: '板凳节数',
  count: '节数', head_length: '龙头长度', body_length: '龙身长度', width: '宽度', hole_inset: '孔距板端', length: '长度',
  pitch: '螺距', start_turns: '起始圈数', from_turns: '起始圈数', to_turns: '终止圈数', diameter: '直径', ratio: '两弧半径之比',
  before: '调头前的距离', speed: '速度', radius: '半径', angle: '角度', margin: '要求的间隙', start: '起点', stop: '终点',
  max_acceleration: '最大加速度', max_speed: '最大速度', timeout: '超时',
};
const CHINESE = (document.documentElement.dataset.lang || navigator.language).toLowerCase().startsWith('zh');

/** Return a message in the page's language, with its values inserted. */
const say = (key, values = {}) => WORDS[key][CHINESE ? 1 : 0].replace(/\{(\w+)\}/g, (_, name) => values[name]);

/** Set the texts of the page's elements: data-say is the content, and data-label and data-title are attributes. */
function translate() {
  document.documentElement.lang = CHINESE ? 'zh-CN' : 'en';
  for (const one of document.querySelectorAll('[data-say]')) one.textContent = say(one.dataset.say);
  for (const one of document.querySelectorAll('[data-label]')) one.setAttribute('aria-label', say(one.dataset.label));
  for (const one of document.querySelectorAll('[data-title]')) one.title = say(one.dataset.title);
}
