"""Design questions about a dragon and its track."""
from collections.abc import Sequence
from types import NoneType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dragon_ros.api.simulated import Progress, Simulated, given_scene, quiet, scene_values
from dragon_ros.core.chain.dragon import AnyDragon, Dragon, Mixed
from dragon_ros.core.checks import number
from dragon_ros.core.errors import FieldError
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.tracks.spec import STurn

if TYPE_CHECKING:
    from dragon_ros.core.search.bounding_box import BoundingBox
    from dragon_ros.core.search.max_speed import MaxSpeed
    from dragon_ros.core.search.min_pitch import MinPitch
    from dragon_ros.core.search.swept_area import SweptArea
    from dragon_ros.core.search.venue_fit import VenueFit
    from dragon_ros.core.tracks.s_turn import TurnAnswer


class Room(NamedTuple):
    """How far benches reach to the left and right of the track (m) at distances along it (m), all of shape (n,).

    ``area`` holds the areas that the benches sweep, as shapely polygons: ``head``, ``body``, and both as ``whole``. All
    values are computed from benches ``sampled_m`` apart; they are not proved.
    """

    at_m: Floats
    left_m: Floats
    right_m: Floats
    sampled_m: float
    area: 'SweptArea'


class Design:
    """Design questions: the smallest pitch, the space that a run requires, the largest speed, and the S-turn.

    ``progress(states)`` is called with the number of newly computed states.
    """

    @staticmethod
    def min_pitch(dragon: Scene | Simulated | AnyDragon | None = None, *, diameter_m: float = 9.0,
                  start_turns: float | None = None, largest_m: float = 1.0, within_m: float = 4e-11,
                  smallest_m: float | None = None, progress: Progress = quiet) -> 'MinPitch':
        """Return the smallest pitch found at which the head reaches a circle without a contact.

        Runs at pitches from ``largest_m`` down to the result, one per cent apart (``clear_m``), are proved to have no
        contact; nothing is proved between them. ``dragon`` is a dragon or a scene; None means the classic dragon. The
        head starts ``start_turns`` turns from the centre: by default, as in the scene, or 16 without a scene. The
        bounds of the result are at most ``within_m`` apart, and a few errors of a gap more. The search ends at
        ``smallest_m``, by default where the head starts on the circle. Raises FieldError.
        """
        from dragon_ros.core.search.min_pitch import min_pitch
        if not isinstance(dragon, (Dragon, Mixed, NoneType)):
            scene = given_scene('dragon', dragon)
            if scene.venue is not None:
                raise FieldError('dragon', 'a scene with a venue', 'obstacles are not taken into account',
                                 'give its dragon: scene.dragon')
            dragon = scene.dragon
            start_turns = scene.spiral.start_turns if start_turns is None else start_turns
        start_turns = 16.0 if start_turns is None else number('start_turns', start_turns)
        return min_pitch(dragon, number('diameter_m', diameter_m), start_turns,
                         number('largest_m', largest_m), number('within_m', within_m, above=0.0), progress,
                         None if smallest_m is None else number('smallest_m', smallest_m))

    @staticmethod
    def fit(scene: Scene | Simulated, *, within_m: float | None = None,
            progress: Progress = quiet) -> 'BoundingBox | VenueFit':
        """Return the space that a run requires or, in a venue, the smallest gap to each obstacle.

        The bounds are at most ``within_m`` apart; the default is 1e-10 m, or 1e-6 m in a venue. Raises FieldError.
        """
        given = given_scene('scene', scene)
        within = None if within_m is None else number('within_m', within_m, above=0.0)
        if given.venue is not None:
            from dragon_ros.core.search.venue_fit import venue_fit
            return venue_fit(given, within or 1e-6, progress)
        from dragon_ros.core.search.bounding_box import bounding_box
        return bounding_box(given, within or 1e-10, progress)

    @staticmethod
    def room(scene: Scene | Simulated) -> Room:
        """Return the width that a run requires at every metre of its track, and the areas that its benches sweep."""
        from dragon_ros.core.search.swept_area import room_every_metre, swept_area
        given = given_scene('scene', scene)
        swept = swept_area(given)
        at_m, room_m = room_every_metre(given, swept)
        return Room(at_m, room_m[:, 0], room_m[:, 1], swept.step_m, swept)

    @staticmethod
    def max_speed(scene: Scene | Simulated, *, progress: Progress = quiet) -> 'MaxSpeed':
        """Return the largest ratio of a handle's speed to the leader's. Raises FieldError if the run ends in a lock.

        ``max_speed(scene).leader_m_s(2.0)`` returns the largest leader speed at which no handle exceeds 2 m/s, and the
        amount by which this speed may be too large.
        """
        from dragon_ros.core.search.max_speed import max_speed
        return max_speed(given_scene('scene', scene), progress)

    @staticmethod
    def turn(scene: Scene | Simulated) -> 'TurnAnswer':
        """Return the length of a scene's S-turn and of shorter alternatives.

        Raises FieldError if the scene has no S-turn.
        """
        from dragon_ros.core.tracks.composite import least_radius_m
        from dragon_ros.core.tracks.s_turn import turn_answer
        given = given_scene('scene', scene)
        if not isinstance(given.track, STurn):
            raise FieldError('track.kind', scene_values(given)['track']['kind'], 'its track has no S-turn',
                             "give a scene whose track.kind is turn, such as dr.scene('turning')")
        return turn_answer(given.track, least_radius_m(given.dragon.link_lengths_m))

    @staticmethod
    def turn_poses(turn: STurn, along_m: Sequence[float] | Floats) -> tuple[Floats, Floats]:
        """Return points (m, shape (..., 2)) and unit headings on an S-turn, with its spirals.

        ``along_m`` (...) are distances along the track from the entry; they are negative before it.
        """
        from dragon_ros.core.tracks.composite import track_of
        track, metres = track_of(turn), np.asarray(along_m, dtype=np.float64)
        return track.poses(*track.places_at(metres))


design = Design()
