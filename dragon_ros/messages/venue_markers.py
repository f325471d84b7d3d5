"""Obstacles as markers: the edges of each obstacle and of the inside, and their names."""
from collections.abc import Sequence

import numpy as np

from dragon_ros.core.geometry.venue import LINE, OUTSIDE, WITHIN, Surroundings
from dragon_ros.core.limits import MARKER_RUNS, SHOWN_EDGES
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import Scene
from dragon_ros.core.venue import INSIDE, LineObstacle, Points, Venue
from dragon_ros.messages.cdr import Writer
from dragon_ros.messages.markers import BLACK, LINE_LIST, TEXT_VIEW_FACING, Colour, MarkerSpec, delete_all, put_marker

# Namespaces of the markers. The id of a marker is the number of its obstacle; the inside has the last id.
EDGES, NAMES = 'venue', 'venue names'
_WIDTH_M, _LETTER_M, _ABOVE_M = 0.08, 0.6, 0.5
_GREY: Colour = (0.35, 0.35, 0.35, 1.0)
# Texts of the markers with edges; RViz does not show these texts. A marker without text is treated as a line.
KINDS = {OUTSIDE: 'polygon', LINE: 'line', WITHIN: 'inside'}


def venue_message(scene: Scene, frame_id: str) -> bytes:
    """Return a MarkerArray with a LINE_LIST for each obstacle, in order, and for the inside, followed by their names.

    The message is stamped with the start of the run, and is empty if there is no venue.
    """
    return _message(_drawn(scene.venue) if scene.venue is not None else [], frame_id, scene.run.start_ns)


def fits_message(around: Surroundings) -> bool:
    """Return whether surroundings are small enough for ``obstacles_message`` and for programs that read it."""
    return around.start.size <= SHOWN_EDGES and 2 * len(around.names) < MARKER_RUNS     # DELETEALL is the first run


def obstacles_message(around: Surroundings | None, frame_id: str, t_ns: int) -> bytes:
    """Return a DELETEALL followed by markers, as in ``venue_message``, for surroundings valid from ``t_ns`` on."""
    return _message(_drawn_around(around) if around else [], frame_id, t_ns, [delete_all()])


def _message(drawn: list[tuple[str, int, Floats]], frame_id: str, t_ns: int, first: Sequence[MarkerSpec] = ()) -> bytes:
    writer = Writer()
    writer.put('I', len(first) + 2 * len(drawn))
    for spec in first:
        put_marker(writer, spec, frame_id, t_ns)
    for number, (name, side, edges) in enumerate(drawn):
        _put_edges(writer, MarkerSpec(EDGES, number, LINE_LIST, (_WIDTH_M, 0.0, 0.0), _colour(name), len(edges),
                                      text=KINDS[side]), edges, frame_id, t_ns)
    for number, (name, _, edges) in enumerate(drawn):
        x, y = edges[0].tolist()
        put_marker(writer, MarkerSpec(NAMES, number, TEXT_VIEW_FACING, (0.0, 0.0, _LETTER_M), _colour(name), text=name,
                                      place=(x, y, _ABOVE_M)), frame_id, t_ns)
    return bytes(writer.finish())


def _colour(name: str) -> Colour:
    return _GREY if name == INSIDE else BLACK


def _put_edges(writer: Writer, spec: MarkerSpec, edges: Floats, frame_id: str, t_ns: int) -> None:
    """Append a marker with n edges, given by their ends (shape (2 n, 2)), at z = 0."""
    start = put_marker(writer, spec, frame_id, t_ns).points
    np.frombuffer(writer.data, '<f8', 3 * len(edges), start).reshape(-1, 3)[:, :2] = edges


def _drawn(venue: Venue) -> list[tuple[str, int, Floats]]:
    """Return the name, side and edges of each obstacle and of the inside; n edges are given by 2 n ends (m)."""
    out = [(one.name, LINE, _edges([one.points_m], False)) if isinstance(one, LineObstacle) else
           (one.name, OUTSIDE, _edges(one.rings_m, True)) for one in venue.obstacles]
    return [*out, *([] if venue.inside is None else [(INSIDE, WITHIN, _edges([venue.inside], True))])]


def _drawn_around(around: Surroundings) -> list[tuple[str, int, Floats]]:
    """Return the name, side and edges of each obstacle, in order; n edges are given by 2 n ends (m)."""
    ends = np.stack((around.start, around.stop), axis=1)
    order = np.argsort(around.owner, kind='stable')
    parts = np.split(ends[order], np.flatnonzero(np.diff(around.owner[order])) + 1)
    return [(name, side, part.reshape(-1, 1).view(np.float64))
            for name, side, part in zip(around.names, around.side.tolist(), parts, strict=True)]


def _edges(lines: tuple[Points, ...] | list[Points], closed: bool) -> Floats:
    parts = []
    for line in lines:
        points = np.array([*line, line[0]] if closed else line)
        parts.append(np.stack((points[:-1], points[1:]), axis=1).reshape(-1, 2))
    return np.concatenate(parts)
