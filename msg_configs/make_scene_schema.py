"""Generate ``scene.schema.json`` and ``study.schema.json`` from the code.

``./dragon schemas`` runs this script. Commit the files when a format changes.
"""
from pathlib import Path

from dragon_ros.scenes.schema import text as of_scenes
from dragon_studies.schema import text as of_studies

if __name__ == '__main__':
    for name, text in (('scene', of_scenes()), ('study', of_studies())):
        Path(__file__).with_name(f'{name}.schema.json').write_text(text, encoding='utf-8')
