"""Write certificates of first contact: a claim about a scene, which ``dragon_ros.verify`` proves.

If a run ends in its first contact, its bag stores the certificate's claim together with the scene.
"""
from typing import Any

from dragon_ros.core.errors import InputError
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact, NoContact
from dragon_ros.scenes.load import scene_values

_VERSION = 4    # the version of the format and of its claims


def as_values(scene: Scene, found: Contact | NoContact) -> dict[str, Any]:
    """Return a certificate as plain values. Raises InputError if the run has none."""
    claim = claim_of(found)
    if claim is None:
        raise InputError('--certificate: this run has no certificate: the benches approach so slowly that the last '
                         'interval before the contact cannot be distinguished from the contact')
    return of_claim(scene, claim)


def claim_of(found: Contact | NoContact) -> dict[str, Any] | None:
    """Return a certificate's claim without its scene, or None if the run has no certificate."""
    return _contact(found) if found.certificate.complete else None


def of_claim(scene: Scene, claim: Any) -> dict[str, Any]:
    """Return a claim about a scene as a certificate."""
    values = _values(scene)
    if scene.venue is not None:     # the proof does not depend on the required clearance
        values['venue'] = {key: values['venue'][key] for key in ('obstacles', 'inside') if values['venue'].get(key)}
    return {'version': _VERSION, 'scene': values, 'contact': claim}


def _values(scene: Scene) -> dict[str, Any]:
    """Return a scene's values without its place on earth, on which no proof depends."""
    return {key: value for key, value in scene_values(scene).items() if key != 'origin'}


def _contact(found: Contact | NoContact) -> dict[str, Any]:
    if not isinstance(found, Contact):
        return {'t_s': None}
    grazing = {'grazing': True} if found.grazing_m else {}
    obstacle = {'obstacle': found.obstacle.name} if found.obstacle else {}
    return {'t_s': found.t_s, 'benches': list(found.benches), **obstacle, **grazing}
