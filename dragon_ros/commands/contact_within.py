"""``contact --within``: find a time before which no dragon of a family touches itself."""
import json
import time
from argparse import Namespace
from collections.abc import Callable, Sequence
from math import floor, isfinite
from typing import Any

from dragon_ros.cli import command_line
from dragon_ros.cli.progress import Progress
from dragon_ros.core.errors import InputError
from dragon_ros.core.scene import Scene
from dragon_ros.core.search.certificate import Contact
from dragon_ros.core.search.family import FamilyProof, first_contact_within
from dragon_ros.scenes import certificate


def run(scene: Scene, arguments: Namespace) -> int:
    """Print the time proved for the family of dragons that ``--within`` describes; return the exit code."""
    within, start = _tolerances(arguments.within), time.perf_counter()
    with Progress('contact', 'boxes') as bar:
        proof = first_contact_within(scene, within, bar.update)
    values = _values(proof)
    values['stats'] = {'elapsed_s': time.perf_counter() - start, 'states': proof.states}
    if arguments.certificate:
        command_line.write_output(arguments.certificate, json.dumps(certificate.family_values(scene, proof)),
                                  '--certificate')
    command_line.write_output(arguments.output, _FORMATS[arguments.format](values))
    return command_line.OK


def _tolerances(given: Sequence[str]) -> dict[str, float]:
    """Return the tolerances by key. Raises InputError for an argument that is not KEY=METRES, or for a repeated key."""
    out = dict[str, float]()
    for one in given:
        key, equals, text = one.partition('=')
        try:
            value = float(text)
        except ValueError:
            value = float('nan')
        if not equals or not isfinite(value):
            raise InputError(f'--within {one}: it is not KEY=METRES; write, for example, dragon.width_m=0.005')
        if key in out:
            raise InputError(f'--within {one}: {key} is given twice; give it once')
        out[key] = value
    return out


def _values(proof: FamilyProof) -> dict[str, Any]:
    found = proof.nominal
    nominal = ({'t_s': found.t_s, 'benches': list(found.benches)} if isinstance(found, Contact) else
               {'t_s': None, 'end': found.end.reason, 't_end_s': found.end.t_s})
    return {'within': dict(proof.within), 'proved_s': proof.proved_s, 'why': proof.why, 'limit_s': proof.limit_s,
            'benches': list(proof.benches) if proof.benches else None, 'nominal': nominal}


def _text(values: dict[str, Any]) -> str:
    nominal, stats = values['nominal'], values['stats']
    which = ', '.join(f'{key} within {tolerance * 1e3:g} mm' for key, tolerance in values['within'].items())
    own = (f'the scene itself has no contact up to {nominal["t_end_s"]:.9f} s' if nominal['t_s'] is None else
           f'the first contact of the scene itself: {nominal["t_s"]:.12g} s')
    why = {'contact': f'benches {_pair(values["benches"])} may touch from {values["limit_s"] or 0:.6f} s on',
           'run': 'the run ends at that time',
           'bend': 'closer to the centre, links might lock, so nothing is proved',
           'effort': 'the search reached its limit'}[values['why']]
    return (f'no dragon touches itself before {floor(values["proved_s"] * 1e6) * 1e-6:.6f} s ({which}); {why}\n  {own} '
            f'({stats["states"]} boxes in {stats["elapsed_s"]:.3f} s)')


def _pair(benches: Sequence[int] | None) -> str:
    return ' and '.join(map(str, benches or ()))


def _csv(values: dict[str, Any]) -> str:
    row = (values['proved_s'], values['why'], values['limit_s'], *(values['benches'] or (None, None)),
           values['nominal']['t_s'])
    return command_line.csv_of(('proved_s', 'why', 'limit_s', 'inner', 'outer', 'nominal_s'), [row]).rstrip('\n')


_FORMATS: dict[str, Callable[[dict[str, Any]], str]] = {'text': _text, 'csv': _csv, 'json': json.dumps}
