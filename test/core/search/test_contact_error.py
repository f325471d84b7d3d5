"""The stated uncertainty of a contact covers the 50-digit result for benches that extend far beyond their links."""
import mpmath
import numpy as np
import pytest
from properties import thinned

from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.geometry.rectangles import axes_of, benches_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.certificate import Contact
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.tracks.spec import Arc, Composite
from dragon_ros.core.venue import PolygonObstacle, Venue

LENGTH_M, RADIUS_M, MET_S = 5.0, 7.0, 5.3


def on_a_circle(links, seed):
    """Return two benches, each ``links`` links long, and a triangle whose tip meets a corner at ``MET_S``."""
    rng = np.random.default_rng(seed)
    dragon = Dragon(2, LENGTH_M, LENGTH_M, 0.3, 0.5 * (LENGTH_M - LENGTH_M / links))
    scene = Scene(dragon, Composite((Arc(RADIUS_M, 340.0),), 4.0), run=Run(stop_s=8.0))
    chain = compile_scene(scene).chain(MET_S)
    benches, corner = benches_of(chain, dragon, axes_of(chain)), int(rng.integers(2)) * 3     # the front corners
    tip = benches.corners[int(rng.integers(2)), corner]
    way = benches.axis[0, 0] + 1j * benches.axis[0, 1]      # the triangle is ahead of the bench
    sides = [3.0 * way * np.exp(1j * angle) for angle in rng.uniform((-0.9, 0.4), (-0.4, 0.9))]
    points = [tuple(tip), *((tip[0] + side.real, tip[1] + side.imag) for side in sides)]
    triangle = PolygonObstacle('triangle', tuple((float(x), float(y)) for x, y in points))
    return Scene(dragon, scene.track, run=scene.run, venue=Venue((triangle,)))


def true_gap_m(scene, t_s, bench):
    """Return the signed gap between a bench and the triangle, to 50 digits."""
    with mpmath.workdps(50):
        links = [mpmath.mpf(float(link)) for link in scene.dragon.link_lengths_m]
        radius = mpmath.mpf(RADIUS_M)
        angle = (mpmath.mpf(scene.track.start_m) + mpmath.mpf(t_s)) / radius
        angles = [angle]
        for link in links:
            angles.append(angles[-1] - 2 * mpmath.asin(link / (2 * radius)))
        front, rear = (radius * mpmath.mpc(mpmath.sin(one), 1 - mpmath.cos(one)) for one in angles[bench:bench + 2])
        axis = (front - rear) / links[bench]
        along, aside = mpmath.mpf(LENGTH_M) / 2 * axis, mpmath.mpf(scene.dragon.width_m) / 2 * axis * 1j
        middle = (front + rear) / 2
        rectangle = [middle + along + aside, middle - along + aside, middle - along - aside, middle + along - aside]
        triangle = [mpmath.mpc(*map(mpmath.mpf, point)) for point in scene.venue.obstacles[0].points_m]
        return max(separation(one, two) for one, two in ((rectangle, triangle), (triangle, rectangle)))


def separation(one, two):
    """Return the largest separation of two convex polygons beyond an edge of the first."""
    out, middle = [], sum(one) / len(one)
    for start, stop in zip(one, [*one[1:], one[0]], strict=True):
        normal = (stop - start) * 1j / abs(stop - start)
        normal *= mpmath.sign(((start - middle) * mpmath.conj(normal)).real)
        out.append(min(((point - start) * mpmath.conj(normal)).real for point in two))
    return max(out)


@pytest.mark.parametrize(('links', 'seed'), thinned(
    [(links, seed) for links in (1.2, 5.0, 20.0) for seed in range(2)],
    lambda case: case[0] != 5))
def test_the_true_gap_at_a_contact_is_within_the_approach_during_the_uncertainty(links, seed):
    scene = on_a_circle(links, seed)
    found = first_contact(scene)
    assert isinstance(found, Contact)
    assert found.grazing_m is None
    gap_m = abs(true_gap_m(scene, found.t_s, found.benches[0]))
    assert float(gap_m) <= found.approach_m_s * found.uncertainty_s
