"""All text on a plan, in English and Chinese."""
from dragon_ros.cli.language import Words

WORDS: Words = {
    'plan': ('{title}: plan 1:{scale}', '{title}：平面图 1:{scale}'),
    'tables': ('{title}: times, gaps and room', '{title}：时刻、间隙与所需宽度'),
    'page': ('dragon_ros {version}, {day}, {paper}, page {n} of {total}',
             'dragon_ros {version}，{day}，{paper}，第 {n} 页，共 {total} 页'),
    'page_at': (' (row {row}, column {column})', '（第 {row} 行，第 {column} 列）'),
    'head': ('swept by the head', '龙头扫过的区域'), 'body': ('swept by the body', '龙身扫过的区域'),
    'track': ('track', '轨迹'), 'obstacles': ('obstacles', '障碍物'),
    'gap': ('{name}: {gap:.2f} m', '{name}：{gap:.2f} m'), 'exact_gap': ('{name}: {gap:.3f} m', '{name}：{gap:.3f} m'),
    'broken_gap': ('{name}: {gap:.3f} m (too small)', '{name}：{gap:.3f} m（不足）'),
    'drawn_broken_gap': ('{name}: {gap:.2f} m (too small)', '{name}：{gap:.2f} m（不足）'),
    'room': ('room {room:.2f} m', '所需宽度 {room:.2f} m'),
    'mark': ('mark m', '标记 m'), 'head_at': ('head min:s', '龙头 分:秒'), 'tail_at': ('tail min:s', '龙尾 分:秒'),
    'gaps': ('smallest gaps', '最小间隙'), 'most_room': ('most room required', '所需宽度最大处'),
    'room_at': ('at {at:g} m: {left:.2f} m left, {right:.2f} m right',
                '{at:g} m 处：左 {left:.2f} m，右 {right:.2f} m'),
    'unbounded': ('the speeds of benches have no upper bound in this run', '本次运行中板凳的速度没有上界'),
    'slower': ('no handle exceeds {ratio:.4f} times the speed of the leader',
               '各把手的速度都不超过领头把手的 {ratio:.4f} 倍'),
    'slower_than': ('no handle exceeds {speed:.3f} m/s, which is {ratio:.4f} times the speed of the leader',
                    '各把手的速度都不超过领头把手的 {ratio:.4f} 倍，即 {speed:.3f} m/s'),
    'proved': ('Proved: {fastest}.', '已证明：{fastest}。'),
    'proved_gaps': ('Proved: {fastest}. Apart from rounding in the drawing, each smallest gap is at most {within:.1g} '
                    'mm below the stated value.',
                    '已证明：{fastest}；除舍入外，各最小间隙比其值至多小 {within:.1g} mm（图中数值已舍入）。'),
    'sampled': ('Not proved: the swept area and the room are computed every {step:.0f} cm, which misses '
                'about a millimetre in bends.',
                '未证明：扫过的区域与所需宽度每 {step:.0f} cm 计算一次，弯道处约有 1 mm 未计入。'),
    'people': ('People, poles and overhanging parts are not included.',
               '不包括抬龙的人、立杆以及伸出板凳之外的物品。'),
    'margin': ('Required margin: {margin:g} m; anything closer is red and marked as too small.',
               '要求的间隙：{margin:g} m；小于它的用红色标出并注明“不足”。'),
    'metres': ('in metres', '单位 m'), 'degrees': ('in degrees (RFC 7946)', '单位为度（RFC 7946）'),
}
