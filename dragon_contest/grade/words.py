"""All sentences in the output of ``grade``, in English and Chinese; the Chinese sentences use the contest's terms.

Each sentence has the same parameters in both languages, and no key is missing (``test/commands/test_grade_words.py``).
"""
from collections.abc import Iterable, Mapping

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
    'enters_at_a': ('when the head starts, the body is not wound on the spiral: it {body}, and enters where the head '
                    'starts',
                    '龙头出发时龙身没有盘在螺线上，而是{body}，从龙头的出发点（A 点）进入'),
    'left_empty': ('is left empty', '空着'), 'at_a_point': ('waits at one point', '停在一点'),
    'on_a_line': ('waits on a straight line', '排在一条直线上'), 'elsewhere': ('waits elsewhere', '停在别处'),
    'loose_root': ('a root finder with a tolerance of about {tolerance:g}: the errors of the chords, up to '
                   '{worst:.2g} m, add up along the dragon',
                   '求根容差约为 {tolerance:g}：弦长误差（至多 {worst:.2g} m）沿龙身累积'),
    'zero_times': ('no difference was formed at {t:g} s: all speeds there are 0', '{t:g} s 处没有做差分，速度全为 0'),
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
    'rounded': ('rounded to {digits} of six decimals', '保留 {digits} 位小数，而不是 6 位'),
    'right_to': ('right to {digits} decimals; the contest asks for 6', '{digits} 位小数都正确；竞赛要求 6 位'),
    'lacks_handles': ('without handles {handles}', '缺少把手 {handles}'),
    'lacks_times': ('without the times {times} s', '缺少时刻 {times} s'),
    'lacks_cells': ('other empty cells: {count}, the first at handle {handle}, {t:g} s',
                    '另有 {count} 个单元格为空，首个在第 {handle} 个把手、{t:g} s'),
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
    'handles_shifted': ('rows are shifted: the row of handle i contains handle i + {by}',
                        '各行错位：第 i 号把手的行实为第 i + {by} 号把手'),
    'rows_mixed': ('rows are not in the order of their names', '行的顺序与名称不符'),
    # Observed facts without an explanation
    'off_track': ('handles are {off:.3g} m off the spiral (root mean square)', '把手偏离螺线 {off:.3g} m（均方根）'),
    'head_unknown': ('the motion of the head fits no known mistake', '龙头前把手的运动不符合任何已知错误'),
    'unknown': ('unknown', '原因不明'),
    'rest': ('the remaining error, up to {worst:.3g} m, is unexplained', '余下误差（至多 {worst:.3g} m）原因不明'),
    # Reading
    'unreadable': ('cannot be read: {said}', '无法打开：{said}'),
    'empty_file': ('is empty; save it as an Excel workbook (.xlsx)', '是空文件；请另存为 Excel 工作簿 (.xlsx)'),
    'too_large': ('it has more than {most} bytes, the limit for a workbook; keep only the result sheets',
                  '超过 {most} 字节的上限；请只保留结果工作表'),
    'password': ('it is protected by a password; save it without a password', '有密码保护；请去掉密码后另存'),
    'excel97': ('it is a workbook of Excel 97 (.xls); save it as .xlsx', '是 Excel 97 工作簿 (.xls)；请另存为 .xlsx'),
    'not_xlsx': ('is not an XLSX workbook; save it as an Excel workbook (.xlsx)',
                 '不是 XLSX 工作簿；请另存为 Excel 工作簿 (.xlsx)'),
    'macros': ('it contains macros; save it as .xlsx without macros', '含有宏；请另存为不含宏的 .xlsx'),
    'links_out': ('it contains links to other workbooks; replace them with values and save it again',
                  '含有到其他工作簿的链接；请改为数值后另存'),
    'xlsb': ('it is a binary workbook (.xlsb); save it as .xlsx', '是二进制工作簿 (.xlsb)；请另存为 .xlsx'),
    'part_twice': ('it contains a part twice; save it again as .xlsx', '同一部件出现两次；请重新另存为 .xlsx'),
    'damaged': ('it is damaged or truncated ({said}); save it again as .xlsx',
                '文件损坏或不完整（{said}）；请重新另存为 .xlsx'),
    'not_a_book': ('cannot be read as a workbook ({said}); save it again as .xlsx',
                   '无法按工作簿读取（{said}）；请重新另存为 .xlsx'),
    'not_csv': ('cannot be read as CSV ({said}); save it as CSV in UTF-8',
                '无法按 CSV 读取（{said}）；请另存为 UTF-8 编码的 CSV'),
    'no_sheets': ('it contains no sheets; save it again as an Excel workbook (.xlsx)',
                  '没有工作表；请另存为 Excel 工作簿 (.xlsx)'),
    'unpacks': ('unpacks to more than {most} bytes, the limit for a workbook', '解压后超过 {most} 字节的上限'),
    'index_unpacks': ('{part} unpacks to more than {most} bytes, the limit for a list of parts',
                      '{part} 解压后超过 {most} 字节的上限'),
    'texts_unpack': ('the texts of its cells have more than {most} bytes, the limit for a workbook',
                     '各单元格的文本合计超过 {most} 字节的上限'),
    'too_many': ('it has {count} {things}; the limit for a workbook is {most}', '有 {count} {things}，上限为 {most}'),
    'sheet_too_large': ('{sheet} has {count} {things}; the limit for a sheet is {most}; delete everything that is not '
                        'part of the result', '{sheet} 有 {count} {things}，上限为 {most}；请删去与结果无关的内容'),
    'not_plain_xml': ('{part} is not plain XML in UTF-8; save it again as .xlsx',
                      '{part} 不是 UTF-8 编码的普通 XML；请重新另存为 .xlsx'),
    'formula': ('{sheet} has a formula without a value in {place}; open the workbook in a spreadsheet program, '
                'recalculate it, and save it', '{sheet} 的 {place} 有未计算的公式；请在电子表格软件中重新计算并保存'),
    'memory': ('grading it would take too much memory; keep only the result sheets',
               '评分所需内存过多；请只保留结果工作表'),
    'n_files': ('files', '个文件'), 'n_sheets': ('sheets', '个工作表'), 'n_rows': ('rows', '行'),
    'n_columns': ('columns', '列'), 'n_cells': ('cells', '个单元格'), 'n_texts': ('texts', '段文本'),
    'sheet_empty': ('sheet {sheet} is empty', '工作表 {sheet} 为空'),
    'template': ('sheet {sheet} is the template, without values', '工作表 {sheet} 是空白模板，没有数值'),
    'numbers_as_text': ('the numbers in sheet {sheet} are stored as text', '工作表 {sheet} 中的数字以文本存储'),
    'transposed': ('sheet {sheet} is transposed: times are in rows', '工作表 {sheet} 行列互换：时间在行上'),
    'without_labels': ("sheet {sheet} names no handles; its rows are read in the contest's order",
                       '工作表 {sheet} 没有把手名称，按竞赛模板的顺序读取'),
    'without_times': ('sheet {sheet} names no times; its columns ({count}) are read as {first:g} s to {last:g} s',
                      '工作表 {sheet} 没有时间，{count} 列按 {first:g} s 至 {last:g} s 读取'),
    'from_one': ('sheet {sheet} counts the handles from 1; 1 is read as the front handle of the head',
                 '工作表 {sheet} 的把手从 1 开始编号，1 视为龙头前把手'),
    'row_too_many': ('sheet {sheet} has one row too many: {count} handles instead of 224; the handles are read in '
                     'order, and the last is ignored',
                     '工作表 {sheet} 多一行：{count} 个把手，应为 224 个；按顺序读取，忽略最后一个'),
    'times_ignored': ('{count} of {whole} times are compared', '{whole} 个时刻中比较了 {count} 个'),
    'not_understood': ('sheet {sheet} is not understood: it has numbers in {rows} x {columns} cells, under '
                       'labels such as {label}; expected are 448 rows for x and y of each handle (224 for speeds) and '
                       'a column for each time, with labels such as 龙头x (m) and 0 s',
                       '工作表 {sheet} 无法理解：有 {rows} 行 {columns} 列数字，标签如 {label}；'
                       '应有 448 行（各把手的 x、y）或 '
                       '224 行（速度），每个时刻一列，标签如 龙头x (m) 与 0 s'),
    'contradictory': ('sheet {sheet} is not understood: {count} cells give another value for a handle, quantity and '
                      'time that another cell gives; label each row with its handle and each column with its time',
                      '工作表 {sheet} 无法理解：有 {count} 个单元格与同一把手、同一量、同一时刻的其他单元格不同；'
                      '请在每行标明把手、每列标明时刻'),
    'untimed': ('it is named {named}, but gives one state without times; expected are times such as 0 s, 1 s',
                '文件名为 {named}，但只有一个无时间的状态；应有 0 s、1 s 等时刻'),
    'merged': ('{sheet}: cells {place} are merged among the values; unmerge them',
               '{sheet}：数据区 {place} 有合并单元格；请取消合并'),
    'other_result': ('it is named {named}, but contains {held}', '文件名为 {named}，内容是 {held}'),
    'misnamed': ('{name} is ignored: it is named otherwise, but contains {held}, which another file gives',
                 '忽略 {name}：文件名与内容不符，内容是 {held}，而另有文件给出该结果'),
    'given_twice': ('{result} is given twice; {name} is ignored', '{result} 重复，忽略 {name}'),
    'no_result': ('it contains no table of handles; use the layout of the contest (docs/grading.md)',
                  '其中没有找到把手数据表；请采用竞赛模板的格式'),
    'found_instead': ('no workbook or CSV file with results; found {files}', '没有结果工作簿或 CSV；其中有：{files}'),
    'found_nothing': ('the folder is empty', '文件夹为空'),
    'folder_unreadable': ('the folder cannot be read: {said}', '文件夹无法读取：{said}'),
    'crashed': ('a workbook crashed the process that read it; save it again as .xlsx',
                '某个工作簿使读取进程崩溃；请重新另存为 .xlsx'),
    'as_said': ('{said}', '{said}（见英文）'),
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
    'looks_like_this': ('looks like: {what}', '疑似：{what}'),
    'seen': ('seen: {what}', '可见：{what}'),
    'not_readable': ('not readable', '无法读取'),
    'verdict_not_understood': ('not understood', '无法理解'),
    'right': ('right', '正确'),
    'wrong': ('wrong', '错误'),
    'incomplete': ('incomplete', '不完整'),
    'close': ('close (within 0.01)', '接近（误差 ≤ 0.01）'),
    'cause': ('cause', '原因'),
    'causes': ('Causes', '原因'),
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
    'made_by': ('dragon_ros {version}. A result is right if its errors are within 2e-6 (six decimals), and close if '
                'they are within 0.01. Times are in s, and lengths are in m.',
                'dragon_ros {version}。误差不超过 2e-6（六位小数）为正确，不超过 0.01 为接近。'
                '时间单位 s，长度单位 m。'),
    'notes': ('Notes', '备注'), 'problems': ('Not graded', '未评分'),
    'interrupted': ('interrupted: {done} of {whole} teams were graded', '已中断：{whole} 支队伍中评了 {done} 支'),
    'forward': ('forward', '前向'), 'backward': ('backward', '后向'), 'central': ('central', '中心'),
}
_CHINESE_SEPARATORS = {', ': '，', '; ': '；', ' + ': '；'}
_NAMES = ('kind', 'quantity', 'things', 'body')       # parameters whose values may be keys of WORDS


def sentence(key: str, parameters: Mapping[str, object] | None = None, lang: str = 'en') -> str:
    """Return the sentence for a key in a language, with its parameters inserted."""
    values = dict(parameters or {})
    if 'near' in values:
        values['near_mm'] = 1e3 * float(str(values['near']))
    for name in _NAMES:
        if str(values.get(name)) in WORDS:
            values[name] = sentence(str(values[name]), None, lang)
    return say(WORDS, key, lang, **values)


def titled(title: str, text: str, lang: str) -> str:
    """Return a text after its title, with the punctuation of the language."""
    return f'{title}{"：" if lang == "zh" else ": "}{text}'


def listed(items: Iterable[str], lang: str) -> str:
    """Return items as a list."""
    return joined(', ', items, lang)


def joined(separator: str, items: Iterable[str], lang: str) -> str:
    """Return items joined by the separator, or by its form in Chinese."""
    return (_CHINESE_SEPARATORS.get(separator, separator) if lang == 'zh' else separator).join(items)


def bracketed(text: str, lang: str) -> str:
    """Return a text in brackets, to be put behind another."""
    return f'（{text}）' if lang == 'zh' else f' ({text})'


def handle_name(handle: int, lang: str = 'en') -> str:
    """Return the name of a handle."""
    if handle in (0, 222, 223):
        return sentence({0: 'head', 222: 'tail', 223: 'rear'}[handle], None, lang)
    return sentence('section', {'n': handle}, lang)
