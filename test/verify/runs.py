"""Random runs with every kind of track, law, leader and mix of benches, in sizes from millimetres to kilometres.

Run this program by hand, with any number of runs:

    python test/verify/runs.py SEED COUNT

It writes the certificate of each run for which the solver finds an answer, checks the certificate, and prints each
rejected one.
"""
import random
import sys
import time
from collections import Counter
from itertools import count, islice
from pathlib import Path

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.chain.head_law import Head, Profile
from dragon_ros.core.errors import DragonError
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.scenes.certificate import as_values


class Draw:
    """One run, drawn from a seed."""

    def __init__(self, seed):
        self._r = random.Random(seed)
        self._unit = 10**self._r.uniform(-1, 1) if self._r.random() < 0.3 else 1.0
        self._dragon = self._any_dragon()
        self._longest = float(max(self._dragon.link_lengths_m))

    def _m(self, low, high):
        return self._unit * self._r.uniform(low, high)

    def _any_dragon(self):
        r = self._r
        inset = self._m(0, 0.3) if r.random() < 0.8 else 0.0
        most = r.choice([6, 40, 40])

        def length():
            return 2 * inset + (0.0 if inset and r.random() < 0.05 else self._m(0.3, 3))

        width = self._m(0.02, 0.6)
        if r.random() < 0.6:
            return Dragon(r.randint(1, most), length(), length(), width, inset)
        groups = tuple(Group(length(), r.randint(1, max(most // 5, 1))) for _ in range(r.randint(1, 5)))
        return Mixed(groups, width, inset)

    def _track(self):
        r, least = self._r, 0.51 * self._longest + 1e-6 * self._unit
        kind = r.choice(['spiral', 'spiral', 'turn', 'joined', 'joined'])
        if kind == 'spiral':
            turns = r.choice([r.uniform(0.5, 6), r.uniform(3, 20), 10**r.uniform(1, 5)])
            return Spiral(max(self._m(0.2, 1.5), self._dragon.width_m * r.uniform(0.8, 3)), turns)
        if kind == 'turn':
            ratio = r.uniform(1, 3)
            return STurn(self._m(0.4, 2), 1.8 * least * r.uniform(1.02, 4) * (1 + ratio), ratio, self._m(-20, 20))
        pieces = tuple(self._piece(least) for _ in range(r.randint(1, 6)))
        out = isinstance(pieces[0], SpiralArc) and pieces[0].to_turns > pieces[0].from_turns
        return Composite(pieces, self._m(0, 5) * r.choice([0, 1, 1])
                      + (1.2 * float(sum(self._dragon.link_lengths_m)) if out else 0.0))

    def _piece(self, least):
        r = self._r
        kind = r.random()
        if kind < 0.3:
            return Line(self._m(0.1, 8))
        if kind < 0.75:
            return Arc(least * r.uniform(1, 4), r.choice([-1, 1]) * r.choice([r.uniform(5, 400), 90, 180, 45]))
        pitch = self._m(0.3, 1.5)
        ends = (least / pitch * r.uniform(1.1, 3) + 0.3 for _ in range(2))
        return SpiralArc(pitch, *ends, r.choice(['left', 'right']))

    def scene(self):
        """Return the scene of the run. Raises DragonError if no scene is possible."""
        r, track = self._r, self._track()
        speed = r.uniform(0.2, 3) * self._unit * (1 if r.random() < 0.8 else -1)
        speed *= 10**r.uniform(1, 8) if r.random() < 0.1 else 1
        lead, second = r.choice(['head', 'head', 'tail']), self._unit / abs(speed)
        head = Head(speed, lead)
        if r.random() < 0.4:
            knots = [(0.0, r.choice([0.0, speed, -speed]))]
            for _ in range(r.randint(1, 5)):
                knots.append((knots[-1][0] + r.choice([0.0, r.uniform(0.1, 10) * second]),
                              r.choice([0.0, speed * r.uniform(-1, 1), -speed])))
            head = Profile(tuple(knots), r.choice(['linear', 'smooth']), lead)
        start_s = 0.0 if r.random() < 0.7 else r.uniform(0, 5) * second
        stop_s = None if r.random() < 0.1 else start_s + r.random()**2 * r.choice([5, 30, 60]) * second
        return Scene(dragon=self._dragon, track=track, head=head, run=Run(start_s, stop_s), solver='march')


def certificates(seed):
    """Yield (number, scene, certificate) for all runs that the solver can answer."""
    for number in count():
        try:
            scene = Draw(f'{seed}.{number}').scene()
            yield number, scene, as_values(scene, first_contact(scene))
        except DragonError:
            continue


def main(seed, wanted):
    """Check certificates, print each rejected certificate, and finally print the number of kinds and the CPU times."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from certificates import proved

    from dragon_ros.verify.errors import Refused
    kinds, spent, refused = Counter(), [], 0
    for number, scene, values in islice(certificates(seed), wanted):
        start = time.process_time()
        try:
            proved(values)
        except Refused as why:
            refused += 1
            print(f'{seed}.{number}: {why}', flush=True)
        spent.append(time.process_time() - start)
        found = values['contact']
        kinds[type(scene.track).__name__, scene.head.lead, type(scene.head).__name__, type(scene.dragon).__name__,
              'none' if found['t_s'] is None else 'grazing' if found.get('grazing') else 'contact'] += 1
    spent.sort()
    print(f'{wanted} certificates of {len(kinds)} kinds, {refused} refused; CPU median {spent[len(spent) // 2]:.3f} s, '
          f'95 % {spent[len(spent) * 95 // 100]:.3f} s, most {spent[-1]:.2f} s')


if __name__ == '__main__':
    main(sys.argv[1], int(sys.argv[2]))
