"""Make ``reference.json``: 50-digit positions and velocities for every hard case, and design figures.

    ./dragon python -m hard_cases.make_reference [NAME ...]

The script needs mpmath and runs for a quarter of an hour; with names, it computes only these cases and keeps the
others. The states are those of ``dragon_ros.cost.reference``, which shares nothing numerical with the code that is
tested. Everything is computed twice, the second time with more digits, and compared.
"""
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import mpmath
from mpmath import mp, mpf

from dragon_ros.cost.reference import BEHIND, Number, chain_at, followed, track_of
from hard_cases.cases import Problem, hard_cases

DIGITS = 50                     # digits of every result
GUARD, MORE = 15, 15            # additional digits in the first and in the second computation
AGREED = 40                     # digits to which the two computations must agree
WRITTEN = 25                    # significant digits in the file
TARGET = Path(__file__).with_name('reference.json')


class Handle(NamedTuple):
    """One handle: its coordinates in metres, and its velocity in m/s as a complex number."""

    x: Number
    y: Number
    velocity: Number


def handles_at(problem: Problem, t_s: float, digits: int) -> list[Handle]:
    """Return the requested handles at one time, computed with ``digits`` digits."""
    mp.dps = digits
    chain = chain_at(problem.scene, t_s)
    return [Handle(chain[n][0].real, chain[n][0].imag, chain[n][1]) for n in problem.handles]


def reference(problem: Problem) -> list[list[Handle]]:
    """Return the requested handles at each time, checked against a finer computation."""
    states = []
    for t_s in problem.times_s:
        note(f'{problem.name} at {t_s!r} s')
        coarse, fine = (handles_at(problem, t_s, DIGITS + GUARD + more) for more in (0, MORE))
        small = mpf(10) ** -AGREED
        for a, b in zip(coarse, fine, strict=True):
            assert mp.hypot(a.x - b.x, a.y - b.y) <= small * (1 + mp.hypot(b.x, b.y)), (a, b)
            assert abs(a.velocity - b.velocity) <= small * (1 + abs(b.velocity)), (a, b)
        states.append(fine)
    return states


def figures() -> dict[str, str]:
    """Return the answers to the design questions about the contest's turn."""
    mp.dps = DIGITS + GUARD
    scene = next(problem.scene for problem in hard_cases() if problem.name == 'turning')
    track, _ = track_of(scene)
    length = track.origins[3]
    links = [mpf(link) for link in scene.dragon.link_lengths_m.tolist()][:3]

    def ratio(metres: Number) -> Number:
        *_, (_, velocity) = followed(track, track.place(metres), links, BEHIND, mp.one)
        return abs(velocity)

    mp.dps = 60
    where = mp.findroot(lambda x: mp.diff(ratio, x, h=mpf(10) ** -18), (mpf('14.4799'), mpf('14.4800')), tol=1e-30,
                        solver='secant')
    top = ratio(where)
    return {'turn_length_m': mp.nstr(length, WRITTEN), 'max_speed_ratio': mp.nstr(top, WRITTEN),
            'max_speed_m_s': mp.nstr(2 / top, WRITTEN), 'max_speed_along_m': mp.nstr(where, 15),
            'max_speed_past_exit_m': mp.nstr(where - length, 14)}


def rows_of(problem: Problem, states: list[list[Handle]]) -> dict[str, Any]:
    """Return the reference of a problem as JSON values."""
    return {'handles': problem.handles, 'times_s': problem.times_s, 'states': [vectors_of(state) for state in states]}


def vectors_of(handles: list[Handle]) -> dict[str, list[str]]:
    """Return the state at one time: positions and velocities as decimal strings."""
    arrays = {'x': [h.x for h in handles], 'y': [h.y for h in handles], 'vx': [h.velocity.real for h in handles],
              'vy': [h.velocity.imag for h in handles]}
    return {name: [mp.nstr(value, WRITTEN) for value in row] for name, row in arrays.items()}


def text_of(rows: dict[str, Any], told: dict[str, str]) -> str:
    """Return the file content: JSON with sorted keys, one line per problem and time."""
    header = {'script': Path(__file__).name, 'mpmath': mpmath.__version__, 'digits': DIGITS, 'written_digits': WRITTEN}
    blocks = [f'"{name}": {{"handles": {json.dumps(rows[name]["handles"])},\n'
              f'"states": [\n{joined(json.dumps(state, sort_keys=True) for state in rows[name]["states"])}],\n'
              f'"times_s": {json.dumps(rows[name]["times_s"])}}}' for name in sorted(rows)]
    return (f'{{"figures": {json.dumps(told, sort_keys=True)},\n"header": {json.dumps(header, sort_keys=True)},\n'
            f'"problems": {{\n{joined(blocks)}}}}}\n')


def joined(blocks: Iterable[str]) -> str:
    """Return JSON values as lines of a list."""
    return ',\n'.join(blocks)


def note(text: str) -> None:
    """Print progress."""
    print(text, file=sys.stderr, flush=True)


def main(names: list[str]) -> None:
    """Compute, check and write the reference of all cases, or of the named ones."""
    told = figures()
    note(str(told))
    known = json.loads(TARGET.read_text(encoding='ascii'))['problems'] if names else {}
    found = {problem.name: rows_of(problem, reference(problem)) for problem in hard_cases()
             if problem.name in names or not names}
    rows = {problem.name: row for problem in hard_cases() if (row := {**known, **found}.get(problem.name))}
    TARGET.write_text(text_of(rows, told), encoding='ascii')
    note(f'{TARGET}: {TARGET.stat().st_size} bytes')


if __name__ == '__main__':
    main(sys.argv[1:])
