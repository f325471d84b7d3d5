"""All text in the paper's tables and in ``table --contest``, in English and Chinese."""
from dragon_ros.cli.language import Words

WORDS: Words = {
    'table1': ('Table 1. Positions (m)', '表 1  位置 (m)'),
    'table2': ('Table 2. Speeds (m/s)', '表 2  速度 (m/s)'),
    'table3': ('Table 3. Position (m) and speed (m/s) at the "moment of collision" (412.20 s, see the errata)',
               '表 3  “碰撞时刻”的位置 (m) 与速度 (m/s)（412.20 s，见勘误）'),
    'head': ('head', '龙头'), 'section': ('section {n}', '第{n}节龙身'), 'tail': ('tail', '龙尾（后）'),
    'quantity': ('{quantity} of {name}', '{name}{quantity}'),
    'printed': ('printed', '论文值'), 'reproduced': ('reproduced', '复现值'), 'true': ('true', '真值'),
    'error': ('error', '误差'),
    'no_xlsx': ('table: XLSX files are not written, because openpyxl is not installed: pip install openpyxl',
                'table：未写出 XLSX，因为没有安装 openpyxl；请运行 pip install openpyxl'),
}
