"""Every kind of picture of a scene or a bag is byte-identical each time, or a clear error is reported."""
import os
import re
import struct
from dataclasses import replace
from pathlib import Path
from shutil import which

import numpy as np
import pictures
import pytest
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Lines
from properties import thinned

from dragon_ros.__main__ import main
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.cli import figures
from dragon_ros.cli.figures import style
from dragon_ros.commands.plot import options
from dragon_ros.core.batches import ticks
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.geometry.contacts import Observation
from dragon_ros.core.geometry.tracker import ContactTracker
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.search.first_contact import first_contact
from dragon_ros.core.step import tick
from dragon_ros.core.tracks.spec import Arc, Composite, Line
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.pictures.animation import AnimatedFigure, animate
from dragon_ros.pictures.dragon import contact_picture, dragon_picture, overlaps
from dragon_ros.pictures.series import clearance_picture, speeds_picture
from dragon_ros.pictures.sources import BagSource, SceneSource, clearances, decimals_of, dragon_in, moment, window
from dragon_ros.pictures.zoom import Inset, Zoom
from dragon_ros.scenes.load import load_scene
from dragon_ros.version import __version__

# The types of boxes in an ISO base media file that contain other boxes.
PARENTS = (b'moov', b'trak', b'mdia', b'edts', b'minf', b'stbl')
STARTS = {'.png': b'\x89PNG', '.svg': b'<?xml', '.pdf': b'%PDF', '.gif': b'GIF8', '.html': b'<!DOCTYPE html>'}


def plot(capsys, *arguments):
    try:
        code = main(['plot', *map(str, arguments)])
    except SystemExit as end:
        code = end.code
    return code, *capsys.readouterr()


@pytest.mark.parametrize('path', [
    Lines(np.array([(0.0, 3.0), (-2.0, 1.0), (4.0, -1.0)])),
    Lines.make_compound_path(*(Lines([(0, 0), (size, 0), (size, 2 * size), (0, 0)], closed=True) for size in (5, 2)))],
    ids=['a track', 'a polygon with a hole'])
def test_lines_are_drawn_as_by_matplotlib_with_the_same_limits(tmp_path, path):
    drawn = []
    for add in (Axes.add_patch, figures.add_lines):
        figure = Figure()
        axes = figure.add_subplot()
        axes.plot([1, 2], [1, 2])
        add(axes, PathPatch(path, label='lines'))
        axes.autoscale_view()
        axes.legend()
        with style():
            figures.write(figure, tmp_path / 'a.svg')
        drawn.append((axes.dataLim.extents.tolist(), (tmp_path / 'a.svg').read_bytes()))
    assert drawn[0] == drawn[1]


KINDS = [
    ('dragon', '.png', ['--time', '412,412.5']), ('contact', '.svg', []), ('clearance', '.png', []),
    ('speeds', '.pdf', ['--time', '412.5']), ('animation', '.gif', ['--pace', '1', '--fps', '4', '--dpi', '40']),
    ('animation', '.html', ['--pace', '1', '--fps', '4'])]


@pytest.mark.parametrize(('source', 'kind', 'suffix', 'more'), thinned(
    [(source, *kind) for source in ('scene', 'bag') for kind in KINDS],
    lambda case: case[0] == 'bag' or case[2] == '.html'))
def test_every_kind_is_drawn_from_a_scene_and_from_a_bag(capsys, tmp_path, bag, short, source, kind, suffix, more):
    path = tmp_path / f'picture{suffix}'
    chosen = ['--bag', bag] if source == 'bag' else short
    code, out, err = plot(capsys, kind, *chosen, *more, '--output', path)
    assert (code, out.strip(), err) == (0, str(path), '')
    assert path.read_bytes().lstrip().startswith(STARTS[suffix])
    assert path.stat().st_size > 5000


@pytest.mark.parametrize(('suffix', 'other'), thinned([('.png', '.svg'), ('.svg', '.png')],
                                                      lambda case: case[0] == '.png'))
def test_the_same_picture_has_the_same_bytes_alone_and_after_one_in_another_format(capsys, tmp_path, short, suffix,
                                                                                   other):
    alone, after = (tmp_path / f'{name}{suffix}' for name in ('alone', 'after'))
    dragon = ['dragon', *short, '--time', '412.5']
    assert plot(capsys, *dragon, '--output', alone)[0] == 0
    assert plot(capsys, *dragon, '--output', tmp_path / f'a{other}', '--output', after)[0] == 0
    assert alone.read_bytes() == after.read_bytes()


def test_a_bag_shows_what_its_scene_shows(scene, bag):
    model = SceneSource('winding', scene)
    with BagReader(bag) as opened:
        recorded = dragon_in(opened)
        every = (*model.span_s, 1000)
        assert recorded.span_s == model.span_s == (412.0, 413.0)
        assert np.array_equal(recorded.ticks_s(*every), model.ticks_s(*every))
        one, true = moment(recorded, 412.31), moment(model, 412.3)
        assert one.t_s == pytest.approx(412.3)
        assert one.p == pytest.approx(true.p, abs=1e-12)
        assert one.benches.corners == pytest.approx(true.benches.corners, abs=1e-9)
        assert one.speed_m_s == pytest.approx(true.speed_m_s, abs=1e-9)
        touch, exact = recorded.first_touch(iter), first_contact(scene)
        assert (touch.benches, touch.witness.corner) == (exact.benches, exact.witness.corner)
        assert touch.t_s == pytest.approx(exact.t_s, abs=1e-4)
        times, gaps = clearances(recorded, recorded.ticks_s(*every), iter)
        assert len(times) == compile_scene(scene).last_tick + 1
        assert gaps == pytest.approx(clearances(model, model.ticks_s(*every), iter)[1], abs=1e-9)


def test_a_bag_stamped_with_wall_time_shows_its_last_tick_too(tmp_path, scene):
    now_s = 1_800_000_000       # at this time, adjacent floats are 2.4e-7 s apart
    data = bytes(encoders(scene)['handles'](tick(scene, 0)))
    with BagWriter(tmp_path / 'a.mcap') as bag:
        bag.add_channel('/dragon/handles', channels()['handles'])
        for t_s in (now_s, now_s + 1):
            bag.write('/dragon/handles', data[:4] + t_s.to_bytes(4, 'little') + data[8:], t_s * 10**9, 1)
    with BagReader(tmp_path / 'a.mcap') as opened:
        source = BagSource(opened, '/dragon')
        assert source.ticks_s(*source.span_s, 10).tolist() == [now_s, now_s + 1]


def test_a_bag_shows_the_track_of_its_scene_and_none_without_one(tmp_path, scene, bag, short):
    path = tmp_path / 'run.mcap'
    assert main(['simulate', *short, '--output', str(path)]) == 0
    with BagReader(path) as opened:
        assert np.array_equal(dragon_in(opened).track, SceneSource('winding', scene).track)
    with BagReader(bag) as opened:      # the bag has no scene
        assert dragon_in(opened).track is None


def test_a_curve_is_thinned_and_keeps_both_ends(scene):
    source = SceneSource('winding', scene)
    times = source.ticks_s(412.2, 412.8, 5)
    assert len(times) == 5
    assert (times[0], times[-1]) == (412.2, 412.8)
    assert np.all(np.isin(times, source.ticks_s(412.0, 413.0, 1000)))
    assert source.ticks_s(412.21, 412.34, 9) == pytest.approx([412.25, 412.3])


def test_a_bag_without_velocities_has_no_speeds_but_a_picture(capsys, tmp_path, write_bag):
    path = write_bag(tmp_path / 'still.mcap', skip=('velocities',))
    code, _, err = plot(capsys, 'speeds', '--bag', path, '--output', tmp_path / 'a.png')
    assert code == 2
    assert 'no velocities' in err
    assert plot(capsys, 'dragon', '--bag', path, '--output', tmp_path / 'b.png')[0] == 0


def test_a_bag_of_another_namespace_is_found_and_one_without_benches_is_refused(capsys, tmp_path, write_bag):
    path = write_bag(tmp_path / 'other.mcap', namespace='/left')
    assert plot(capsys, 'dragon', '--bag', path, '--output', tmp_path / 'a.png')[0] == 0
    code, _, err = plot(capsys, 'dragon', '--bag', path, '--namespace', 'right', '--output', tmp_path / 'a.png')
    assert (code, '1 dragon (/left); none in --namespace right' in err) == (2, True)
    path = write_bag(tmp_path / 'bare.mcap', skip=('benches',))
    code, _, err = plot(capsys, 'dragon', '--bag', path, '--output', tmp_path / 'a.png')
    assert (code, '/dragon/benches' in err) == (2, True)


def test_a_bag_whose_benches_are_of_other_ticks_has_no_picture(capsys, tmp_path):
    encode, path = encoders(Scene()), tmp_path / 'a.mcap'
    with BagWriter(path) as bag:
        for k, name in enumerate(('handles', 'benches')):
            bag.add_channel(f'/dragon/{name}', channels()[name])
            bag.write(f'/dragon/{name}', encode[name](tick(Scene(), k)), 20_000_000 * k, 1)
    for kind in ('speeds', 'dragon'):
        code, _, err = plot(capsys, kind, '--bag', path, '--output', tmp_path / 'a.png')
        assert (code, 'has handles but no benches at 0 s' in err, len(err.splitlines())) == (2, True, 1)


@pytest.mark.parametrize(('arguments', 'says'), [
    (['dragon', '--time', '1000'], 'from 0 to 432.9 s'),
    (['dragon', '--time', 'noon'], "--times 'noon'"),
    (['dragon', '--time', '1,2,3,4,5,6,7'], 'limit for a picture is 6'),
    (['dragon', '--output', 'x.bmp'], '.png, .svg, .pdf'),
    (['dragon', '--output', 'no/such/folder/x.png'], 'no/such/folder'),
    (['dragon', '--namespace', '/dragon'], '--bag'),
    (['dragon', '--bag', 'run.mcap', '--scene', 'first_contact'], 'omit --scene'),
    (['dragon', '--bag', 'run.mcap', '--scene', 'winding'], 'omit --scene'),
    (['dragon', '--bag', 'no_such.mcap'], 'no_such.mcap'),
    (['contact', '--set', 'run.stop_s=10'], 'no benches touch'),
    (['animation', '--output', 'x.avi'], '.gif, .html, .mp4'),
    (['animation', '--pace', '0'], '--pace'),
    (['animation', '--around', 'contact', '--follow'], 'nothing moves'),
    *(pytest.param(['animation', '--size', size, '--output', 'x.mp4'], says, marks=pytest.mark.skipif(
        not which('ffmpeg'), reason='ffmpeg is not installed')) for size, says in (
            ('1080p', '1920x1080'), ('1919x1080', 'even'))),
    (['dragon', '--around', 'neck'], 'head, tail, contact'),
    (['dragon', '--around', '1,2,3'], 'X,Y'),
    (['dragon', '--span', '0'], '--span'),
    (['dragon', '--around', 'contact', '--scene', 'turning', '--set', 'run.stop_s=9'], 'no benches touch'),
    (['animation', '--pace', '0.001'], 'frames'),
    (['animation', '--start', '-5'], 'from 0 to 432.9 s'),
    (['animation', '--output', 'no/such/folder/x.gif', '--start', '1', '--stop', '2', '--pace', '1'], 'no/such/folder'),
    (['dragon', '--dpi', '0'], '--dpi'),
    (['animation', '--size', '640x360'], '--size: an animation in .gif does not accept it; omit it'),
    (['animation', '--dpi', '99', '--output', 'x.mp4'], '--dpi: an animation in .mp4 does not accept it'),
    (['animation', '--around', 'head', '--output', 'x.html'], '--around: an animation in .html does not accept it'),
    (['drgon'], "'drgon'"),
    ([], 'KIND'),
])
def test_what_cannot_be_drawn_is_said_in_one_line(capsys, tmp_path, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    code, out, err = plot(capsys, *arguments)
    assert (code, out, len(err.splitlines())) == (2, '', 1)
    assert says in err
    assert list(tmp_path.iterdir()) == []


def interrupted(moments):
    for one in moments:
        yield one
        raise KeyboardInterrupt


def test_a_broken_off_animation_leaves_what_was_there(tmp_path, scene):
    path = tmp_path / 'run.gif'
    path.write_text('older')
    source = SceneSource('short', scene)
    times_s = source.ticks_s(*source.span_s, 5)
    with style():
        drawn = AnimatedFigure(source, times_s, dpi=40)
        with pytest.raises(KeyboardInterrupt):
            animate(source, times_s, 10, path, drawn, interrupted)
    assert (list(tmp_path.iterdir()), path.read_text()) == ([path], 'older')


@pytest.mark.parametrize(('kind', 'benches'), thinned(
    [(kind, benches) for kind in ('dragon', 'clearance', 'speeds') for benches in (1, 2, 3)],
    lambda case: case[1] == 1))
def test_the_shortest_dragons_are_drawn(capsys, tmp_path, kind, benches):
    path = tmp_path / 'a.png'
    code, _, err = plot(capsys, kind, '--set', f'dragon.benches={benches}', '--set', 'run.stop_s=2', '--output', path)
    assert (code, err) == (0, '')


def test_the_pictures_of_the_docs_are_those_that_their_commands_make():
    folder = Path(__file__).parents[2] / 'docs' / 'pictures'
    text = (folder / 'README.md').read_text()
    commands = [line.split()[2:] for line in text.splitlines() if line.startswith('    ./dragon plot')]
    made = {path for words in commands for path in options().parse_args(words).output}
    drawn = {'README.md', 'view.png', 'try.png', 'lichtblick.png'}
    assert {path.name for path in made} | drawn == {path.name for path in folder.iterdir()}
    assert {path.parent.as_posix() for path in made} == {'docs/pictures'}
    assert all(path.stat().st_size < 1_200_000 for path in folder.iterdir())


def composite(*pieces, benches=40, stop_s=30):
    track = Composite(pieces)
    return Scene(dragon=Dragon(benches), track=track, run=Run(stop_s=stop_s, rate_hz=1))


STREET = Line(400.0, (500.0, 300.0), 20.0)
SHOWN = {
    'winding': lambda: load_scene('winding', ['dragon.benches=60', 'run.start_s=400', 'run.stop_s=413',
                                              'run.rate_hz=2']),
    'mixed': lambda: load_scene('mixed', ['run.start_s=392', 'run.stop_s=396', 'run.rate_hz=5']),
    'turning': lambda: load_scene('turning', ['dragon.benches=40', 'run.start_s=100', 'run.rate_hz=0.5']),
    'a street far from the origin': lambda: composite(STREET, stop_s=200),
    'a dance that is centred elsewhere': lambda: composite(
        Line(30.0, (6000.0, -5000.0), 90.0), Arc(9.0, 200.0), Arc(9.0, -300.0), stop_s=60),
    'a_name_so_long_that_no_title_has_room_for_it_and_so_it_is_shortened': lambda: load_scene(
        'mixed', ['run.start_s=392', 'run.stop_s=396', 'run.rate_hz=5']),
}


HARDEST = 'a_name_so_long_that_no_title_has_room_for_it_and_so_it_is_shortened',


@pytest.fixture(scope='module', params=thinned(SHOWN, lambda name: name in HARDEST))
def source(request):
    return SceneSource(request.param, SHOWN[request.param]())


def figures_of(source, numbers):
    """Yield (name, figure) for every kind of picture of a source; for an animation, the figure is its first frame.

    ``numbers`` are the numbers of times that one picture shows.
    """
    first, last = source.span_s
    for many in numbers:
        yield f'{many} dragons', dragon_picture(source, np.linspace(first, last, many).tolist())
    yield 'clearance', clearance_picture(source, iter)
    yield 'speeds', speeds_picture(source, np.linspace(first, last, 30).tolist())
    if touch := source.first_touch(iter):
        yield 'contact', contact_picture(source, touch)
    yield 'animation', AnimatedFigure(source, np.array([first, last])).figure
    yield 'around the head', dragon_picture(source, [first, last], Zoom('head'))
    for around in (None, Zoom('tail')):
        yield 'film', AnimatedFigure(source, np.linspace(first, last, 3), around, around is not None, (640, 360)).figure


def test_no_text_of_a_picture_is_small_cropped_or_on_another_and_no_legend_lies_on_a_curve(source, request):
    with style():
        for kind, figure in figures_of(source, (1, 2, 5) if request.config.getoption('--long') else (5,)):
            seen = pictures.Picture(figure)
            assert (kind, seen.cropped(), seen.overlapping(), seen.hidden()) == (kind, [], [], [])
            assert kind == 'film' or (kind, seen.small()) == (kind, [])


@pytest.mark.parametrize(('size', 'zoom'), thinned(
    [(size, zoom) for size in ((1920, 1080), (320, 240), (480, 384), (480, 386), (1000, 1000), (800, 1000), (798, 1000),
                               (720, 1280), (320, 1280)) for zoom in (None, Zoom('tail'))],
    lambda case: case[1] and case[0] in ((480, 384), (800, 1000), (798, 1000))))
def test_the_parts_of_a_film_fit_on_its_frames_of_any_proportions(scene, size, zoom):
    source = SceneSource('short', replace(scene, run=Run(390, 400)))
    with style():
        drawn = AnimatedFigure(source, np.linspace(394, 396, 3), zoom, zoom is not None, size)
        seen = pictures.Picture(drawn.figure)
    assert (drawn.size, seen.cropped(), seen.overlapping()) == (size, [], [])
    places = [shapely.box(*axes.get_position().extents) for axes in drawn.figure.axes]
    assert not any(one.intersects(other) for n, one in enumerate(places) for other in places[:n])
    assert all(shapely.box(0, 0, 1, 1).contains(place) for place in places)


@pytest.mark.parametrize(('size', 'stop_s'), [((640, 360), 396), ((320, 240), 394.01), ((1920, 1080), 396)])
def test_the_times_below_the_clearance_of_a_short_film_do_not_overlap(scene, size, stop_s):
    source = SceneSource('short', replace(scene, run=Run(390, 400)))
    with style():
        drawn = AnimatedFigure(source, np.linspace(394, stop_s, 3), film=size)
        assert pictures.Picture(drawn.figure).overlapping() == []
    assert len(drawn.figure.axes[1].get_xticks()) > 2


def test_a_picture_shows_the_whole_dragon_with_its_track_around_it_wherever_it_is(source):
    one = moment(source, source.span_s[0])
    low, high = window(source.track, [one])
    corners = one.benches.corners.reshape(-1, 2)
    assert np.all((corners > low) & (corners < high))
    assert max(high - low) < 6 * max(np.ptp(corners, axis=0))       # the dragon must not look tiny in a long street
    near = np.all(np.abs(source.track - corners.mean(axis=0)) < np.ptp(corners, axis=0).max(), axis=1)
    assert np.all((source.track[near] > low) & (source.track[near] < high))


def test_the_window_of_an_animation_holds_every_frame(source):
    times_s = source.ticks_s(*source.span_s, 100)
    with style():
        axes = AnimatedFigure(source, times_s).figure.axes[0]
    for one in source.moments(times_s):
        assert pictures.outside(axes, one.benches.corners.reshape(-1, 2)).size == 0


@pytest.mark.parametrize(('rate_hz', 'decimals'), [(50, 5), (10, 3), (2, 0)])
def test_the_decimals_that_a_picture_of_ticks_shows_are_right(rate_hz, decimals):
    scene = Scene(run=Run(405, 413, rate_hz))
    tracker, frames = ContactTracker(), ticks(scene, 0, int(8 * rate_hz) + 1)
    (event,) = [event for one in frames for report in tracker.add(Observation(one.t_ns, one.chain.p, one.benches))
                for event in report.begins]
    assert decimals_of((event.after_ns - event.before_ns) / 1e9) == decimals
    assert event.point_m == pytest.approx((1.474394671648, 2.110664876932), abs=0.5 * 10.0**-decimals)


@pytest.mark.parametrize(('around', 'centre'), [('head', 0), ('tail', -1), ('contact', (1.474395, 2.110665)),
                                                ((3.0, -1.0), (3.0, -1.0))])
def test_a_part_is_a_window_around_its_place_and_framed_in_the_inset(around, centre):
    source = SceneSource('winding', SHOWN['winding']())
    one = moment(source, 412.0)
    with style():
        figure = dragon_picture(source, [412.0], Zoom(around, 4.0))
    axes = figure.axes[0]
    low, high = np.array((axes.get_xlim(), axes.get_ylim())).T
    assert high - low == pytest.approx([4.0, 4.0])
    assert 0.5 * (low + high) == pytest.approx(one.p[centre] if isinstance(centre, int) else centre, abs=1e-5)
    frame = figure.axes[1].patches[-1]
    assert (frame.get_xy(), frame.get_width()) == (pytest.approx(low), pytest.approx(4.0))


def test_a_window_that_is_small_in_its_inset_is_ringed():
    source = SceneSource('street', load_scene('street'))
    one = moment(source, 100.0)
    for span_m, ringed in ((2.0, 1), (60.0, 0)):
        with style():
            inset = Inset(Figure().add_subplot(), window(source.track, [one]), None)
        inset.show(one, Zoom('head', span_m).window(one, None))
        assert len(inset.moving[2].get_xdata()) == ringed


def test_a_run_in_contact_from_start_to_end_has_its_contact_in_the_picture_of_the_clearance():
    source = SceneSource('winding', load_scene('winding', ['dragon.benches=60', 'run.start_s=413', 'run.stop_s=413.5']))
    with style():
        figure = clearance_picture(source, iter)
        low, high = figure.axes[0].get_ylim()
        assert low < 0 <= high
        assert pictures.Picture(figure).cropped() == []


def test_benches_that_overlap_are_marked_where_they_do():
    source = SceneSource('winding', SHOWN['winding']())
    before, after = (overlaps(moment(source, t_s)) for t_s in (412.47, 412.8))
    assert (before.pairs, before.benches, before.words) == (0, (), '')
    assert (after.pairs, after.benches, after.words) == (1, (0, 8), ', 1 pair overlaps')
    corners = moment(source, 412.8).benches.corners
    (outline,) = after.outlines_m
    for bench in (0, 8):
        assert shapely.polygons(corners[bench]).buffer(1e-9).contains(shapely.polygons(outline))
    with style():
        figure = dragon_picture(source, [412.8])
    assert 'overlap' in [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_frame_is_what_a_whole_drawing_shows():
    """Drawing the moving parts onto the static background yields the same pixels for dragon, inset and curves."""
    source = SceneSource('winding', load_scene('winding', ['dragon.benches=20', 'run.start_s=405', 'run.stop_s=413',
                                                           'run.rate_hz=2']))
    times_s = np.array([405.0, 409.0, 412.9])
    for zoom, follow, film in ((None, False, None), (Zoom('head'), True, (640, 360))):
        with style():
            drawn = AnimatedFigure(source, times_s, zoom, follow, film, dpi=50)
            frames = [drawn.frame(one).copy() for one in source.moments(times_s)]
            for part in drawn._moving:
                part.set_animated(False)
            drawn._canvas.draw()
        differ = np.abs(np.asarray(drawn._canvas.buffer_rgba()).astype(int) - frames[-1]).max(axis=-1)
        assert np.mean(differ > 24) < 0.002
        assert np.mean(np.abs(frames[0].astype(int) - frames[-1]).max(axis=-1) > 24) > 0.01


def boxes(data, start=0, end=None):
    """Yield the kind, start and content of the boxes in an ISO base media file."""
    end = len(data) if end is None else end
    while start < end:
        size, kind = struct.unpack_from('>I4s', data, start)
        yield kind, start, data[start + 8:start + size]
        if kind in PARENTS:
            yield from boxes(data, start + 8, start + size)
        start += size


def film(capsys, path, *more):
    return plot(capsys, 'animation', '--set', 'dragon.benches=12', '--start', 400, '--stop', 401, '--pace', 2, '--size',
                '320x240', *more, '--output', path)


needs_ffmpeg = pytest.mark.skipif(which('ffmpeg') is None, reason='needs ffmpeg: apt install ffmpeg')


@needs_ffmpeg
def test_a_film_is_an_mp4_with_a_frame_for_each_time_and_its_length(capsys, tmp_path):
    path = tmp_path / 'run.mp4'
    assert film(capsys, path) == (0, f'{path}\n', '')
    data = path.read_bytes()
    found = {kind: content for kind, _, content in boxes(data)}
    assert data[4:8] == b'ftyp'
    assert b'avc1' in found[b'stsd']
    (count,) = struct.unpack_from('>I', found[b'stsz'], 8)
    scale, length = struct.unpack_from('>II', found[b'mdhd'], 12)
    assert (count, length / scale) == (16, pytest.approx(16 / 30, abs=1e-3))
    assert list(tmp_path.iterdir()) == [path]


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """A function that puts a shell script in the place of ffmpeg."""
    def put(script):
        program = tmp_path / 'bin' / 'ffmpeg'
        program.parent.mkdir()
        program.write_text(f'#!/bin/sh\n{script}\n')
        program.chmod(0o755)
        monkeypatch.setenv('PATH', f'{program.parent}:{os.environ["PATH"]}')
    return put


def test_the_encoder_of_a_film_receives_every_frame(capsys, tmp_path, stand_in):
    stand_in('for last; do :; done; cat > "$last"')
    path = tmp_path / 'run.mp4'
    assert film(capsys, path) == (0, f'{path}\n', '')
    frames = np.frombuffer(path.read_bytes(), np.uint8).reshape(16, 240, 320, 4)
    assert np.all(frames[..., 3] == 255)
    assert np.all(np.any(frames[1:] != frames[:-1], axis=(1, 2, 3)))
    assert np.all(np.mean(frames[..., :3], axis=(1, 2, 3)) > 200)       # mostly paper


@pytest.mark.parametrize('script', [f'{reads}echo no such codec >&2; exit 1' for reads in ('cat > /dev/null; ', '')])
def test_an_encoder_that_fails_is_said_in_one_line(capsys, tmp_path, stand_in, script):
    stand_in(script)
    code, out, err = film(capsys, tmp_path / 'run.mp4')
    assert (code, out, err) == (2, '', f'plot: --output {tmp_path / "run.mp4"}: cannot be written: no such codec\n')
    assert not (tmp_path / 'run.mp4').exists()


def test_a_film_that_is_broken_off_leaves_nothing(tmp_path, scene, stand_in):
    stand_in('for last; do :; done; cat > "$last"')
    source = SceneSource('short', scene)
    times_s = source.ticks_s(*source.span_s, 5)
    with style():
        drawn = AnimatedFigure(source, times_s, film=(320, 240))
        with pytest.raises(KeyboardInterrupt):
            animate(source, times_s, 10, tmp_path / 'run.mp4', drawn, interrupted)
    assert [one.name for one in tmp_path.iterdir()] == ['bin']


def test_a_film_without_ffmpeg_says_what_to_install(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv('PATH', str(tmp_path))       # a folder without ffmpeg
    path = tmp_path / 'run.mp4'
    assert film(capsys, path) == (2, '', f'plot: --output {path}: MP4 needs ffmpeg, which is not installed; run `apt '
                                  'install ffmpeg`, or write .gif or .html\n')


def test_pictures_have_text_as_text_and_a_caption_with_scene_time_and_version(capsys, tmp_path, short):
    path, pdf = tmp_path / 'a.svg', tmp_path / 'a.pdf'
    assert plot(capsys, 'dragon', *short, '--time', '412.5', '--output', path, '--output', pdf)[0] == 0
    words = re.findall(r'<text[^>]*>([^<]*)</text>', path.read_text(encoding='utf-8'))
    assert f'winding, 412.5 s; dragon_ros {__version__}' in words
    assert 'x (m)' in words
    assert b'/TrueType' in pdf.read_bytes() or b'/CIDFontType2' in pdf.read_bytes()


def test_pictures_can_be_read_in_black_and_white():
    """Head and body differ in lightness, touching benches are hatched, and lines have different dashes."""
    grey = {name: np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) for name, colour in
            (('body', figures.BODY), ('head', figures.HEAD))}
    assert grey['body'] - grey['head'] > 0.15
    source = SceneSource('winding', SHOWN['winding']())
    with style():
        dragon = dragon_picture(source, [412.8]).axes[0]
        lines = speeds_picture(source, [400.0, 404.0, 408.0, 412.0]).axes[0].lines
    assert [one.get_hatch() for one in dragon.collections[:2]] == [None, figures.HATCH]
    assert len({str(line.get_linestyle()) + str(line._dash_pattern) for line in lines}) == 4


def test_a_picture_shows_all_obstacles_beside_the_dragon():
    source = SceneSource('square', load_scene('square'))
    axes = dragon_picture(source, [100.0]).axes[0]
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    for one in source.venue.obstacles:
        assert all(left < x < right and bottom < y < top for x, y in one.points_m), one.name
