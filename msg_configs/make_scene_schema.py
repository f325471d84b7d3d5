"""Write ``scene.schema.json`` from the code: run it after a change of the scene format, and commit the result.

PYTHONPATH=. python msg_configs/make_scene_schema.py
"""
from pathlib import Path

from dragon_ros.scenes.schema import text

if __name__ == '__main__':
    Path(__file__).with_name('scene.schema.json').write_text(text(), encoding='utf-8')
