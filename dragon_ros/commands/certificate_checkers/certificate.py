"""Certificates of first contact: written from the solver's, checked with none of its code (``checker``)."""
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from dragon_ros.commands.certificate_checkers.certificate_file import Claims, read_claims
from dragon_ros.commands.certificate_checkers.checker import Checker, name_of
from dragon_ros.commands.certificate_checkers.walk_checker import WalkChecker
from dragon_ros.core.contact.certificate import ALL, Contact, NoContact
from dragon_ros.core.errors import InputError
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.spec import Spiral
from dragon_ros.scenes.load import scene_values

NAMES = {ALL: 'all'}
_BEFORE_S = 1e-6        # that need not be covered before the contact


def as_values(scene: Scene, found: Contact | NoContact) -> dict[str, Any]:
    """Return a certificate as plain values. Raises InputError where there is none."""
    proof = found.certificate
    if not proof.complete:
        raise InputError('--certificate: this run has none: benches come together so slowly that the last stretch '
                         'before the contact cannot be told from it')
    intervals = [{**asdict(each), 'lead': NAMES.get(each.lead) or name_of(each.lead)} for each in proof.intervals]
    contact = {'t_s': found.t_s, 'benches': list(found.benches)} if isinstance(found, Contact) else {'t_s': None}
    return {'scene': scene_values(scene), 'contact': contact, 'intervals': intervals}


def check(path: Path, progress: Callable[[Any], Any] = lambda rows: rows) -> int:
    """Check a certificate file and return how many intervals it has. Raises InputError with the first fault."""
    claims = read_claims(path)
    try:
        single = isinstance(claims.scene.track, Spiral)
        _check(Checker(claims.scene) if single else WalkChecker(claims.scene), claims, progress)
    except (ArithmeticError, ValueError) as error:
        raise InputError(f'--verify {path}: its numbers lead nowhere: {error}') from None
    return len(claims.rows)


def _check(checker: Any, claims: Claims, progress: Callable[[Any], Any]) -> None:
    scene, rows, t_s, pair = claims
    start, end = scene.run.start_s, scene.end.t_s if t_s is None else t_s
    if t_s is not None:
        gap = checker.gap(t_s, *pair)
        if gap > checker.touch_m or not start <= t_s <= scene.end.t_s:
            raise InputError(f'contact: benches {pair[0]} and {pair[1]} do not touch at {t_s!r} s: they are {gap:.3g} '
                             'm apart')
    if end - start > _BEFORE_S:
        checker.check_cover(rows, start, end, _BEFORE_S)
    elif rows:
        raise InputError('intervals: there is nothing to clear in a run that starts with its contact')
    for row in progress(rows):
        checker.check_bound(row)
