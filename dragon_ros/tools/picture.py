"""Pictures of a dragon: its benches on their track, and the contact with a closer look."""
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from dragon_ros.core.benches import axes_of, benches_of
from dragon_ros.core.path import points
from dragon_ros.core.scene import Scene
from dragon_ros.core.step import state

# Okabe-Ito colours, which colour-blind people can tell apart.
_BODY, _HEAD, _TOUCHED, _TRACK, _POINT = '#56B4E9', '#D55E00', '#E69F00', '#999999', '#000000'


def contact_picture(scene: Scene, t_s: float, pair: tuple[int, int], point: tuple[float, float]) -> Figure:
    """Return a figure of the whole dragon at ``t_s`` beside a closer look at the contact of two benches."""
    figure = Figure(figsize=(13, 7.2), layout='constrained')
    whole, close = figure.subplots(1, 2)
    _draw(whole, scene, t_s, pair)
    _draw(close, scene, t_s, pair)
    reach = 0.6 * scene.dragon.body_length_m
    close.set_xlim(point[0] - reach, point[0] + reach)
    close.set_ylim(point[1] - reach, point[1] + reach)
    for axes, size in ((whole, 9), (close, 14)):
        axes.plot(*point, marker='+', color=_POINT, markersize=size, markeredgewidth=1.5, zorder=5, linestyle='none',
                  label='contact point')
    whole.set_title(f'{scene.dragon.benches} benches at {t_s:.6f} s')
    close.set_title(f'benches {pair[0]} and {pair[1]} touch at ({point[0]:.6f}, {point[1]:.6f}) m')
    figure.legend(*whole.get_legend_handles_labels(), loc='outside lower center', ncols=5)
    return figure


def _draw(axes: Axes, scene: Scene, t_s: float, pair: tuple[int, int]) -> None:
    """Draw track, benches and handles."""
    chain = state(scene, t_s)
    corners = benches_of(chain, scene.dragon, axes_of(chain)).corners
    last = float(np.hypot(*chain.p[-1])) / scene.spiral.b_m
    theta = np.linspace(0.0, last + np.pi, 4000, dtype=np.float64)
    axes.plot(*points(scene.spiral.b_m, theta, np.zeros_like(theta)).T, color=_TRACK, linewidth=0.6, zorder=1,
              label='track')
    colours = [_BODY] * len(corners)
    colours[pair[1]], colours[0] = _TOUCHED, _HEAD
    axes.add_collection(PolyCollection(list(corners), facecolors=colours, edgecolors='black', linewidths=0.4, zorder=2))
    axes.plot(*chain.p.T, linestyle='none', marker='.', markersize=2.5, color='black', zorder=3, label='handles')
    for colour, label in ((_HEAD, 'head'), (_TOUCHED, 'touched bench')):
        axes.fill([], [], facecolor=colour, edgecolor='black', linewidth=0.4, label=label)
    axes.set_aspect('equal')
    axes.set_xlabel('x (m)')
    axes.set_ylabel('y (m)')
    size = 1.05 * float(np.max(np.abs(corners)))
    axes.set_xlim(-size, size)
    axes.set_ylim(-size, size)
