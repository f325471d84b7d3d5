"""The checker's benches on a track, and their intervals between two positions of the leading handle."""
from flint import acb, arb
from hypothesis import assume
from hypothesis import strategies as st

from dragon_ros.core.chain.dragon import Dragon, Group, Mixed
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.spec import Arc, Composite, Line, Spiral, SpiralArc, STurn
from dragon_ros.scenes.certificate import of_claim
from dragon_ros.scenes.load import scene_values
from dragon_ros.verify import reading
from dragon_ros.verify.balls import PI, exact
from dragon_ros.verify.cover import Budget
from dragon_ros.verify.errors import Refused
from dragon_ros.verify.interval import Interval
from dragon_ros.verify.posture import Dragon as Benches
from dragon_ros.verify.posture import Posture
from dragon_ros.verify.run import Leader
from dragon_ros.verify.segments import SpiralSegment
from dragon_ros.verify.track import Place, Track, track_of

BENCHES = 9
# The step of finite differences: positions are accurate to 1e-28, so second differences are accurate to 1e-10.
STEP = 1e-9


def mirrored(track):
    """Return a composite track with left and right exchanged."""
    def piece(one):
        if isinstance(one, Arc):
            return Arc(one.radius_m, -one.angle_deg)
        if isinstance(one, SpiralArc):
            return SpiralArc(one.pitch_m, one.from_turns, one.to_turns, {'left': 'right', 'right': 'left'}[one.side])
        return one
    return Composite(tuple(map(piece, track.pieces)), track.start_m)


SWAY = Composite((Line(6.0), Arc(1.6, 150.0), Arc(1.5, -100.0), SpiralArc(1.2, 2.0, 1.4, 'left'), Line(0.7),
                  Arc(2.5, 90.0), SpiralArc(1.1, 1.2, 2.5, 'right')), 0.0)
COILS = Composite((SpiralArc(1.3, 4.0, 1.4, 'right'), Arc(1.7, 120.0), SpiralArc(1.2, 1.5, 3.0, 'left'), Arc(9.0, 20.0),
                   SpiralArc(1.4, 2.6, 1.5, 'left')), 0.0)
CENTRED = {'to the centre': 1, 'to the centre, mirrored': -1}
BENT = {'sway': SWAY, 'sway, mirrored': mirrored(SWAY), 'coils': COILS, 'coils, mirrored': mirrored(COILS),
        'turn': STurn(1.7, 5.0, 1.5), 'out of a spiral': Spiral(0.9, 3.4)}


def plain(dragon):
    """Return a dragon as the checker reads it."""
    return reading._claims(of_claim(Scene(dragon=dragon, track=Spiral()), {'t_s': None})).scene


def compiled(dragon, track, tail_leads=False):
    """Return the checker's track, benches, and largest curvature (None for a spiral to its centre)."""
    scene = plain(dragon)
    values = scene_values(Scene(dragon=Dragon(1, 0.2, 0.2, 0.1, 0.0), track=track))
    shape = reading._kind('scene.track', values['track'], reading._TRACKS)
    placed = track_of(reading.Scene(scene.lengths_m, scene.width_m, scene.inset_m, shape, scene.law, tail_leads, 0.0,
                                    None))
    return placed, Benches(scene), None if placed.to_centre else placed.bend


def centred(dragon, pitch_m=0.9, turns=3.4, side=1):
    """Return the same as ``compiled`` for a spiral to its centre that turns to either side."""
    start = 2 * PI * exact(turns)
    b = exact(pitch_m) / (2 * PI)
    segment = SpiralSegment(b, acb(0), acb(1), side, -1, start, None, arb(0))
    return Track([segment], [arb(0)], arb(0), True, [0]), Benches(plain(dragon)), None


def made(kind, dragon):
    """Return the same as ``compiled`` for a kind of track."""
    if kind in CENTRED:
        return centred(dragon, side=CENTRED[kind])
    return compiled(dragon, BENT[kind], tail_leads=kind == 'out of a spiral')


def reach_m(track, benches):
    """Return the approximate range of the head's position, up to a lock or to the end of the track."""
    if track.to_centre:
        return 0.0, float(Leader(track, benches, False, Budget(10**7)).limits(1e-12, None)[1].gone)
    links = sum(bench.link.near for bench in benches.benches)
    begin = -10.0 if track.begin is None else float(track.begin) + 1.6 * links
    return begin, 40.0 if track.end is None else float(track.end)


def made_with_reach(kind, dragon):
    """Return ``made(...)`` and the head's range; reject examples with an empty range or bends that are too tight."""
    made_of = made(kind, dragon)
    track, benches, bend = made_of
    assume(bend is None or bend * max(benches.longest_links) < 1.98)
    try:
        low, high = reach_m(track, benches)
    except Refused:     # the chain is locked or off the track
        assume(False)
    assume(low < high)
    return made_of, low, high


def at(track, benches, metres):
    """Return the dragon with its head at a distance along the track."""
    return Posture(track, benches, 0, track.place_at(metres if isinstance(metres, arb) else arb(metres)))


def interval(made_of, start, stop):
    """Return an interval and the dragon at both of its ends."""
    track, benches, bend = made_of
    ends = at(track, benches, start), at(track, benches, stop)
    return Interval(track, benches, 0, ends, bend), ends


def around(track, benches, metres, by_metres):
    """Return the dragon at three positions: one step before a position, at the position, and one step after it.

    The step is in metres or in the coordinate of the leading handle.
    """
    here = track.place_at(arb(metres))
    return [Posture(track, benches, 0, track.place_at(arb(metres) + STEP * k) if by_metres
                    else Place(here.segment, here.u + STEP * k)) for k in (-1, 0, 1)]


def corners(pose):
    """Return the corners of a bench as balls."""
    length, width = pose.axis * pose.shape.half_length, pose.axis * acb(0, 1) * pose.shape.half_width
    return [pose.middle + length * x + width * y for x in (1, -1) for y in (1, -1)]


lengths = st.just(0.05) | st.floats(0.2, 2.2)
dragons = (st.builds(lambda head, body, inset, width: Dragon(BENCHES, 2 * inset + head, 2 * inset + body, width, inset),
                     lengths, st.floats(0.2, 2.2), st.floats(0.05, 0.4), st.floats(0.05, 0.5))
           | st.builds(lambda links: Mixed(tuple(Group(0.5 + link) for link in links), 0.3, 0.25),
                       st.lists(lengths, min_size=BENCHES, max_size=BENCHES)))
