"""No bench comes closer to a bench behind it than the bound derived from layers, and this bound is tight."""
import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, example, given
from hypothesis import strategies as st
from properties import examples, thinned

from dragon_ros.core.chain.chain import marched_many
from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.enclosures.layers import Layers
from dragon_ros.core.geometry.rectangles import Benches, axes_of
from dragon_ros.core.geometry.signed_distance import gaps
from dragon_ros.core.tracks.composite import track_of
from dragon_ros.core.tracks.segments import BEHIND
from dragon_ros.core.tracks.spec import Spiral

CLASSIC_M = 0.55


def wound(dragon, pitch_m, radii_m):
    """Return the N benches of a dragon at M positions, with the head's front handle at the given M radii."""
    theta = np.asarray(radii_m) * 2 * np.pi / pitch_m
    leaders = np.zeros(theta.size, dtype=np.int64), theta
    chain = marched_many(track_of(Spiral(pitch_m, 1.0), BEHIND), dragon.link_lengths_m, leaders, BEHIND)
    centre = 0.5 * (chain.p[:, :-1] + chain.p[:, 1:])
    half_m = [np.broadcast_to(each, centre.shape[:2]) for each in dragon.half_sizes_m]
    return Benches(centre, axes_of(chain), *half_m)


def gaps_from(dragon, pitch_m, radii_m, bench=0):
    """Return the gaps (shape (M, N - bench - 2)) between one bench and all benches behind it except the next one."""
    row, other = np.arange(np.size(radii_m))[:, None], np.arange(bench + 2, dragon.benches)[None]
    return gaps(wound(dragon, pitch_m, radii_m), (row, np.full_like(other, bench)), (row, other))


def bound(dragon, pitch_m, radius_m, bench=0):
    """Return the bound on the gaps behind a bench whose front handle is at the given radius or further out."""
    layers = Layers(pitch_m / (2 * np.pi), dragon)
    return float(layers.gaps_m(np.array([radius_m * 2 * np.pi / pitch_m]), np.array([bench]))[0])


def around(radius_m, pitch_m, turns=1.0, count=150):
    return radius_m + np.linspace(0, turns * pitch_m, count)


LENGTHS = st.lists(st.floats(0.3, 3.0), min_size=1, max_size=7)


@examples(50, long=100)
@given(LENGTHS, st.floats(0.02, 1.0), st.floats(0.0, 0.5), st.floats(0.0, 1.5), st.floats(0.0, 3.5))
@example([2.86, 1.65], 0.3, 0.275, 0.1, 0.2)        # a long head
@example([0.4, 3.0], 0.1, 0.0, 0.2, 0.3)            # long benches outside short ones
@example([1.0], 0.05, 0.4, 1.5, 0.0)                # steep: the pitch is about as large as the radius
@example([0.5, 1.0], 0.9, 0.05, 0.0, 2.0)           # wide benches
def test_no_sampled_gap_is_below_the_bound_at_any_radius(links, width, inset, space, out):
    pitch_m = 1.05 * width + space * max(links)
    radius_m = (0.55 * max(links) + 0.7 * pitch_m + width) * 2**out
    count = int(2 * np.pi * (radius_m + 3 * pitch_m) * 1.7 / np.mean(links)) + len(links)
    assume(count < 400)
    dragon = Mixed(tuple(Group(length + 2 * inset) for length in (links * count)[:count]), width, inset)
    low_m = bound(dragon, pitch_m, radius_m)
    assume(low_m > 0)
    assert np.min(gaps_from(dragon, pitch_m, around(radius_m, pitch_m))) >= low_m


@pytest.mark.parametrize('first', [1, 3, 40])
def test_the_bound_of_any_bench_holds_for_the_benches_behind_it_and_uses_only_them(first):
    dragon = Mixed((Group(3.9, 3), Group(1.2, 40), Group(2.4, 30)), 0.3)
    for radius_m in (4.0, 5.0, 7.0):
        benches, row = wound(dragon, CLASSIC_M, around(radius_m, CLASSIC_M)), np.arange(150)[:, None]
        radii_m = np.hypot(*np.moveaxis(benches.centre, -1, 0))[:, first]
        other = np.arange(first + 2, dragon.benches)[None]
        least_m = np.min(gaps(benches, (row, np.full_like(other, first)), (row, other)))
        low_m = bound(dragon, CLASSIC_M, np.min(radii_m) - 0.5, first)
        assert least_m >= low_m
    behind = Mixed(tuple(map(Group, dragon.bench_lengths_m[first:].tolist())), 0.3)
    assert bound(dragon, CLASSIC_M, 6.0, first) == bound(behind, CLASSIC_M, 6.0)


@pytest.mark.parametrize(('link_m', 'width_m', 'inset_m', 'pitch_m', 'radius_m', 'share'), thinned([
    (1.65, 0.3, 0.275, 0.55, 10, 0.97), (1.65, 0.3, 0.275, 0.55, 30, 0.99), (1.65, 0.3, 0.0, 0.55, 20, 0.98),
    (1.65, 0.01, 0.0, 0.2, 20, 0.98), (0.8, 0.01, 0.35, 0.2, 20, 0.98), (0.4, 0.3, 0.05, 3.0, 2.6, 0.85)],
    lambda case: case[4] in (10, 2.6)))
def test_the_bound_gives_away_hardly_more_than_benches_take_of_the_pitch(link_m, width_m, inset_m, pitch_m, radius_m,
                                                                         share):
    count = int(2 * np.pi * (radius_m + 2 * pitch_m) * 1.4 / link_m)
    dragon = Dragon(count, link_m + 2 * inset_m, link_m + 2 * inset_m, width_m, inset_m)
    least_m = np.min(gaps_from(dragon, pitch_m, around(radius_m, pitch_m, 1.0, 900)))
    taken_m = pitch_m - width_m - least_m
    assert share * (pitch_m - width_m - bound(dragon, pitch_m, radius_m)) <= taken_m
    assert least_m >= bound(dragon, pitch_m, radius_m)


@pytest.mark.parametrize(('between_m', 'pitch_m', 'radius_m', 'share'), [
    (1.65, 20.0, 100.0, 0.985), (0.9, 20.0, 200.0, 0.99), (4.0, 20.0, 20.0, 0.85), (6.0, 9.0, 5.5, 0.38)])
def test_the_bound_on_benches_of_one_layer_is_almost_the_link_between_them_less_two_corners(between_m, pitch_m,
                                                                                            radius_m, share):
    dragon = Mixed((Group(2.2), Group(between_m + 0.55), Group(2.2)), 0.3)
    (least_m,) = gaps_from(dragon, pitch_m, [radius_m])[0]
    corner_m = float(np.hypot(0.275, 0.15))
    low_m = bound(dragon, pitch_m, radius_m)
    assert least_m >= low_m >= share * (between_m - 2 * corner_m)


def test_the_bound_grows_with_the_radius_to_the_pitch_less_the_width():
    radii_m = 2.5 * 2.0 ** np.arange(0, 60, 0.25)
    low_m = [bound(Dragon(), CLASSIC_M, radius_m, 1) for radius_m in radii_m]
    assert np.all(np.diff(low_m) >= -1e-11)
    assert low_m[0] < 0.02
    assert 0.25 - 1e-11 < low_m[-1] < 0.25


@pytest.mark.parametrize(('dragon', 'radius_m'), [
    (Dragon(), 2.4), (Dragon(width_m=0.56), 50.0), (Dragon(), 1.4), (Dragon(), 0.0), (Dragon(), 0.5),
    (Mixed((Group(2.2), Group(0.6), Group(2.2))), 9.0),    # the smallest link
    (Dragon(9, 0.2, 0.2, 0.01, 0.0), 0.3),                  # less than half a pitch from the centre
    (Mixed((Group(0.3), Group(2.0), Group(0.3)), 0.01, 0.0), 1.27)])    # a link of more than a quarter turn
def test_nothing_is_proved_where_layers_overlap_or_no_link_separates_benches(dragon, radius_m):
    assert bound(dragon, CLASSIC_M, radius_m) <= 0
    assert not np.isnan(bound(dragon, CLASSIC_M, radius_m))


def in_arb(dragon, pitch_m, radius_m, bench):
    """Evaluate lemma 8 of docs/contact-lemmas.md in balls, for exact inputs."""
    b = arb(pitch_m / (2 * np.pi))
    pitch, links = 2 * arb.pi() * b, dragon.link_lengths_m
    own, between, longest = arb(links[bench]), arb(links[bench + 1]), arb(np.max(links[bench + 2:]))
    h, a, r = arb(dragon.width_m) / 2, arb(dragon.hole_inset_m), arb(radius_m)

    def axis(radius, link):
        off = (link / 2).max(pitch / 4)
        return (radius * radius - off * off).sqrt()

    def half_bands(radius, link):
        near = axis(radius, link)
        c2, sagitta, end = (b / (near - h)) ** 2, link * link / 8 / near, a * (link + a) / 2 / near
        side = h * (1 + c2).sqrt()
        return side + ((1 + c2) * sagitta).max(c2 * end), side + ((1 + c2) * end).max(c2 * sagitta)

    near = axis(r, own.max(longest))
    corner = ((a * a + h * h).sqrt() / near).asin()
    less = 2 * corner + 2 * (pitch / 2 / (near - h)).asin() + arb.pi() / 2 * longest / r
    outer = r + b * (2 * arb.pi() - less).max(arb(0))
    across = 2 * arb.pi() * b - half_bands(r, own)[1] - half_bands(outer, longest)[0]
    across = across / (1 + (b / (near - h - pitch / 2)) ** 2).sqrt()
    rear = r + pitch * (own + between) / 4 / r
    along = between * (near - h) / (b * b + rear * rear).sqrt() - 2 * near * corner
    return across.min((between / r).sin() * r / between * along)


def drawn(seed):
    """Yield random dragons, each with a pitch and a radius for its second bench."""
    dice = np.random.default_rng(seed)
    for _ in range(60):
        inset_m, width_m = 10 ** dice.uniform(-3, 0), 10 ** dice.uniform(-2, 0)
        link_m = 10 ** dice.uniform(-0.9, 0.5, 5)
        link_m[2] += dice.choice((0, 2)) * inset_m
        pitch_m = width_m * (1 + 10 ** dice.uniform(-3, 2.3))
        yield (Mixed(tuple(Group(2 * inset_m + link) for link in link_m), width_m, inset_m), pitch_m,
               max(pitch_m, np.max(link_m)) * 10 ** (dice.uniform(-0.3, 0.5) * dice.choice((1, 20))))


STEEP = [(Mixed((Group(2.2), Group(2.2), Group(14.0), Group(2.2), Group(2.2)), 4.5, 1.0), 5.0, 12.0),
         (Mixed((Group(2.1), Group(3.002), Group(4.0), Group(1.7), Group(1.7)), 0.3, 0.001), 2.0, 6.0)]


@pytest.mark.parametrize('seed', thinned(range(6), lambda seed: seed % 3 == 0))
def test_no_bound_exceeds_what_arb_proves_or_is_below_it_by_more_than_rounding(seed):
    before, ctx.prec, positive = ctx.prec, 200, 0
    try:
        for dragon, pitch_m, radius_m in [*STEEP, *drawn(seed)]:
            low_m = bound(dragon, pitch_m, radius_m, 1)
            if low_m > 0:
                exact, positive = in_arb(dragon, pitch_m, radius_m, 1), positive + 1
                assert low_m < exact
                assert low_m + 1e-11 * (pitch_m + float(np.sum(dragon.bench_lengths_m))) > exact
    finally:
        ctx.prec = before
    assert positive > 10
