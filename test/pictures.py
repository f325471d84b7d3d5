"""Measure a drawn figure with Matplotlib's renderer: the boxes of its texts and legends, and its curves."""
import numpy as np
from matplotlib.text import Annotation, Text
from shapely.affinity import rotate
from shapely.geometry import LineString, MultiPoint, box
from shapely.strtree import STRtree

from dragon_ros.cli.figures import PAGE_IN, TEXT_PT

_TOLERANCE = 0.75        # tolerance in pixels at 100 dots per inch


class Picture:
    """A figure whose layout has been computed."""

    def __init__(self, figure):
        figure.draw_without_rendering()
        self._figure = figure
        self._texts = list(_texts(figure))

    def cropped(self):
        """Return the texts that the edge of the figure cuts off."""
        edge = box(*self._figure.bbox.extents).buffer(_TOLERANCE)
        return [words for words, place in self._texts if not edge.contains(place)]

    def overlapping(self):
        """Return the pairs of texts that overlap."""
        shapes = [place.buffer(-_TOLERANCE) for _, place in self._texts]
        pairs = STRtree(shapes).query(shapes, predicate='intersects').T.tolist()
        return [(self._texts[one][0], self._texts[other][0]) for one, other in pairs if one < other]

    def small(self):
        """The texts that are below the minimum size on a page that scales wider figures down to its width."""
        shown = min(1.0, PAGE_IN / self._figure.get_figwidth())
        return [text.get_text() for text in _drawn(self._figure) if text.get_fontsize() * shown < TEXT_PT - 1e-9]

    def hidden(self):
        """The curves covered by a legend."""
        found = []
        for axes in self._figure.axes:
            if legend := axes.get_legend():
                area = box(*legend.get_window_extent().extents)
                found += [(axes.get_title(loc='left'), line.get_label()) for line in axes.lines
                          if _path(line).intersects(area)]
        return found


def _texts(figure):
    """Every drawn text of a figure with its box in pixels, rotated with the text."""
    return ((text.get_text(), _box(text)) for text in _drawn(figure))


def _drawn(figure):
    axes = [axis for each in figure.axes for axis in (each.xaxis, each.yaxis)]
    labels = {label for axis in axes for tick in (*axis.majorTicks, *axis.minorTicks)
              for label in (tick.label1, tick.label2)}
    drawn = {label for axis in axes for tick in axis._update_ticks() for label in (tick.label1, tick.label2)}
    for text in figure.findobj(Text):
        if text.get_text().strip() and text.get_visible() and text not in labels - drawn:
            yield text


def _path(line):
    points = line.get_transform().transform(np.column_stack(line.get_data()))
    points = points[np.isfinite(points).all(axis=1)]
    return LineString(points) if len(points) > 1 else MultiPoint(points)


def _box(text):
    if isinstance(text, Annotation):
        extent = _of_words(text)
        return box(*extent.extents)
    angle = text.get_rotation()
    if text.get_rotation_mode() != 'anchor' or angle == 0:
        return box(*text.get_window_extent().extents)
    text.set_rotation(0)
    flat = box(*text.get_window_extent().extents)
    text.set_rotation(angle)
    return rotate(flat, angle, origin=tuple(text.get_transform().transform(text.get_position())))


def _of_words(annotation):
    """The box of an annotation without its arrow."""
    return Text.get_window_extent(annotation)


def outside(axes, points):
    """The points that lie outside the axis limits, in data coordinates (shape (N, 2))."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    inside = np.all((points >= (left, bottom)) & (points <= (right, top)), axis=1)
    return points[~inside]


def readable(save, drawn=True):
    """Wrap a function that saves the figure of a cost page: the figure must be readable before it is saved.

    Unless ``drawn``, an empty figure is saved in its place, because drawing it twice more takes most of the time.
    """
    def saved(figure, stem):
        seen = Picture(figure)
        assert (seen.cropped(), seen.hidden(), seen.small()) == ([], [], [])
        figure.set_layout_engine('none')        # the layout stays as it was examined, and is not computed twice more
        return save(figure if drawn else type(figure)(), stem)
    return saved
