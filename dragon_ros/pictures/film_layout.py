"""The places of the dragon and the curves on the frames of a film, which depend on the proportions of the frames."""
from typing import NamedTuple

import numpy as np

from dragon_ros.core.numerics.types import Floats

Box = tuple[float, float, float, float]     # left, bottom, width and height of axes, relative to the figure

_WIDE_IN = (12.8, 7.2)      # minimum size of a film that has the curves beside the dragon, in inches
_SQUARE_IN = 9.0            # width of a film that has the curves next to each other below the dragon, in inches
_TALL_IN = 6.4              # width of a film that has the curves one above the other below the dragon, in inches
# Width of a frame, relative to its height, from which the curves are beside the dragon, and next to each other.
_LEAST_WIDE, _LEAST_SQUARE = 1.25, 0.8
_MARGIN_IN, _EDGE_IN, _BELOW_IN = 0.75, 0.35, 0.8       # left of axes, right of axes, and below the curves
_SQUARE_CURVE, _TALL_CURVE = 0.19, 0.13                 # height of a curve below the dragon, relative to the film
_BETWEEN_IN = 1.05          # between axes, for a title and the labels of an x axis
_TITLE_IN = 0.95
_INSET_IN = 1.4
_ROOM_PX = 0.1              # added to a size, so that the conversion to inches does not lose a pixel


class FilmLayout(NamedTuple):
    """The size of a film (2,) in inches, its resolution, and the places of the dragon, the inset and the curves."""

    size_in: Floats
    dots_per_inch: float
    dragon: Box
    inset: Box
    gap: Box
    speed: Box


def film_layout(width_px: int, height_px: int, has_inset: bool) -> FilmLayout:
    """Return the layout of a film; text has the same size relative to all films of the same proportions."""
    if width_px < _LEAST_WIDE * height_px:
        return _below(width_px, height_px, has_inset)
    wide_in, high_in = _WIDE_IN
    dots = height_px / high_in if width_px * high_in >= height_px * wide_in else width_px / wide_in
    return FilmLayout(_inches(width_px, height_px, dots), dots, (0.06, 0.11, 0.45 if has_inset else 0.57, 0.76),
                      (0.52, 0.66, 0.12, 0.21), (0.70, 0.57, 0.27, 0.30), (0.70, 0.11, 0.27, 0.30))


def _below(width_px: int, height_px: int, has_inset: bool) -> FilmLayout:
    """Return the layout of a film that has the curves below the dragon."""
    is_tall = width_px < _LEAST_SQUARE * height_px
    wide_in = _TALL_IN if is_tall else _SQUARE_IN
    dots = width_px / wide_in
    high_in = height_px / dots

    def box(left_in: float, bottom_in: float, width_in: float, height_in: float) -> Box:
        return left_in / wide_in, bottom_in / high_in, width_in / wide_in, height_in / high_in

    inner_in = wide_in - _MARGIN_IN - _EDGE_IN
    if is_tall:
        curve_in = inner_in, _TALL_CURVE * high_in
        gap_in = _MARGIN_IN, _BELOW_IN + curve_in[1] + _BETWEEN_IN
    else:
        curve_in = 0.5 * (inner_in - _MARGIN_IN), _SQUARE_CURVE * high_in
        gap_in = _MARGIN_IN, _BELOW_IN
    bottom_in, top_in = gap_in[1] + curve_in[1] + _BETWEEN_IN, high_in - _TITLE_IN
    dragon_in = inner_in - (_INSET_IN + _EDGE_IN if has_inset else 0.0)
    return FilmLayout(
        _inches(width_px, height_px, dots), dots,
        box(_MARGIN_IN, bottom_in, dragon_in, top_in - bottom_in),
        box(wide_in - _EDGE_IN - _INSET_IN, top_in - _INSET_IN, _INSET_IN, _INSET_IN),
        box(*gap_in, *curve_in), box(wide_in - _EDGE_IN - curve_in[0], _BELOW_IN, *curve_in))


def _inches(width_px: int, height_px: int, dots: float) -> Floats:
    size: Floats = (np.array((width_px, height_px)) + _ROOM_PX) / dots
    return size
