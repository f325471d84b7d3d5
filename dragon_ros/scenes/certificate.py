"""Write certificates of first contact from the solver's proof; ``dragon_ros.verify`` checks them.

If a run ends in its first contact, its bag stores the certificate's claim together with the scene.
"""
from collections.abc import Sequence
from math import ceil
from typing import Any

from dragon_ros.core.errors import InputError
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact, Interval, NoContact
from dragon_ros.scenes.load import scene_values

_VERSION = 2        # version of the format and its claims; certificates of 0.2.0 and earlier state none
_WITH_VENUE = 3     # version for a scene with a venue
_MOST = 20_000      # largest number of rows in a certificate; rows only suggest where to split intervals


def as_values(scene: Scene, found: Contact | NoContact) -> dict[str, Any]:
    """Return a certificate as plain values. Raises InputError if the run has none.

    The certificate contains the claim and hints on where to split intervals, but not the solver's bounds, because the
    checker does not use them.
    """
    proof = found.certificate
    if not proof.complete:
        raise InputError('--certificate: this run has no certificate: the benches approach so slowly that the last '
                         'interval before the contact cannot be distinguished from the contact')
    return _certificate(scene, _contact(found), _rows(proof.intervals, scene.dragon.benches - 1))


def claim_of(found: Contact | NoContact) -> dict[str, Any] | None:
    """Return a certificate's claim without its scene and intervals, or None if the run has no certificate."""
    return _contact(found) if found.certificate.complete else None


def of_claim(scene: Scene, claim: Any) -> dict[str, Any]:
    """Return a claim about a scene as a certificate without intervals, which are only hints for the checker."""
    return _certificate(scene, claim, [])


def _certificate(scene: Scene, contact: Any, rows: list[dict[str, Any]]) -> dict[str, Any]:
    values, version = _values(scene), _VERSION
    if scene.venue is not None:     # the proof does not depend on the required clearance
        values['venue'] = {key: values['venue'][key] for key in ('obstacles', 'inside') if values['venue'].get(key)}
        version = _WITH_VENUE
    return {'version': version, 'scene': values, 'contact': contact, 'intervals': rows}


def _values(scene: Scene) -> dict[str, Any]:
    """Return a scene's values without its place on earth, on which no proof depends."""
    return {key: value for key, value in scene_values(scene).items() if key != 'origin'}


def _contact(found: Contact | NoContact) -> dict[str, Any]:
    if not isinstance(found, Contact):
        return {'t_s': None}
    grazing = {'grazing': True} if found.grazing_m else {}
    obstacle = {'obstacle': found.obstacle.name} if found.obstacle else {}
    return {'t_s': found.t_s, 'benches': list(found.benches), **obstacle, **grazing}


def _rows(intervals: Sequence[Interval], behind: int) -> list[dict[str, Any]]:
    """Return the rows; if there are too many intervals, each row covers several consecutive intervals."""
    most, joined = ceil(len(intervals) / _MOST), 1
    out: list[dict[str, Any]] = []
    for one in intervals:
        if joined < most and out and out[-1]['stop_m'] == one.start_m:
            out[-1]['stop_m'], joined = one.stop_m, joined + 1
        else:
            out.append({'lead': 'all', 'start_m': one.start_m, 'stop_m': one.stop_m, 'behind': behind})
            joined = 1
    return out
