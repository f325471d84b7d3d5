"""All sentences in the output of ``grade``, in English and Chinese; the Chinese sentences use the contest's terms.

Each sentence has the same parameters in both languages, and no key is missing (``test/commands/test_grade_words.py``).
"""
from collections.abc import Mapping

from dragon_ros.cli.language import Words, say

# key: (English, Chinese)
WORDS: Words = {
    # Reproduced mistakes
    'none': ('none', '无'),
    'radial_arc': ('S = rho theta / 2 for the arc length, without its radial part', '弧长取 S = ρθ/2，漏掉径向分量'),
    'bracket_slip': ('ln(theta + sqrt(theta^2) + 1) instead of asinh(theta) at the start: a bracket in the wrong place',
                     '起点处把 asinh(θ) 写成 ln(θ + sqrt(θ²) + 1)：括号放错位置'),
    'bracket_slip_short': ('ln(theta + sqrt(theta^2) + 1) instead of asinh(theta) at the start',
                           '起点处把 asinh(θ) 写成 ln(θ + sqrt(θ²) + 1)'),
    'euler': ('Euler steps of {step:g} s for the head', '龙头前把手用步长 {step:g} s 的欧拉法'),
    'euler_radial': ('Euler steps of {step:g} s without the radial part',
                     '龙头前把手用步长 {step:g} s 的欧拉法，且漏掉径向分量'),
    'along': ('links measured along the spiral, not as chords', '把手间距按螺线弧长计算，而不是按弦长'),
    'chord_short': ('the first angle whose chord is within {short:g} m of the link',
                    '弦长容差 {short:g} m：取弦长与孔距之差首次小于它的角度'),
    'chord_long': ('chords that are {long:g} m too long', '弦长偏大 {long:g} m'),
    'paper_grid': ("the paper's grid: steps of 0.01 rad until the chord is within 0.1 m",
                   '论文的网格：以 0.01 rad 为步长，直到弦长误差小于 0.1 m'),
    'paper': ("the paper's own values", '论文自身的数值'),
    'grid': ('steps of {step:g} rad until the chord is within {within:g} m of the link',
             '以 {step:g} rad 为步长逐步试角度，直到弦长误差小于 {within:g} m'),
    'grid_past': ('steps of {step:g} rad until the chord is at least as long as the link, to within {within:g} m',
                  '以 {step:g} rad 为步长逐步试角度，直到弦长不小于孔距（误差 {within:g} m）'),
    'tolerance': ('chords differ from their links by {low:.3g} to {high:.3g} m: a tolerance or a step is too large',
                  '弦长与孔距相差 {low:.3g} 至 {high:.3g} m：容差或步长过大'),
    'body_link_for_head': ("the body's link of 1.65 m is also used for the head", '龙头也用了龙身的孔距 1.65 m'),
    'head_link_for_body': ("the head's link of 2.86 m is also used for the body", '龙身也用了龙头的孔距 2.86 m'),
    'whole_benches': ('links as long as the benches (3.41 m and 2.20 m) instead of the distance between holes',
                      '把手间距取板长（3.41 m 与 2.20 m），而不是孔距'),
    'one_hole': ('links too long by one hole inset of 0.275 m (3.135 m and 1.925 m)',
                 '孔距只减去一端的 0.275 m（3.135 m 与 1.925 m）'),
    'swapped_links': ('the links of head and body are swapped', '龙头与龙身的孔距互换'),
    'last_link': ("the head's link of 2.86 m is used for the last bench", '最后一节板凳用了龙头的孔距 2.86 m'),
    'links': ('links of {head:.6g} m for the head and {body:.6g} m for the body',
              '孔距：龙头 {head:.6g} m，龙身 {body:.6g} m'),
    'links_in_part': ('{share:.1%} of the links are right; the others differ by {low:.3g} to {high:.3g} m',
                      '{share:.1%} 的孔距正确，其余相差 {low:.3g} 至 {high:.3g} m'),
    'start_turns': ('the head starts at turn {turns:g}, not 16', '龙头从第 {turns:g} 圈出发，而不是第 16 圈'),
    'time_shift': ('times are shifted by {shift:.6g} s', '时间平移 {shift:.6g} s'),
    'speed': ('the head moves at {speed:.6g} m/s', '龙头速度为 {speed:.6g} m/s'),
    'outward': ('the head winds out, not in', '龙头盘出，而不是盘入'),
    'pitch': ('a pitch of {pitch:.6g} m', '螺距取 {pitch:.6g} m'),
    'turn_shift': ('times are shifted by {shift:.6g} s', '时间平移 {shift:.6g} s'),
    'turn_speed': ('the head moves at {speed:.6g} m/s', '龙头速度为 {speed:.6g} m/s'),
    'turn_ratio': ('a turn whose first arc has {ratio:.6g} times the radius of the second, not twice that radius',
                   '调头曲线前一段圆弧半径是后一段的 {ratio:.6g} 倍，而不是 2 倍'),
    'turn_diameter': ('a turning circle {diameter:.6g} m in diameter, not 9 m',
                      '调头空间直径取 {diameter:.6g} m，而不是 9 m'),
    'turn_both': ('a turning circle {diameter:.6g} m in diameter, not 9 m, and a first arc with {ratio:.6g} times '
                  'the radius of the second',
                  '调头空间直径取 {diameter:.6g} m，前一段圆弧半径是后一段的 {ratio:.6g} 倍'),
    'circle_before': ('up to the turn, the head moves towards a circle {diameter:.6g} m in diameter, not 9 m; '
                      'the rest is unexplained',
                      '调头前龙头驶向直径 {diameter:.6g} m 的调头空间，而不是 9 m；其后不明'),
    'turn_along': ('links measured along the curve, not as chords', '把手间距按曲线弧长计算，而不是按弦长'),
    'turn_grid': ('steps of {step:g} m along the curve until the chord is within {within:g} m of the link',
                  '沿曲线以 {step:g} m 为步长逐步试探，直到弦长误差小于 {within:g} m'),
    'turn_grid_past': ('steps of {step:g} m along the curve until the chord is at least as long as the link, to '
                       'within {within:g} m',
                       '沿曲线以 {step:g} m 为步长逐步试探，直到弦长不小于孔距（误差 {within:g} m）'),
    'turn_pitch': ('a pitch of {pitch:.6g} m, not 1.7 m', '螺距取 {pitch:.6g} m，而不是 1.7 m'),
    'all_one': ('all speeds are 1 m/s', '所有速度都取 1 m/s'),
    'differences': ('{kind} differences of positions over {step:g} s', '速度用位置差分（{kind}，步长 {step:g} s）'),
    'speeds_of_given': ('consistent with the given positions', '与所给位置一致'),
    'inverted': ('the ratio of the cosines is inverted', '速度投影的余弦比写反'),
    'power_law': ("the paper's power law, (rho / rho')^0.02", '论文的幂律 (ρ/ρ′)^0.02'),
    'rigid_turn': ('one angular speed for all handles', '所有把手取同一角速度'),
    # Contact, pitch, turn, speed
    'moment': ('this is the state at {t:.6f} s', '这是 {t:.6f} s 时的状态'),
    'moment_of_links': ('this is the state at {t:.6f} s, when benches with these links touch',
                        '这是 {t:.6f} s 时的状态，即按上述孔距首次碰撞的时刻'),
    'looked': ('positions are checked every {step:g} s', '每隔 {step:g} s 检查一次位置'),
    'looked_before': ('the last multiple of {step:g} s before the contact', '碰撞前的最后一个 {step:g} s 整步'),
    'near_counts': ('a gap below {near_mm:g} mm counts as contact', '间隙小于 {near_mm:g} mm 即视为碰撞'),
    'paper_contact': ("the paper's own answer", '论文自身的答案'),
    'on_circle': ('only the state on the circle is checked', '只检查龙头到达调头空间边界时的状态'),
    'front_corners': ("only the head's front corners are checked", '只检查龙头板凳的前端两角'),
    'pitch_looked': ('positions are checked every {step:g} s, and pitches every 0.00001 m',
                     '每隔 {step:g} s 检查一次位置，螺距步长 0.00001 m'),
    'half_turns': ('arcs of half a turn, as if the spirals were tangent to the circle',
                   '两段圆弧都取半圆，如同螺线与边界相切'),
    'angle_for_slope': ("the tangent's angle is mistaken for its slope", '把切线的角度当成斜率'),
    'angle_and_radii': ("the tangent's angle is mistaken for its slope, and the radii are taken to add up to 4.5 m",
                        '把切线的角度当成斜率，且认为两半径之和为 4.5 m'),
    'speed_looked': ('speeds are checked every {step:g} s', '每隔 {step:g} s 检查一次速度'),
    # Units, order, axes
    'rounded': ('rounded to {digits} decimals, not six', '保留 {digits} 位小数，而不是 6 位'),
    'few_cells': ('wrong cells: {count}, the first at handle {handle}, {t:g} s',
                  '有 {count} 个单元格不符，首个在第 {handle} 个把手、{t:g} s'),
    'centimetres': ('in centimetres, not metres', '单位是厘米，而不是米'),
    'millimetres': ('in millimetres, not metres', '单位是毫米，而不是米'),
    'kilometres': ('in kilometres, not metres', '单位是千米，而不是米'),
    'negative': ('with the wrong sign', '符号相反'),
    'radians_as_degrees': ('angles in radians used as degrees in cos and sin', 'cos、sin 中把弧度当成度'),
    'degrees_as_radians': ('angles in degrees used as radians in cos and sin', 'cos、sin 中把度当成弧度'),
    'polar': ('polar coordinates (radius, angle in radians) instead of x and y',
              '给出的是极坐标（半径、弧度），而不是 x、y'),
    'polar_degrees': ('polar coordinates (radius, angle in degrees) instead of x and y',
                      '给出的是极坐标（半径、角度），而不是 x、y'),
    'mirrored_x': ('mirrored about the x axis: y has the wrong sign', '关于 x 轴镜像：y 符号相反'),
    'mirrored_y': ('mirrored about the y axis: x has the wrong sign', '关于 y 轴镜像：x 符号相反'),
    'rotated_180': ('rotated by 180 degrees', '旋转了 180°'),
    'rotated_90': ('rotated by 90 degrees', '旋转了 90°'),
    'rotated_270': ('rotated by -90 degrees', '旋转了 -90°'),
    'swapped': ('x and y are swapped', 'x 与 y 互换'),
    'swapped_minus': ('x and y are swapped, both with the wrong sign', 'x 与 y 互换，且符号都相反'),
    'rotated_rigid': ('rotated by {angle:.6g} degrees and shifted by ({dx:.6g}, {dy:.6g}) m',
                      '旋转 {angle:.6g}°，平移 ({dx:.6g}, {dy:.6g}) m'),
    'mirrored_rigid': ('mirrored, rotated by {angle:.6g} degrees and shifted by ({dx:.6g}, {dy:.6g}) m',
                       '镜像后旋转 {angle:.6g}°，平移 ({dx:.6g}, {dy:.6g}) m'),
    'rows_reversed': ('handles in reverse order', '把手顺序颠倒'),
    'handles_shifted': ('rows are shifted: each row contains the handle {by} places further back',
                        '每行错位：实为其后第 {by} 个把手'),
    'rows_mixed': ('rows are not in the order of their names', '行的顺序与名称不符'),
    # Observed facts without an explanation
    'off_track': ('handles are {off:.3g} m off the spiral (root mean square)', '把手偏离螺线 {off:.3g} m（均方根）'),
    'head_unknown': ('the motion of the head fits no known mistake', '龙头前把手的运动不符合任何已知错误'),
    'unknown': ('unknown', '原因不明'),
    'rest': ('the remaining error, up to {worst:.3g} m, is unexplained', '余下误差（至多 {worst:.3g} m）原因不明'),
    # Reading
    'sheet_empty': ('sheet {sheet} is empty', '工作表 {sheet} 为空'),

    'numbers_as_text': ('the numbers in sheet {sheet} are stored as text', '工作表 {sheet} 中的数字以文本存储'),
    'transposed': ('sheet {sheet} is transposed: times are in rows', '工作表 {sheet} 行列互换：时间在行上'),
    'without_labels': ("sheet {sheet} names no handles; its rows are read in the contest's order",
                       '工作表 {sheet} 没有把手名称，按竞赛模板的顺序读取'),
    'not_understood': ('no cell in sheet {sheet} can be assigned to a handle and a quantity',
                       '工作表 {sheet} 中没有可识别的数据'),
    'merged': ('{sheet}: cells {place} are merged among the values; unmerge them',
               '{sheet}：数据区 {place} 有合并单元格，请取消合并'),
    'other_result': ('it is named {named}, but contains {held}', '文件名为 {named}，内容是 {held}'),
    'given_twice': ('{result} is given twice; {name} is ignored', '{result} 重复，忽略 {name}'),
    'no_result': ('it contains no table of handles', '其中没有找到把手数据表'),
    # The report
    'title': ('Grading report: bench dragon (CUMCM 2024 A)', '评分报告：板凳龙（CUMCM 2024 A 题）'),
    'teams': ('Teams', '队伍'),
    'team': ('team', '队伍'),
    'overview': ('Overview', '总览'),
    'back': ('Back to overview', '返回总览'),
    'results': ('Results', '结果'),
    'answers': ('Answers', '答案'),
    'pictures': ('Error along the dragon and over time', '误差：沿龙身与随时间'),
    'result1': ('result1: winding in', 'result1：盘入'),
    'result2': ('result2: first contact', 'result2：碰撞时刻'),
    'result4': ('result4: turning', 'result4：调头'),
    'positions': ('positions', '位置'), 'speeds': ('speeds', '速度'),
    'cells': ('cells compared', '比较的单元格'), 'worst': ('worst error', '最大误差'), 'where': ('where', '位置与时刻'),
    'within': ('within {bound:g}', '误差 ≤ {bound:g}'), 'diagnosis': ('looks like', '疑似原因'),
    'explains': ('explains {share:.2%} of the error', '解释了 {share:.2%} 的误差'),
    'looks_like': ('looks like: {what} ({share})', '疑似：{what}（{share}）'),
    'seen': ('seen: {what}', '可见：{what}'),
    'right': ('right', '正确'),
    'wrong': ('wrong', '错误'),
    'close': ('close', '接近'),
    'missing': ('missing', '缺失'),
    'given': ('given', '所给'), 'truth': ('right answer', '正确答案'), 'error': ('error', '误差'),
    't_s': ('question 2: first contact (s)', '问题 2：碰撞时刻 (s)'),
    'pitch_m': ('question 3: smallest pitch (m)', '问题 3：最小螺距 (m)'),
    'turn_m': ('question 4: length of the turn (m)', '问题 4：调头曲线长度 (m)'),
    'speed_m_s': ('question 5: largest speed of the head (m/s)', '问题 5：龙头最大速度 (m/s)'),
    'short_t_s': ('question 2', '问题 2'),
    'short_pitch_m': ('question 3', '问题 3'),
    'short_turn_m': ('question 4', '问题 4'),
    'short_speed_m_s': ('question 5', '问题 5'),
    'head': ('head, front handle', '龙头前把手'), 'section': ('front handle of section {n}', '第{n}节龙身前把手'),
    'tail': ('tail, front handle', '龙尾前把手'), 'rear': ('tail, rear handle', '龙尾后把手'),
    'at_time': ('{handle}, {t:g} s', '{handle}，{t:g} s'),
    'axis_handle': ('handle', '把手'),
    'axis_time': ('time (s)', '时间 (s)'),
    'axis_error': ('worst error (m)', '最大误差 (m)'),
    'axis_error_speed': ('worst error (m/s)', '最大误差 (m/s)'),
    'made_by': ('dragon_ros {version}. A result is right if its errors are within 2e-6 (six decimals). '
                'Times are in s, and lengths are in m.',
                'dragon_ros {version}。误差不超过 2e-6（六位小数）视为正确。时间单位 s，长度单位 m。'),
    'notes': ('Notes', '备注'), 'problems': ('Not graded', '未评分'),
    'interrupted': ('interrupted: {done} of {whole} teams were graded', '已中断：{whole} 支队伍中评了 {done} 支'),
    'forward': ('forward', '前向'), 'backward': ('backward', '后向'), 'central': ('central', '中心'),
}
_NAMES = ('kind', 'quantity')       # parameters whose values may be keys of WORDS


def sentence(key: str, parameters: Mapping[str, object] | None = None, lang: str = 'en') -> str:
    """Return the sentence for a key in a language, with its parameters inserted."""
    values = dict(parameters or {})
    if 'near' in values:
        values['near_mm'] = 1e3 * float(str(values['near']))
    for name in _NAMES:
        if str(values.get(name)) in WORDS:
            values[name] = sentence(str(values[name]), None, lang)
    return say(WORDS, key, lang, **values)


def handle_name(handle: int, lang: str = 'en') -> str:
    """Return the name of a handle."""
    if handle in (0, 222, 223):
        return sentence({0: 'head', 222: 'tail', 223: 'rear'}[handle], None, lang)
    return sentence('section', {'n': handle}, lang)
