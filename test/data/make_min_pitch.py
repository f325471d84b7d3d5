"""Make ``min_pitch.json``: the smallest pitch of the classic dragon for a circle 9 m in diameter, to 20 digits.

    python test/data/make_min_pitch.py

The script needs mpmath and a few seconds, and shares no code with the package. At the smallest pitch, a corner of the
head touches the inner side of bench 19 and slips past: their separation f, as a function of the head's radius r, has a
minimum of zero there. The equations f = 0 and f' = 0 are solved for the pitch and r in two different precisions;
handles follow from the law of cosines. This script does not show that no larger pitch has a contact;
``dragon_ros.core.search.min_pitch`` does.
"""
import json
from itertools import product
from pathlib import Path

from mpmath import cos, diff, findroot, matrix, mp, mpf, pi, sin, sqrt

TARGET = Path(__file__).with_name('min_pitch.json')
HEAD_M, BODY_M, WIDTH_M, INSET_M = (mpf(text) for text in ('3.41', '2.2', '0.3', '0.275'))
BENCH, DIGITS, AGREED = 19, 40, 30


def main() -> None:
    """Solve, check and write."""
    coarse, fine = solved(DIGITS), solved(2 * DIGITS)
    assert all(abs(a - b) < mpf(10) ** -AGREED for a, b in zip(coarse, fine, strict=True))
    pitch, radius = (mp.nstr(value, 20) for value in fine)
    TARGET.write_text(json.dumps({'pitch_m': pitch, 'radius_m': radius, 'benches': [0, BENCH]}, indent=1) + '\n')


def solved(digits: int) -> tuple[mpf, mpf]:
    """Return the pitch and the head's radius."""
    mp.dps = digits
    root = findroot(lambda pitch, r: (separation(pitch, r), diff(lambda x: separation(pitch, x), r)),
                    (mpf('0.45034'), mpf('4.5726')), tol=mpf(10) ** (10 - digits))
    return root[0], root[1]


def separation(pitch: mpf, radius: mpf) -> mpf:
    """Return the distance of the head's nearest corner from the line of the inner side of bench 19."""
    b = pitch / (2 * pi)
    theta = [radius / b]
    for number in range(BENCH + 1):
        theta.append(following(theta[-1], ((BODY_M if number else HEAD_M) - 2 * INSET_M) / b))
    handle = [matrix([b * angle * cos(angle), b * angle * sin(angle)]) for angle in theta]
    rear, axis = handle[BENCH + 1], unit(handle[BENCH] - handle[BENCH + 1])
    across = matrix([-axis[1], axis[0]])
    along = unit(handle[0] - handle[1])
    beside, middle = matrix([-along[1], along[0]]), (handle[0] + handle[1]) / 2
    corners = [middle + sign * HEAD_M / 2 * along + other * WIDTH_M / 2 * beside
               for sign, other in product((1, -1), repeat=2)]
    inward = 1 if dot(middle - rear, across) > 0 else -1
    return min(inward * dot(corner - rear, across) for corner in corners) - WIDTH_M / 2


def following(theta: mpf, chord: mpf) -> mpf:
    """Return the next handle's polar angle by the law of cosines, in units of b."""
    def excess(outer: mpf) -> mpf:
        return theta**2 + outer**2 - 2 * theta * outer * cos(outer - theta) - chord**2
    return findroot(excess, theta + chord / sqrt(1 + theta**2), tol=mpf(10) ** (10 - 2 * mp.dps))


def dot(a: matrix, b: matrix) -> mpf:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1]


def unit(vector: matrix) -> matrix:
    """Return the vector scaled to length 1."""
    return vector / sqrt(dot(vector, vector))


if __name__ == '__main__':
    main()
