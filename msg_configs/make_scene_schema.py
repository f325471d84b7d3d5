"""Generate ``scene.schema.json`` and ``study.schema.json`` from the code.

Run this script when a format changes, and commit both files:
PYTHONPATH=. python msg_configs/make_scene_schema.py
"""
from pathlib import Path

from dragon_ros.scenes.schema import text as of_scenes
from dragon_studies.schema import text as of_studies

if __name__ == '__main__':
    for name, text in (('scene', of_scenes()), ('study', of_studies())):
        Path(__file__).with_name(f'{name}.schema.json').write_text(text, encoding='utf-8')
