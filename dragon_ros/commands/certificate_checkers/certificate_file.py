"""Certificate files, read: nothing in them is believed before it is a number that can be one."""
import json
import re
from pathlib import Path
from typing import Any, NamedTuple

from dragon_ros.commands.certificate_checkers.checker import Row
from dragon_ros.commands.certificate_checkers.walk_checker import Part
from dragon_ros.core.checks import number, whole
from dragon_ros.core.errors import FieldError, InputError, MissingError, ModelEnd
from dragon_ros.core.scene import LATEST_S, Scene
from dragon_ros.scenes.load import scene_of
from dragon_ros.scenes.yaml import Document

_LARGEST = 256 * 2**20      # bytes
_LIMITS = {'start_m': (-1e10, 1e10), 'stop_m': (-1e10, 1e10), 'bound_m': (-1e12, 1e12)}


class Claims(NamedTuple):
    """What a certificate claims: a scene, intervals, the time of contact (None: there is none), and its benches."""

    scene: Scene
    rows: list[Row | Part]
    t_s: float | None
    pair: tuple[int, int]


def read_claims(path: Path) -> Claims:
    """Return what a certificate file claims. Raises MissingError or InputError."""
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise InputError(f'--verify {path}: has {size} bytes; the largest that is read has {_LARGEST}')
        values = json.loads(path.read_text(encoding='utf-8'))
        scene = scene_of(Document(str(path), values['scene']))
        benches = scene.dragon.benches
        rows = [_part(row) if row['lead'] == 'all' else _row(row, benches, scene) for row in values['intervals']]
        t_s = values['contact']['t_s']
        if t_s is not None:
            t_s = number('contact.t_s', t_s, low=scene.run.start_s, high=LATEST_S)
            scene.check_time(t_s)
        first, second = (whole('contact.benches', bench, low=0, high=max(benches - 1, 2))
                         for bench in values['contact'].get('benches', (0, 2)))
    except OSError as error:
        raise MissingError(f'--verify {path}: cannot be read: {error.strerror}') from None
    except ModelEnd as error:
        raise InputError(f'--verify {path}: {error}', **error.fields) from None
    except FieldError as error:
        raise InputError(f'--verify {path}: {error}', **error.fields) from None
    except (ValueError, KeyError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        raise InputError(f'--verify {path}: is no certificate: {str(error)[:200]!r}') from None
    return Claims(scene, rows, t_s, (first, second))


def _row(row: dict[str, Any], benches: int, scene: Scene) -> Row:
    """Return an interval whose numbers can be what they claim. Raises FieldError, KeyError or TypeError."""
    start_m, stop_m, bound_m = _numbers(row, 'start_m', 'stop_m', 'bound_m')
    track = scene.chained.walk
    if track.afar is None:
        raise FieldError('lead', row['lead'], 'the track begins with no spiral that winds in', 'it is all')
    angles = [track.pieces[0].after(metres - track.origins_m[0]).hi for metres in (start_m, stop_m)]
    return Row(_lead(row['lead'], benches), angles[0], angles[1], bound_m,
               whole('behind', row['behind'], low=0, high=benches))


def _lead(name: Any, benches: int) -> int:
    """Return the number of a leading bench. Raises FieldError for no name of one that has others to meet."""
    known = re.fullmatch('head|body|bench ([0-9]{1,7})', name) if isinstance(name, str) else None
    lead = -1 if not known else int(known[1]) if known[1] else int(name == 'body')
    if not 0 <= lead < max(benches - 2, 2):
        raise FieldError('lead', name, 'it is head, body, or bench N with two benches behind it', 'name one')
    return lead


def _part(row: dict[str, Any]) -> Part:
    """Return an interval on a joined track."""
    return Part(*_numbers(row, 'start_m', 'stop_m', 'bound_m'))


def _numbers(row: dict[str, Any], *keys: str) -> tuple[float, float, float]:
    one, two, three = (number(key, row[key], low=_LIMITS[key][0], high=_LIMITS[key][1]) for key in keys)
    return one, two, three
