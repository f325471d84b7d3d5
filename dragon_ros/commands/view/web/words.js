// Every text of the page, in English and in Chinese: in the language of --lang, else in that of the browser.
'use strict';

const WORDS = {
  loading: ['loading', '正在加载'], above: ['The dragon from above', '俯视图'],
  smallest_gap: ['Smallest gap between benches', '板凳间的最小间隙'], clearance_label: ['clearance over time', '间隙随时间的变化'],
  speeds: ['Speed along the chain', '各把手的速度'], no_speeds: ['This bag has no velocities', '此 bag 中没有速度'],
  play: ['Play', '播放'], pause: ['Pause', '暂停'], back: ['−1 tick', '−1 步'], forward: ['+1 tick', '+1 步'],
  space: ['space', '空格键'], left: ['arrow left', '左方向键'], right: ['arrow right', '右方向键'],
  pace: ['speed', '播放速度'], to_contact: ['Zoom to contact', '放大碰撞处'], whole: ['Whole dragon', '整条龙'],
  values: ['values of the scene', '场景的参数'],
  body: ['body', '龙身'], head: ['head', '龙头'], track: ['track', '轨迹'], contact: ['first contact', '首次碰撞'],
  touching: ['benches of the first contact', '首次碰撞的板凳'], touched: ['bench that the head touches', '龙头碰到的板凳'],
  bench: ['bench {bench}', '第 {bench} 号板凳'], handle: ['handle', '把手'],
  contact_at: ['contact at', '碰撞时刻'], time_s: ['time (s)', '时间 (s)'], time: ['time', '时间'],
  clearance_mm: ['clearance (mm)', '间隙 (mm)'], handle_axis: ['handle (0 is the head)', '把手（0 为龙头前把手）'],
  speed_m_s: ['speed (m/s)', '速度 (m/s)'],
  facts: ['{benches} benches, {first} to {last} s', '{benches} 节板凳，{first} 至 {last} s'],
  touch: ['benches {first} and {second} touch at {t} s', '{t} s 时第 {first} 号与第 {second} 号板凳相碰'],
  touch_obstacle: ['bench {first} touches {obstacle} at {t} s', '{t} s 时第 {first} 号板凳碰到 {obstacle}'],
  late: [', after the end of what is shown', '（在所示时间之后）'], no_touch: ['no benches touch', '没有板凳相碰'],
  server: ['is the server still running?', '服务器还在运行吗？'],
  follow: ['Follow head', '跟随龙头'],
  scale: ['a bench is {long} × {wide} pixels here', '此处一节板凳为 {long} × {wide} 像素'],
  by_canvas: ['; {kb} kB and {calls} draw calls a frame on a canvas', '；画布绘制，每帧 {kb} kB、{calls} 次绘制调用'],
  by_webgl: ['; {kb} kB and one draw call a frame by WebGL', '；WebGL 绘制，每帧 {kb} kB、一次绘制调用'],
  rate: [', {rate} frames a second', '，每秒 {rate} 帧'],
  // The values of --try
  what_if: ['What if', '试改参数'], as_it_was: ['As it was', '恢复原值'], working: ['working', '正在计算'], the_end: ['the end', '到结束'],
  slider: ['{key}: the slider goes from {low} to {high}', '{key}：滑块范围 {low} 至 {high}'],
  more: ["{count} more values are in the scene's file", '场景文件中还有 {count} 个参数'],
  ask_contact: ['First contact', '首次碰撞'], ask_speed: ['Fastest handle', '最快的把手'], ask_room: ['Room needed', '所需空间'],
  ask_pitch: ['Smallest pitch', '最小螺距'], ask_clearance: ['Smallest gap', '最小间隙'],
};
const CHINESE = (document.documentElement.dataset.lang || navigator.language).toLowerCase().startsWith('zh');

/** A text of the page in its language, with its values. */
const say = (key, values = {}) => WORDS[key][CHINESE ? 1 : 0].replace(/\{(\w+)\}/g, (_, name) => values[name]);

/** Give the elements of the page their texts: data-say is the content, data-label and data-title are attributes. */
function translate() {
  document.documentElement.lang = CHINESE ? 'zh-CN' : 'en';
  for (const one of document.querySelectorAll('[data-say]')) one.textContent = say(one.dataset.say);
  for (const one of document.querySelectorAll('[data-label]')) one.setAttribute('aria-label', say(one.dataset.label));
  for (const one of document.querySelectorAll('[data-title]')) one.title = say(one.dataset.title);
}
