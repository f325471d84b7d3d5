"""The web view's server answers correctly, and its page plays in a real browser and contacts no other host."""
import contextlib
import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from base64 import b64encode
from hashlib import sha256
from xml.etree import ElementTree

import numpy as np
import pytest
from properties import thinned

from dragon_ros.__main__ import main
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagWriter
from dragon_ros.commands.view import server as server_module
from dragon_ros.commands.view.data import ViewData
from dragon_ros.commands.view.page import WEB, write_page
from dragon_ros.commands.view.server import ViewServer
from dragon_ros.core.errors import InputError
from dragon_ros.core.limits import VIEW_CONNECTIONS
from dragon_ros.core.step import tick
from dragon_ros.messages.channels import channels
from dragon_ros.messages.decode import read_marker_array, read_multi_array, read_pose_array
from dragon_ros.messages.encode import encoders
from dragon_ros.pictures.sources import SceneSource, dragon_in, moment
from dragon_ros.scenes.load import load_scene


def serving(source):
    return serving_of(ViewData(source, iter))


@contextlib.contextmanager
def serving_of(shown, lang=None):
    with ViewServer(shown, lang=lang) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture(scope='module')
def server(scene):
    with serving(SceneSource('short', scene)) as running:
        yield running


def get(server, path):
    with urllib.request.urlopen(server.url + path, timeout=20) as answer:
        return answer.read()


def rows(server, run, name):
    values = 8 * run['drawn'] + 2 * run['placed'] + len(run['handles'])
    return np.frombuffer(get(server, f'frames/{name}'), '<f4').reshape(-1, values)


def test_the_run_is_described(server, scene):
    run = json.loads(get(server, 'run.json'))
    assert (run['name'], run['benches'], run['drawn'], run['placed'], run['note']) == ('short', 30, 30, 0, '')
    assert run['times_s'] == pytest.approx([412 + k / 20 for k in range(21)])
    contact = json.loads(get(server, 'contact.json'))
    assert contact['t_s'] == pytest.approx(412.4738376821)
    assert contact['benches'] == [0, 8]
    assert len(run['track'][0]) == len(run['track'][1]) > 1000


def test_frames_are_what_the_model_says(server, scene):
    run = json.loads(get(server, 'run.json'))
    frames = rows(server, run, 0)
    assert len(frames) == 21
    true = moment(SceneSource('short', scene), 412.5)
    np.testing.assert_allclose(frames[10, :240], true.benches.corners.ravel(), rtol=0, atol=1e-6)
    np.testing.assert_allclose(frames[10, 240:], true.speed_m_s, rtol=0, atol=1e-6)
    touching = rows(server, run, 'contact')
    point_m = json.loads(get(server, 'contact.json'))['point_m']
    assert touching[0, :2] == pytest.approx(point_m, abs=1e-6)    # at the head's front left corner


def test_clearance_vanishes_at_the_contact(server):
    curve = json.loads(get(server, 'clearance.json'))
    assert np.interp(412.4738377, curve['t_s'], curve['gap_mm']) == pytest.approx(0, abs=0.05)


def test_a_bag_is_served_like_its_scene(server, bag, tmp_path, write_bag):
    run = json.loads(get(server, 'run.json'))
    with BagReader(bag) as opened, serving(dragon_in(opened)) as other:
        seen = json.loads(get(other, 'run.json'))
        assert seen['times_s'] == pytest.approx(run['times_s'])
        assert (seen['track'], seen['speeds']) == (None, True)
        np.testing.assert_allclose(rows(other, seen, 0), rows(server, run, 0), rtol=0, atol=1e-6)
    still = write_bag(tmp_path / 'still.mcap', skip=('velocities',))
    with BagReader(still) as opened, serving(dragon_in(opened)) as other:
        assert json.loads(get(other, 'run.json'))['speeds'] is False


@pytest.fixture(scope='module')
def big():
    scene = load_scene('winding', ['dragon.benches=5000', 'track.start_turns=100', 'run.stop_s=0.4'])
    return SceneSource('big', scene)


@pytest.fixture(scope='module')
def big_server(big):
    with serving(big) as running:
        yield running


def test_of_a_big_dragon_all_handles_are_sent_and_nothing_is_left_out(big, big_server):
    run = json.loads(get(big_server, 'run.json'))
    assert (run['benches'], run['drawn'], run['placed'], run['note']) == (5000, 0, 5001, '')
    assert run['sizes'] == [[1, pytest.approx(1.705), 0.15], [4999, pytest.approx(1.1), 0.15]]
    frame = rows(big_server, run, 0)[0]
    np.testing.assert_allclose(frame[:10002], moment(big, 0.0).p.ravel(), rtol=0, atol=1e-5)
    assert np.all(np.isfinite(frame))


def test_a_single_bench_is_served():
    with serving(SceneSource('one', load_scene('winding', ['dragon.benches=1', 'run.stop_s=1']))) as server:
        run = json.loads(get(server, 'run.json'))
        assert (run['benches'], json.loads(get(server, 'contact.json'))) == (1, None)
        assert set(json.loads(get(server, 'clearance.json'))['gap_mm']) == {None}
        assert get(server, 'frames/contact') == b''
        assert rows(server, run, 0).shape == (51, 10)


@pytest.mark.parametrize('path', ['frames/1', 'frames/-1', 'frames/x', 'nothing', '../setup.py', 'frames/', '%2e%2e/',
                                  f'frames/{"1" * 5000}', '/[x/', '/[/run.json'])
def test_what_is_not_there_is_not_found(server, path):
    with pytest.raises(urllib.error.HTTPError, match='404') as error:
        get(server, path)
    error.value.close()


@pytest.mark.parametrize('host', ['example.org', '[', '[::1', '', '127.0.0.1.example.org', '%', 'localhost:x:y'])
def test_a_foreign_page_cannot_reach_it_by_another_name(server, host):
    connection = http.client.HTTPConnection(*server.server_address)
    with contextlib.closing(connection):
        connection.request('GET', '/run.json', headers={'Host': host})
        assert connection.getresponse().status == 403 or host == 'localhost:x:y'


@pytest.mark.parametrize('header', [{'Origin': 'http://example.org'}, {'Origin': 'null'},
                                    {'Origin': 'http://127.0.0.1:1'}, {'Sec-Fetch-Site': 'cross-site'},
                                    {'Sec-Fetch-Site': 'same-site'}])
@pytest.mark.parametrize('path', ['/', '/run.json', '/frames/0', '/nothing'])
def test_a_foreign_page_gets_nothing(server, path, header):
    connection = http.client.HTTPConnection(*server.server_address)
    with contextlib.closing(connection):
        connection.request('GET', path, headers=header)
        answer = connection.getresponse()
        assert (answer.status, answer.read()[:35]) == (403, b'this page is available only to itse')
        assert 'Access-Control-Allow-Origin' not in answer.headers


def test_the_page_itself_and_the_address_bar_get_their_answers(server):
    own = server.url.rstrip('/')
    for headers in ({'Origin': own, 'Sec-Fetch-Site': 'same-origin'}, {'Sec-Fetch-Site': 'none'}):
        connection = http.client.HTTPConnection(*server.server_address)
        with contextlib.closing(connection):
            connection.request('GET', '/run.json', headers=headers)
            assert connection.getresponse().status == 200


@pytest.mark.parametrize(('path', 'status'), [('/', 200), ('/frames/0', 200), ('/nothing', 404)])
def test_every_answer_forbids_frames_other_origins_and_guessed_types(server, path, status):
    connection = http.client.HTTPConnection(*server.server_address)
    with contextlib.closing(connection):
        connection.request('GET', path)
        answer = connection.getresponse()
        assert answer.status == status
        assert answer.headers['X-Content-Type-Options'] == 'nosniff'
        assert "frame-ancestors 'none'" in answer.headers['Content-Security-Policy']
        assert answer.headers['X-Frame-Options'] == 'DENY'


def test_connections_that_come_at_once_wait_until_the_server_accepts_them(scene):
    with ViewServer(ViewData(SceneSource('short', scene), iter)) as server, contextlib.ExitStack() as stack:
        for _ in range(VIEW_CONNECTIONS):       # no thread serves them yet
            stack.enter_context(socket.create_connection(server.server_address, timeout=10))


def test_who_asks_is_answered_however_many_connections_ask_for_nothing(scene):
    with serving(SceneSource('short', scene)) as server, contextlib.ExitStack() as stack:
        silent = [stack.enter_context(socket.create_connection(server.server_address))
                  for _ in range(VIEW_CONNECTIONS + 8)]
        for one in silent:
            with contextlib.suppress(OSError):      # the connection was closed
                one.sendall(b'G')
        assert json.loads(get(server, 'run.json'))['name'] == 'short'
        with contextlib.suppress(ConnectionError):
            assert silent[0].recv(1) == b''         # the oldest connection was closed to make room


@pytest.mark.parametrize('path', ['plotly.js', 'clearance.json', 'frames/0'])
def test_who_asks_is_answered_however_many_clients_never_read(scene, path):
    with serving(SceneSource('short', scene)) as server, contextlib.ExitStack() as stack:
        for _ in range(VIEW_CONNECTIONS + 8):
            client = stack.enter_context(socket.socket())
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
            client.connect(server.server_address)
            with contextlib.suppress(OSError):      # the connection was closed
                client.sendall(f'GET /{path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n'.encode() * 8)
        assert json.loads(get(server, 'run.json'))['name'] == 'short'


def test_a_request_has_a_deadline_however_steadily_its_bytes_come(scene, monkeypatch):
    monkeypatch.setattr(server_module, 'VIEW_IDLE_S', 0.5)
    with serving(SceneSource('short', scene)) as server, socket.create_connection(server.server_address) as slow:
        slow.settimeout(0.05)
        began, answer = time.monotonic(), None
        while answer is None:
            assert time.monotonic() < began + 60
            try:
                slow.sendall(b'G')
                answer = slow.recv(1)
            except TimeoutError:
                continue
            except ConnectionError:
                answer = b''
        assert answer == b''


@pytest.mark.parametrize('topic', ['handles', 'benches', 'velocities'])
@pytest.mark.parametrize('by_m', thinned([9e6, 1e8, 1e39, 1e149, 1e308], {9e6, 1e8, 1e308}.__contains__))
def test_a_bag_with_huge_numbers_is_shown_or_refused_in_words(tmp_path, topic, by_m):
    scene = load_scene('first_contact', ['dragon.benches=3', 'run.stop_s=400.1'])
    encode = encoders(scene)
    with BagWriter(tmp_path / 'a.mcap') as bag:
        for name in encode:
            bag.add_channel(f'/dragon/{name}', channels()[name])
        for k in range(6):
            for name in encode:
                data = bytearray(encode[name](tick(scene, k)))
                if name == topic and k > 2:
                    views = {'handles': lambda data: read_pose_array(data).poses, 'benches': lambda data:
                             read_marker_array(data).geometry[0], 'velocities': lambda data: read_multi_array(data)[1]}
                    views[name](data)[:, :2] += by_m
                bag.write(f'/dragon/{name}', bytes(data), scene.run.time_ns(k), k + 1)
    with BagReader(tmp_path / 'a.mcap') as reader, contextlib.nullcontext() if by_m < 1e7 else pytest.raises(
            InputError, match=f'/dragon.* at .*{topic}: .*1e\\+07'):
        data = ViewData(dragon_in(reader), iter)
        json.dumps((data.run(), data.clearance(), data.contact()), allow_nan=False)
        assert data.frames(0)


def test_a_taken_port_is_said_in_one_line(capsys, server):
    port = server.server_address[1]
    assert main(['view', '--no-browser', '--port', str(port)]) == 2
    assert f'--port {port}' in capsys.readouterr().err
    assert main(['view', '--no-browser', '--port', '70000']) == 2


def test_the_viewer_library_is_the_one_that_its_note_names():
    note = (WEB / 'README.md').read_text()
    assert sha256((WEB / 'plotly-basic.min.js').read_bytes()).hexdigest() in note


@pytest.mark.parametrize('number', thinned([signal.SIGINT, signal.SIGTERM, signal.SIGHUP],
                                           lambda number: number == signal.SIGHUP))
def test_a_signal_ends_it_cleanly(short, number):
    command = [sys.executable, '-m', 'dragon_ros', 'view', '--no-browser', *short]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as view:
        line = view.stdout.readline()
        assert re.search(r'http://127\.0\.0\.1:\d+/', line)
        view.send_signal(number)
        _, errors = view.communicate(timeout=30)
        assert (view.returncode, errors) == (0, '')


def test_the_page_plays_in_a_browser(tmp_path, server, page):
    page.open_view(server.url)
    shown = 'return parseFloat(document.getElementById("time").textContent)'
    drawn = 'return document.querySelectorAll("#scene .scatterlayer .trace").length'
    assert (page.run(shown), page.run(drawn)) == (412.0, 5)
    before = page.run('return document.querySelector("#scene .scatterlayer .fills path").getAttribute("d")')
    page.click('play')
    page.wait(shown.replace('return', 'return 413 ==='))
    page.wait('return document.getElementById("play").textContent === "Play"')
    after = page.run('return document.querySelector("#scene .scatterlayer .fills path").getAttribute("d")')
    assert before != after
    page.click('back')
    page.wait(shown.replace('return', 'return 412.95 ==='))
    page.click('contact')
    page.wait('return document.getElementById("time").textContent === "412.473838 s"')
    low, high = page.run('return document.getElementById("scene").layout.xaxis.range')
    assert low < 1.4744 < high < low + 4
    page.run('location.hash = "#t=412.3"')
    page.wait(shown.replace('return', 'return 412.3 ==='))
    page.screenshot(tmp_path / 'contact.png')
    assert (tmp_path / 'contact.png').stat().st_size > 20_000
    assert page.run('return performance.getEntriesByType("resource").map((r) => new URL(r.name).host)'
                    '.filter((host) => host !== location.host)') == []
    assert page.log() == []


# The boxes of the page's visible titles and controls, as (text, left, top, right, bottom).
BOXES = """return [...document.querySelectorAll(
    'h1, h2, #facts, #legend span, button, select, #time, .xtitle, .ytitle')]
    .filter((one) => one.getClientRects().length && !one.hidden).map((one) => {
        const {left, top, right, bottom} = one.getBoundingClientRect();
        return [one.id || one.textContent, left, top, right, bottom]; })"""


def lie_on_each_other(boxes):
    return [(one[0], other[0]) for n, one in enumerate(boxes) for other in boxes[n + 1:]
            if min(one[3], other[3]) - max(one[1], other[1]) > 1 and min(one[4], other[4]) - max(one[2], other[2]) > 1]


def test_the_page_fits_a_phone_and_a_desk_in_the_light_and_in_the_dark(server, page):
    for width, height, dark in ((390, 844, False), (390, 844, True), (1400, 860, True)):
        page.look(width, height, dark)
        page.open_view(server.url)
        assert page.run('return document.scrollingElement.scrollWidth <= window.innerWidth')
        controls = 'const all = document.querySelectorAll("footer *"); return [...all].every((one) => '
        assert page.run(controls + 'one.getBoundingClientRect().right <= window.innerWidth)')
        for plot, least in (('scene', 300), ('clearance', 180), ('speeds', 180)):
            area = page.run(f'const r = document.querySelector("#{plot} .bglayer, #{plot} .cartesianlayer .plot")'
                            '.closest("svg").getBoundingClientRect(); return [r.width, r.height]')
            assert min(area) >= least, (plot, area)
        page.run('window.scrollTo(0, 0); document.querySelector("footer").style.position = "static"')
        assert lie_on_each_other(page.run(BOXES)) == []
        lightness = 'return getComputedStyle(%s).%s.match(/\\d+/g).slice(0, 3).reduce((a, b) => +a + +b, 0)'
        paper, ink = (page.run(lightness % ('document.body', name)) for name in ('backgroundColor', 'color'))
        curve = page.run(lightness % ('document.querySelector("#speeds .lines path")', 'stroke'))
        assert (paper < 150 < 500 < ink) if dark else (paper > 600 > 200 > ink)
        assert abs(curve - paper) > 200
    page.look(1400, 860)        # without a reload
    page.wait(f'{lightness % ("document.querySelector(chr)", "fill")} < 200'.replace('chr', '"#scene .xtitle"'))
    assert page.log() == []


def test_the_page_is_played_by_keys_wherever_the_focus_is(server, page):
    page.open_view(server.url)
    shown = 'return parseFloat(document.getElementById("time").textContent) === '
    for focus in ('play', 'scrub', 'contact', None):
        page.run(f'document.getElementById("{focus}")?.focus()' if focus else 'document.activeElement.blur()')
        for key, t_s in (('End', 413), ('ArrowLeft', 412.95), ('Home', 412), ('ArrowRight', 412.05)):
            page.press(key)
            page.wait(f'{shown}{t_s}')
    page.press(' ')
    page.wait('return document.getElementById("play").textContent === "Pause"')
    page.press(' ')
    page.wait('return document.getElementById("play").textContent === "Play"')


def test_play_is_the_first_button_in_the_order_of_tab(server, page):
    page.open_view(server.url)
    page.press('Tab')
    assert page.run('return document.activeElement.id') == 'play'


def test_keys_work_while_the_plots_are_still_built(server, page):
    page.open(server.url)
    page.press('End')       # whenever it arrives, before or after the run is known
    page.wait('return document.body.dataset.drawn === "yes"')
    page.press('End')
    page.press('ArrowLeft')
    page.wait('return document.body.dataset.ready === "yes"')
    page.wait('return parseFloat(document.getElementById("time").textContent) === 412.95')
    assert page.log() == []


@pytest.mark.parametrize('press_at', ['run', 'player.frame', 'element("scene")._fullLayout'])
def test_a_key_that_comes_while_a_page_loads_is_not_lost(server, page, press_at):
    page.open('about:blank')
    page.open(server.url)
    page.run(f"""return new Promise((done) => {{
        const look = () => {{
            let is = false;
            try {{ is = Boolean({press_at}); }} catch {{ /* not yet declared */ }}
            if (is) done(document.dispatchEvent(new KeyboardEvent('keydown', {{key: 'End', bubbles: true}})));
            else setTimeout(look, 1);
        }};
        look();
    }})""")
    page.wait('return document.body.dataset.ready === "yes"')
    page.wait('return parseFloat(document.getElementById("time").textContent) === 413')
    assert page.log() == []


def test_on_a_phone_on_its_side_the_controls_do_not_cover_the_dragon(server, page):
    page.look(844, 390)
    page.open_view(server.url)
    lowest, controls = page.run("""return [document.querySelector('#scene .main-svg')
        .getBoundingClientRect().bottom, document.querySelector('footer').getBoundingClientRect().top]""")
    assert lowest <= controls
    assert page.run('return document.querySelector("#scene").getBoundingClientRect().height') >= 180
    assert page.run('return document.scrollingElement.scrollWidth <= window.innerWidth')


def test_the_window_shows_the_whole_venue():
    scene = load_scene('square')
    (left, bottom), (right, top) = ViewData(SceneSource('square', scene), iter).run()['window_m']
    x, y = np.array(scene.venue.inside).T
    assert all((left < x.min(), right > x.max(), bottom < y.min(), top > y.max()))


def test_outlines_scale_with_the_zoom(server, page):
    page.open_view(server.url)
    width = 'return parseFloat(getComputedStyle(document.querySelector("#scene .lines path.js-line")).strokeWidth)'
    wide = 'return parseFloat(getComputedStyle(document.querySelectorAll("#scene .trace .js-line")[1]).strokeWidth)'
    page.wait('const plot = element("scene"); return plot._fullLayout.height === plot.clientHeight '
              '&& player.outline === outline()')
    before = page.run(wide)
    page.click('contact')
    page.wait(f'{wide} > {2 * before}')
    page.click('whole')
    page.wait('return player.outline === outline()')        # the view may have got another size since
    page.wait(f'{wide} < {1.2 * before}')
    x, y = page.run('const {xaxis, yaxis} = element("scene")._fullLayout; '
                    'return [xaxis, yaxis].map(({range, _length}) => (range[1] - range[0]) / _length)')
    assert x == pytest.approx(y, rel=1e-3)      # one scale, although the contact was still being drawn
    assert 0 < before < 1
    assert page.run(width) == 0.8       # the track is drawn as a line


def test_the_first_frame_is_drawn_before_the_contact_is_searched(scene, page):
    class Slow(SceneSource):
        def first_touch(self, progress):
            wait.wait(60)
            return super().first_touch(progress)
    wait = threading.Event()
    with serving(Slow('slow', scene)) as server:
        page.open(server.url)
        page.wait('return document.body.dataset.drawn === "yes"')
        assert not page.run('return document.body.dataset.ready')
        wait.set()
        page.wait('return document.body.dataset.ready === "yes"')


def test_the_first_window_is_the_whole_one_though_the_page_got_another_size_before_the_contact_was_known(scene, page):
    class Slow(SceneSource):
        def first_touch(self, progress):
            wait.wait(60)
            return super().first_touch(progress)
    wait = threading.Event()
    settled = ('const plot = element("scene"); return plot._fullLayout.height === plot.clientHeight '
               '&& player.outline === outline()')
    page.look(1200, 900)
    with serving(Slow('slow', scene)) as server:
        page.open(server.url)
        page.wait('return document.body.dataset.drawn === "yes"')
        for size in ((900, 900), (1200, 500), (1200, 900)):
            page.look(*size)
            page.wait(settled)
        wait.set()
        page.wait('return document.body.dataset.ready === "yes"')
        page.wait('const {xaxis, yaxis} = element("scene")._fullLayout, whole = wholeRange(); '
                  'return [xaxis, yaxis].some(({range, _name}) => range.every((end, n) => '
                  'Math.abs(end - whole[`${_name}.range`][n]) < 1e-6))')


def test_an_animation_as_a_page_runs_its_own_scripts_and_nothing_else(tmp_path, scene):
    source, path = SceneSource('short', scene), tmp_path / 'run.html'
    write_page(source, source.ticks_s(412.0, 412.1, 2), 2.0, path, iter)
    page = path.read_text()
    policy = re.search(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">', page)[1]
    scripts = re.findall(r'<script>(.*?)</script>', page, re.DOTALL)
    digests = {f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'" for script in scripts}
    assert len(digests) == 6
    assert set(re.search('script-src ([^;]*)', policy)[1].split()) == digests
    assert "default-src 'none'" in policy


def test_an_animation_as_a_page_plays_without_a_server(tmp_path, scene, page):
    source, path = SceneSource('short', scene), tmp_path / 'run.html'
    write_page(source, source.ticks_s(412.0, 412.6, 7), 2.0, path, iter)
    page.open_view(path.as_uri())
    assert page.run('return document.getElementById("pace").value') == '2'
    page.press(' ')
    page.wait('return document.getElementById("time").textContent === "412.60 s"')
    page.click('contact')
    page.wait('return document.getElementById("time").textContent === "412.473838 s"')
    assert page.run('return performance.getEntriesByType("resource").length') == 0
    assert page.log() == []


def test_an_animation_that_ends_before_the_contact_says_so(tmp_path, scene, page):
    source, path = SceneSource('short', scene), tmp_path / 'run.html'
    write_page(source, source.ticks_s(412.0, 412.2, 3), 2.0, path, iter)
    page.open_view(path.as_uri())
    facts = page.run('return document.getElementById("facts").textContent')
    assert facts.endswith('benches 0 and 8 touch at 412.473838 s, after the end of the period shown')


def window_of(page):
    return np.array(page.run('const {xaxis, yaxis} = document.getElementById("scene")._fullLayout; '
                             'return [xaxis.range, yaxis.range]'))


def test_many_benches_are_drawn_where_they_are_at_every_zoom(big, big_server, page):
    """No line crosses the empty middle of the spiral, and rectangles have the corners of the model."""
    true = moment(big, 0.0)
    seen = ('const {data, width, height} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height); '
            'let many = 0; for (let y = 0; y < height; y++) for (let x = 0; x < width; x++) '
            'if (data[4 * (y * width + x) + 3] && %s) many += 1; return many')
    page.open_view(big_server.url)
    (left, right), (bottom, top) = window_of(page)
    inner = 0.9 * float(np.min(np.hypot(*true.p.T)))
    place = f'Math.hypot({left} + (x + 0.5) / width * {right - left}, {top} - (y + 0.5) / height * {top - bottom})'
    assert inner > 3
    assert page.run(seen % f'{place} < {inner - 1}') == 0
    assert page.run(seen % 'true') > 10_000
    corners = np.array(page.run('return [0, 1, 4999].map((bench) => cornersOf(player.frame.subarray(0, '
                                '2 * run.placed), player.halves, bench))')).reshape(3, 4, 2)
    for made, right_ones in zip(corners, true.benches.corners[[0, 1, 4999]], strict=True):
        apart = np.hypot(*(made[:, None] - right_ones[None]).transpose(2, 0, 1))
        assert apart.min(axis=1).max() < 2e-5
    assert 'draw calls per frame on a canvas' in page.run('return document.getElementById("scale").textContent')
    page.press('f')
    page.wait('return cost.calls < 20 && cost.drawn < 200')       # only visible benches are drawn
    assert [said for level, said in page.log() if level != 'warning'] == []    # the warnings are about reading pixels


# The difference between the canvas picture and WebGL pictures drawn at the same place and one pixel to the right.
# Each value is the share of pixels that differ by more than an eighth of the range of shades, in the whole picture and
# within 40 pixels of the first handle.
APART = """const plot = document.getElementById('scene'), {range, _length} = plot._fullLayout.xaxis;
  const pixels = (webgl, moved) => {
    drawBy(webgl);
    const p = player.frame.slice(0, 2 * run.placed);
    for (let n = 0; n < p.length; n += 2) p[n] += moved * (range[1] - range[0]) / _length;
    drawBenches(plot, run.track, p, player.halves, [1, 2]);
    const copy = document.createElement('canvas'), {width, height} = canvas, context = copy.getContext('2d');
    Object.assign(copy, {width, height});
    context.fillStyle = colour('page');
    context.fillRect(0, 0, width, height);
    context.drawImage(canvas, 0, 0);
    const scale = scaleOf(plot), [x, y] = player.frame;
    const head = [(x - scale.left) * scale.x - 20, (scale.top - y) * scale.y - 20, 40, 40];
    return [[0, 0, width, height], head].map((part) => context.getImageData(...part).data);
  };
  const apart = (one, other) => {
    let many = 0;
    for (let n = 0; n < one.length; n += 4) {
      if ([0, 1, 2].some((part) => Math.abs(one[n + part] - other[n + part]) > 32)) many += 1;
    }
    return 4 * many / one.length;
  };
  const true_one = pixels(false, 0);
  return [0, 1].map((moved) => pixels(true, moved).map((part, n) => apart(part, true_one[n])));"""


def test_webgl_draws_the_picture_of_the_canvas_and_gives_way_to_it(big_server, page):
    page.open_view(big_server.url)
    assert page.run('return cost.webgl') is False       # in software, WebGL would be slower than the canvas
    apart = [page.run(APART)]
    page.press('f')
    page.wait('return shownSpan() < 20')
    apart += [page.run(APART)]
    page.look(1400, 860, dark=True)
    apart += [page.run(APART)]
    for (whole, head), (moved, moved_head) in apart:
        assert whole < 0.003 < 0.05 < moved
        assert head < 0.01 < 0.02 < moved_head
    page.press('g')
    page.press('g')
    assert 'one draw call per frame with WebGL' in page.run('return document.getElementById("scale").textContent')
    page.run('canvas.getContext("webgl2").getExtension("WEBGL_lose_context").loseContext()')
    page.wait('return !cost.webgl && cost.calls > 1')
    assert 'on a canvas' in page.run('return document.getElementById("scale").textContent')
    assert [said for level, said in page.log() if level != 'warning'] == []


def test_the_page_follows_the_head_and_remembers_it(server, scene, page):
    page.open_view(server.url)
    pressed = 'return document.getElementById("follow").getAttribute("aria-pressed")'
    assert page.run(pressed) == 'false'
    page.press('f')
    page.wait('return player.following')
    for t_s in (412.0, 413.0):
        page.press('End' if t_s > 412 else 'Home')
        page.wait(f'return parseFloat(document.getElementById("time").textContent) === {t_s} && !player.drawing')
        head = moment(SceneSource('short', scene), t_s).benches.centre[0]
        assert window_of(page).mean(axis=1) == pytest.approx(head, abs=0.01)
    with serving(SceneSource('short', scene)) as later:     # another run on another port
        page.open_view(later.url)
        page.wait(pressed + ' === "true"')
        page.click('whole')
        page.wait(pressed + ' === "false"')


def test_the_page_zooms_by_keys_and_by_two_fingers_and_says_how_wide_a_bench_is(server, page):
    page.look(390, 844)
    page.open_view(server.url)
    before = np.ptp(window_of(page), axis=1)
    page.press('+')
    page.wait(f'return Math.abs(shownSpan() * 1.25 - {before[0]}) < 1e-6')
    page.press('-')
    page.wait(f'return Math.abs(shownSpan() - {before[0]}) < 1e-6')
    page.run("""const scene = document.getElementById('scene'), box = scene.getBoundingClientRect();
        const fingers = (apart) => [-1, 1].map((side) => new Touch({identifier: side, target: scene,
          clientX: box.left + box.width / 2 + side * apart, clientY: box.top + box.height / 2}));
        for (const [kind, apart] of [['touchstart', 20], ['touchmove', 40]])
          scene.dispatchEvent(new TouchEvent(kind, {touches: fingers(apart), cancelable: true}))""")
    page.wait(f'return Math.abs(shownSpan() * 2 - {before[0]}) < 1e-6')
    long, wide = map(float, re.search(r'([\d.]+) × ([\d.]+) pixels', page.wait(
        'return document.getElementById("scale").textContent')).groups())
    pixels = page.run('return document.getElementById("scene")._fullLayout.xaxis._length') / before[0] * 2
    assert (long, wide) == (pytest.approx(2.2 * pixels, rel=0.06), pytest.approx(0.3 * pixels, rel=0.06))


@pytest.mark.parametrize('name', ['<img src=x onerror=alert(1)>', '"><script>alert(1)<_script>', '$\\frac{1}{0}$',
                                  'javascript:alert(1)', 'a](b)&amp;'])
def test_nothing_in_the_name_of_a_scene_or_of_an_obstacle_is_executed(capsys, tmp_path, name):
    scene = tmp_path / f'{name}.yaml'
    scene.write_text('dragon: {benches: 9}\nrun: {stop_s: 1}\nvenue:\n  obstacles:\n    - {kind: line, points_m: '
                     f'[[20, 0], [21, 0]], name: {json.dumps(name)}}}\n')
    files = [tmp_path / f'out{suffix}' for suffix in ('.html', '.svg', '.pdf')]
    for file in files:
        kind = ['animation', '--pace', '0.1'] if file.suffix == '.html' else ['dragon']
        code = main(['plot', *kind, '--scene', str(scene), '--output', str(file)])
        assert (code, capsys.readouterr().err) == (0, '')
    page, picture = (file.read_text(encoding='utf-8') for file in files[:2])
    assert name not in page     # it is in the embedded data, as base64
    assert any(name in (element.text or '') for element in ElementTree.fromstring(picture).iter())
    assert not re.search('<(img|script)|href="javascript', picture)
    assert b'/JavaScript' not in files[2].read_bytes()
    with serving(SceneSource(name, load_scene(str(scene)))) as server:
        assert json.loads(get(server, 'run.json'))['name'] == name
        assert name.encode() not in get(server, '')
