"""Make the files of this folder with version 0.2.0 only: ``CHECKOUT_OF_0.2.0/dragon python make.py``."""
import json
import subprocess
import sys
from pathlib import Path

from dragon_ros.version import __version__

HERE = Path(__file__).resolve().parent
BAG = {     # three bench lengths, an S-turn, smooth ramps, every effect and the first contact
    'dragon': {'kind': 'mixed', 'groups': [{'length_m': 3.41}, {'count': 20, 'length_m': 2.2},
                                           {'count': 3, 'length_m': 1.7}]},
    'track': {'kind': 'turn', 'pitch_m': 0.8, 'before_m': 12},
    'head': {'kind': 'profile', 'ramps': 'smooth', 'knots': [[0, 0], [4, 1.5], [60, 1.5]]},
    'run': {'start_s': 18.6, 'stop_s': 19, 'rate_hz': 10}, 'markers': 'triangles',
    'effects': ['velocity', 'benches', 'clearance', 'contact', 'markers', 'accelerations', 'forces', 'noise', 'trails',
                'clock', 'diagnostics', 'leader', 'cloud']}
_SHORT = {'benches': 12, 'width_m': 0.01}
_LOOP = {'kind': 'joined', 'pieces': [{'kind': 'line', 'length_m': 5},
                                      {'kind': 'arc', 'radius_m': 3, 'angle_deg': 720}]}
CERTIFICATES = {
    'contact': {'run': {'start_s': 400}}, 'contact_at_the_start': {'run': {'start_s': 413}},
    'contact_of_mixed_benches': {
        'dragon': {'kind': 'mixed', 'groups': [{'length_m': 3.41}, {'count': 40, 'length_m': 2.2},
                                               {'count': 30, 'length_m': 1.5}, {'length_m': 3.41}]},
        'run': {'start_s': 395.6}},
    'contact_on_a_turn': BAG | {'run': {'stop_s': 60}, 'effects': []},
    'lock': {'dragon': _SHORT, 'run': {'start_s': 425}},
    'end_of_the_track': {'dragon': {'benches': 20}, 'track': {'kind': 'joined', 'pieces': [
        {'kind': 'line', 'length_m': 5}, {'kind': 'arc', 'radius_m': 6, 'angle_deg': 120}]}},
    'back_and_forth': {'dragon': {'benches': 20}, 'track': _LOOP, 'run': {'start_s': 3, 'stop_s': 100},
                       'head': {'kind': 'profile', 'knots': [[0, 0], [5, 1], [10, -1], [20, -1], [30, 1]]}},
    'unwinding_tail': {'dragon': {'benches': 40}, 'track': {'start_turns': 6}, 'run': {'stop_s': 40},
                       'head': {'kind': 'profile', 'lead': 'tail', 'ramps': 'smooth', 'knots': [[0, 0], [10, 1]]}},
}


def dragon(*arguments: str | Path) -> None:
    """Run a command."""
    subprocess.run([sys.executable, '-m', 'dragon_ros', *arguments], check=True)


def main() -> None:
    """Write the bag and the certificates."""
    if __version__ != '0.2.0':
        raise SystemExit(f'make.py: this is version {__version__}; these files are kept because 0.2.0 made them')
    scene = HERE / 'scene.yaml'
    try:
        scene.write_text(json.dumps(BAG))
        dragon('simulate', '--scene', scene, '--output', HERE / 'run.mcap', '--force')
        for name, values in CERTIFICATES.items():
            scene.write_text(json.dumps(values))
            dragon('contact', '--scene', scene, '--certificate', HERE / f'{name}.json')
    finally:
        scene.unlink(missing_ok=True)


if __name__ == '__main__':
    main()
