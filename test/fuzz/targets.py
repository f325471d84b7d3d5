"""The fuzz targets: each takes bytes as untrusted input and may raise only the package's own errors."""
import contextlib
import io
import json
import os
import socket
import struct
import threading
import zipfile
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import mixes
import numpy as np
from mcap.opcode import Opcode

from dragon_ros.bags.check.examine import examine
from dragon_ros.bags.check.repair import repair
from dragon_ros.bags.read.frames import frames, scene_of_bag
from dragon_ros.bags.read.reader import BagReader
from dragon_ros.bags.write.writer import BagOptions, BagWriter
from dragon_ros.configuration import scene_names
from dragon_ros.core.chain.dragon import Dragon
from dragon_ros.core.errors import DragonError, InputError
from dragon_ros.core.geometry.near_obstacles import NearObstacles
from dragon_ros.core.geometry.near_pairs import closeness
from dragon_ros.core.geometry.rectangles import Benches
from dragon_ros.core.model import compile_scene
from dragon_ros.core.scene import Run, Scene
from dragon_ros.core.step import tick
from dragon_ros.messages.cdr import Writer, string_message
from dragon_ros.messages.channels import channels
from dragon_ros.messages.encode import encoders
from dragon_ros.messages.latched import latched_messages
from dragon_ros.messages.surroundings import CellRules, read_grid, read_venue
from dragon_ros.messages.transforms import FrameTree
from dragon_ros.scenes.load import load_scene, strangers_scene
from dragon_ros.scenes.provenance import run_metadata, scene_file

ROOT = Path(__file__).parents[2]
_HEAD = struct.Struct('<BQ')
_MAGIC = 8
SCENE = Scene(dragon=Dragon(3), run=Run(412, 412.1))


@dataclass(frozen=True)
class Target:
    """Seeds to mutate, words to insert, and ``run``, which processes the bytes and raises only unexpected errors."""

    seeds: list[bytes]
    run: Callable[[bytes], object]
    words: tuple[bytes, ...] = ()
    close: list[Callable[[], object]] = field(default_factory=list)


def bag(folder: Path) -> Target:
    """Bags with wrong lengths, counts and offsets, but correct CRCs."""
    def run(data: bytes) -> None:
        path, out = folder / 'a.mcap', folder / 'out.mcap'
        path.write_bytes(with_crcs(data))
        read_in_every_way(path, out)
    seeds = [path.read_bytes() for path in sorted((ROOT / 'test/data/corpus').glob('*.mcap'))
             if path.stat().st_size < 20_000 and not path.name.startswith('bomb')]
    words = (*(opcode.to_bytes(1, 'little') for opcode in range(1, 16)), bytes(8), b'\xff' * 8, b'\0\0\0\0\1\0\0\0')
    return Target([*seeds, small_bag(folder / 'seed.mcap')], run, words)


def read_in_every_way(path: Path, out: Path) -> None:
    """Read a bag in the same ways as the tools; only the package's own errors may be raised."""
    with suppress(DragonError):
        examine(path)
    with suppress(DragonError):
        repair(path, out)
    out.unlink(missing_ok=True)
    with suppress(DragonError), BagReader(path, damaged=True) as reader:
        deque(reader.messages(), maxlen=0)
    with suppress(DragonError), BagReader(path) as reader:
        deque(reader.messages(), maxlen=0)
        with suppress(DragonError):
            scene_of_bag(reader)
        for frame in frames(reader):
            assert frame.clearance_m is None or frame.clearance_m == frame.clearance_m


def small_bag(path: Path) -> bytes:
    """Return a bag of a small dragon with its scene."""
    encode, text = encoders(SCENE), scene_file(SCENE)
    with BagWriter(path, True, BagOptions('none')) as writer:
        for name in encode:
            writer.add_channel(f'/dragon/{name}', channels()[name])
        writer.describe('dragon_ros', run_metadata(text, SCENE, {}))
        for k in range(compile_scene(SCENE).last_tick + 1):
            for name in encode:
                writer.write(f'/dragon/{name}', encode[name](tick(SCENE, k)), SCENE.run.time_ns(k), k + 1)
    return path.read_bytes()


def with_crcs(data: bytes) -> bytes:
    """Return an MCAP file with correct CRCs of its uncompressed chunks and of its summary."""
    out, at, summary = bytearray(data), _MAGIC, None
    while at + _HEAD.size <= len(out):
        opcode, length = _HEAD.unpack_from(out, at)
        start, end = at + _HEAD.size, at + _HEAD.size + length
        if end > len(out):
            break
        if opcode == Opcode.CHUNK and length > 40:
            name = int.from_bytes(out[start + 28:start + 32], 'little')
            if name == 0:
                out[start + 24:start + 28] = zlib.crc32(out[start + 40:end]).to_bytes(4, 'little')
        elif opcode == Opcode.DATA_END:
            summary = end
        elif opcode == Opcode.FOOTER and length == 20 and summary is not None:
            out[start + 16:end] = zlib.crc32(out[summary:start + 16]).to_bytes(4, 'little')
        at = end
    return bytes(out)


def mix(folder: Path) -> Target:
    """Bags with unusual structures: all commands report the same contents, and a check accepts no difference."""
    def run(data: bytes) -> None:
        path = folder / 'mix.mcap'
        path.write_bytes(mixes.built(data))
        mixes.hold(path, folder)
    return Target(mixes.seeds(), run, tuple(bytes((what, argument)) for what in range(32) for argument in (0, 9, 77)))


def folder_of_parts(folder: Path) -> Target:
    """Bag folders with an arbitrary metadata.yaml."""
    bag_folder = folder / 'run'
    options = BagOptions('none', split_duration_s=0.03)
    with BagWriter(bag_folder, True, options) as writer:
        writer.add_channel('/dragon/handles', channels()['handles'])
        for k in range(4):
            data = encoders(SCENE)['handles'](tick(SCENE, k))
            writer.write('/dragon/handles', data, SCENE.run.time_ns(k), k + 1)
    listed = bag_folder / 'metadata.yaml'
    seed = listed.read_bytes()

    def run(data: bytes) -> None:
        listed.write_bytes(data)
        read_in_every_way(bag_folder, folder / 'out.mcap')
    return Target([seed], run, (b'../', b'run_0.mcap', b'\0', b'[', b'&a ', b'*a', b'!!int ""', b'/dev/zero'))


def scene(folder: Path) -> Target:
    """Texts of scenes, as on the topic ``scene`` and in bags."""
    def run(data: bytes) -> None:
        with suppress(DragonError):
            text = data.decode(errors='replace')
            run_metadata(text, strangers_scene('scene', text), {})
    seeds = [(ROOT / 'msg_configs/scenes' / f'{name}.yaml').read_bytes() for name in scene_names()]
    kinds = ('head: {kind: profile, knots: [[0, 1], [60, -1]], ramps: smooth}', 'track: {kind: joined, pieces: '
             '[{kind: line, length_m: 5}, {kind: arc, radius_m: 5, angle_deg: 30}]}', 'effects: [noise, trails]',
             'dragon: {kind: mixed, groups: [{length_m: 3.4}, {count: 20, length_m: 2.2}]}')
    return Target([*seeds, scene_file(SCENE).encode(), *(text.encode() for text in kinds)], run, _YAML)


_YAML = (b'[', b'{', b'? ', b'- ', b'!!int ""', b'!!binary x', b'&a ', b'*a', b'<<: *a', b'1e400', b'.nan', b'-.inf',
         b'9' * 400, b'0x' + b'f' * 5000, b'2001-01-01', b'null', b'~', b': ', b'\xff', b'\0', b'[a]', b'{a: b}',
         b'1e308', b'20000', b'-0.0', b'kind: mixed', b'kind: turn', b'lead: tail', b'accuracy: paper', b'about: ')


def override(folder: Path) -> Target:
    """Values of the option ``--set`` and of the parameter ``set``, one per line."""
    def run(data: bytes) -> None:
        with suppress(DragonError):
            load_scene('winding', data.decode(errors='replace').split('\n')[:8])
    seeds = [b'track.pitch_m=0.5', b'dragon.benches=20\nrun.rate_hz=10', b'head={kind: profile, knots: [[0, 1]]}',
             b'effects=[velocity, benches]', b'accuracy=1e-6\nsolver=march', b'run.stop_s=10\nrun.start_s=1']
    return Target(seeds, run, (b'=', b'.', b'\n', *_YAML))


def study(folder: Path) -> Target:
    """Study files, like those in a data set."""
    from dragon_studies.definition import load_study, study_from, study_names
    from dragon_studies.sampling import scene_values_of, values_of

    def run(data: bytes) -> None:
        with suppress(DragonError):
            found = study_from('study', data.decode(errors='replace'))
            scene_values_of(found, values_of(found, found.rows - 1))
    drawn = b'vary: {dragon.width_m: {normal: [0.3, 0.1], within: [0.2, 0.4]}}\ndesign: sobol\nsamples: 3\nask: [lock]'
    return Target([*(load_study(name).text.encode() for name in study_names()), b'scene: {}\n' + drawn], run,
                  (*_YAML, b'vary: ', b'per: bench', b'design: saltelli', b'dragon.groups.2.length_m', b'{from: 1}'))


def certificate(folder: Path) -> Target:
    """Certificates for the independent checker."""
    from dragon_ros.core.search.first_contact import first_contact
    from dragon_ros.scenes.certificate import as_values
    from dragon_ros.verify.errors import Refused
    from dragon_ros.verify.proof import prove
    from dragon_ros.verify.reading import claims_of
    changes = ['dragon.benches=9', 'run.start_s=399', 'run.stop_s=400']
    seeds = [load_scene('winding', changes), load_scene('turning', ['dragon.benches=4', 'run.stop_s=1'])]

    def run(data: bytes) -> None:
        # The errors that the checker's command line handles.
        with suppress(Refused, ArithmeticError, ValueError, RecursionError, MemoryError):
            prove(claims_of(data), 0.01, lambda *told: None)
    return Target([json.dumps(as_values(one, first_contact(one))).encode() for one in seeds], run,
                  (b'1e400', b'NaN', b'9' * 500, b'[' * 2000, b'"', b'{}', b'null', b'true', b'-1', b'{"kind": 1}'))


def request(folder: Path) -> Target:
    """Requests to the web view with ``--try``, as bytes on a socket."""
    from dragon_ros.commands.view.server import ViewServer
    from dragon_ros.commands.view.variants import Variants
    escaped: list[BaseException] = []

    class Server(ViewServer):
        def handle_error(self, request: object, client_address: object) -> None:
            import sys
            error = sys.exc_info()[1]
            if error is not None and not isinstance(error, (ConnectionError, TimeoutError)):
                escaped.append(error)
    server = Server(Variants('seed', 'winding', ['dragon.benches=3', 'run.stop_s=0.1']))
    thread = threading.Thread(target=server.serve_forever, kwargs={'poll_interval': 0.01})
    thread.start()

    def run(data: bytes) -> None:
        with socket.create_connection(server.server_address, timeout=20) as stream, suppress(ConnectionError):
            stream.sendall(data)
            with suppress(OSError):     # the server has already closed the connection
                stream.shutdown(socket.SHUT_WR)
            while stream.recv(2**16):
                pass
        if escaped:
            raise escaped.pop()

    def close() -> None:
        server.shutdown()
        server.server_close()
        thread.join()
    paths = ('/', '/run.json', '/clearance.json', '/frames/0', '/frames/contact', '/view.js', '/form.json',
             '/answers/room?dragon.benches=2', '/scene.yaml?track.pitch_m=0.6&head.speed_m_s=2')
    seeds = [f'GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n'.encode() for path in paths]
    return Target(seeds, run, (b'\r\n', b'[', b'Host: [', b'HEAD', b'POST', b'9' * 5000, b'%2e%2e/', b'\0', b'HTTP/9.9',
                               b'//', b'?', b'#', b'Content-Length: -1', b'Expect: 100-continue'), [close])


def command_line(folder: Path) -> Target:
    """Command lines that need no ROS and write nothing, one argument per line."""
    from dragon_ros.__main__ import main
    small_bag(folder / 'a.mcap')

    def run(data: bytes) -> None:
        arguments = data.decode(errors='replace').split('\n')
        if arguments[0] not in ('table', 'inspect', 'design', 'plot') or any('output' in one for one in arguments):
            return
        before = os.getcwd()
        os.chdir(folder)
        try:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said := io.StringIO()):
                code = main(arguments)
        except SystemExit as end:
            code = end.code
        finally:
            os.chdir(before)
        assert code in (0, 1, 2, 3), code
        assert 'Traceback' not in said.getvalue()
    seeds = ['table\n--times\n0,60\n--handles\n0,1', 'table\na.mcap\n--times\n412.02', 'table\n--set\ndragon.benches=5',
             'inspect\na.mcap', 'inspect\na.mcap\n--check\n--format\njson', 'inspect\na.mcap\n--looks\n3',
             'design\nturn', 'plot\nspeeds\n--bag\na.mcap\n--time\n9', 'table\n--accuracy\n1e-6']
    return Target([one.encode() for one in seeds], run, (
        b'--help', b'inf', b'nan', b'-1', b'1e400', b'9' * 400, b'\0', b'\n', b'--', b'--trust', b'\xff', b'/dev/zero',
        b'/proc/self/mem', b',', b'--json', b'--scene', b'..', b'--check', b'--bag', b'paper'))


def message(folder: Path) -> Target:
    """Messages for the callbacks of recorder and monitor: a byte that selects the topic, followed by the message."""
    import rclpy

    from dragon_ros.bags.write.writer import BagWriter
    from dragon_ros.nodes.monitor import Monitor
    from dragon_ros.nodes.record import Recorder
    context_was = rclpy.ok()
    if not context_was:
        rclpy.init()
    monitor, recorder = Monitor(), Recorder(BagWriter(folder / 'messages.mcap', True))
    names = list(channels())
    take = {name: recorder.recording.receiver(channels()[name]) for name in names}
    numbers = iter(range(1, 10**9))

    def run(data: bytes) -> None:
        name, n = names[data[0] % len(names)] if data else names[0], next(numbers)
        info = {'source_timestamp': n, 'received_timestamp': n, 'publication_sequence_number': n}
        take[name](data[1:], info)
        recorder.poll(True)
        if name in ('handles', 'benches'):
            monitor._ticks._inbox.put(name, channels()[name].type, data[1:], info)
            monitor._ticks._inbox.work()

    def close() -> None:
        recorder.close()
        for node in monitor, recorder:
            node.destroy_node()
        if not context_was:
            rclpy.shutdown()
    every = Scene(dragon=Dragon(3), run=Run(412, 412.1))
    triangles = Scene(dragon=Dragon(3), run=Run(412, 412.1), markers='triangles')
    made = [(name, encode(tick(one, k))) for one in (every, triangles) for k in (0, 1)
            for name, encode in encoders(one).items()]
    made += [('scene', string_message(scene_file(SCENE))), ('track', bytes(60)), ('collision', b'\0\1\0\0' + bytes(20))]
    seeds = [bytes([names.index(name)]) + data for name, data in made]
    return Target(seeds, run, (bytes(4), b'\xff' * 4, b'\0\0\0\x80', b'\1\0\0\0', b'\0\0\0\0\0\0\xf8\x7f', b'bench\0',
                               *(bytes([n]) for n in range(len(names)))), [close])


def obstacles(folder: Path) -> Target:
    """Venues, maps and transforms for the monitor: a byte that selects the reader, followed by the message."""
    numbers = range(4)
    benches = Benches(np.array([[2.0 * n, 0.0] for n in numbers]), np.array([[1.0, 0.0] for _ in numbers]),
                      np.full(4, 0.9), np.full(4, 0.15))
    handles = np.concatenate((benches.centre, benches.centre[-1:] + 2))

    def run(data: bytes) -> None:
        with suppress(InputError):
            read(data[0] % 3 if data else 0, data[1:])

    def read(kind: int, message: bytes) -> None:
        if kind == 2:
            tree = FrameTree()
            tree.take(message)
            tree.pose('map', 'dragon')
            return
        located = read_venue(message) if kind else read_grid(message, CellRules(unknown=True))
        if located.around:
            near = NearObstacles(located.around)
            for _ in range(2):
                near.look(closeness(handles, benches), benches)
    grid, frames_ = Writer(), Writer()
    grid.header('map', 0)
    grid.put('I', 0, 0)
    grid.put('f', 0.5)
    grid.put('I', 3, 2)
    grid.put('d', 0, 0, 0, 0, 0, 0, 1)
    grid.put('I', 6)
    grid.put('b', 0, 100, 0, 65, 100, -1)
    frames_.put('I', 2)
    for parent, child in (('hall', 'map'), ('hall', 'dragon')):
        frames_.header(parent, 0)
        frames_.text(child)
        frames_.put('d', 1, 2, 0, 0, 0, 0, 1)
    seeds = [b'\0' + bytes(grid.finish()), b'\2' + bytes(frames_.finish()),
             *(b'\1' + latched_messages(load_scene(name), 'dragon')['venue'] for name in ('street', 'square'))]
    return Target(seeds, run, (bytes(4), b'\xff' * 4, b'\0\0\0\x80', b'\1\0\0\0', b'\0\0\0\0\0\0\xf8\x7f', b'venue\0',
                               b'line\0', b'\0\0\0\0\0\0\xf0\x3f', b'map\0'))


def workbook(folder: Path) -> Target:
    """Sheets of workbooks that are graded: the XML for a valid archive or, after a Z, the whole archive."""
    import zipfile

    from dragon_contest.grade.team import Team, grade_team
    path = folder / 'result1.xlsx'
    main = 'http://schemas.openxmlformats.org/spreadsheetml/2006/main'
    office = 'http://schemas.openxmlformats.org/officeDocument/2006/relationships'
    relations = 'http://schemas.openxmlformats.org/package/2006/relationships'
    kinds = 'application/vnd.openxmlformats-officedocument.spreadsheetml'
    parts = {
        '[Content_Types].xml': f'<Types xmlns="{relations[:-13]}content-types"><Default '
        f'Extension="xml" ContentType="{kinds}.worksheet+xml"/><Override PartName="/xl/workbook.xml" '
        f'ContentType="{kinds}.sheet.main+xml"/></Types>',
        '_rels/.rels': f'<Relationships xmlns="{relations}"><Relationship Id="a" Type="{office}/officeDocument" '
        'Target="xl/workbook.xml"/></Relationships>',
        'xl/workbook.xml': f'<workbook xmlns="{main}" xmlns:r="{office}"><sheets><sheet name="a" sheetId="1" '
        'r:id="b"/></sheets></workbook>',
        'xl/_rels/workbook.xml.rels': f'<Relationships xmlns="{relations}"><Relationship Id="b" '
        f'Type="{office}/worksheet" Target="worksheets/sheet1.xml"/></Relationships>'}

    def archive(page: bytes) -> bytes:
        out = io.BytesIO()
        with zipfile.ZipFile(out, 'w', zipfile.ZIP_DEFLATED) as book:
            for name, part in parts.items():
                book.writestr(name, part)
            book.writestr('xl/worksheets/sheet1.xml', page)
        return out.getvalue()

    def run(data: bytes) -> None:
        path.write_bytes(data[1:] if data[:1] == b'Z' else archive(data))
        for grade in grade_team(Team('a', [path])).sheets:
            assert grade.explains is None or grade.explains <= 1
    cells = ''.join(f'<c r="{"BCD"[n]}2"><v>{n}.5</v></c>' for n in range(3))
    page = (f'<worksheet xmlns="{main}"><sheetData><row r="1"><c r="A1" t="inlineStr"><is><t>handle</t></is></c>'
            '<c r="B1" t="str"><v>x</v></c><c r="C1" t="str"><v>y</v></c><c r="D1" t="str"><v>v</v></c></row>'
            f'<row r="2"><c r="A2"><v>0</v></c>{cells}</row></sheetData><mergeCells>'
            '<mergeCell ref="A1:A1"/></mergeCells></worksheet>').encode()
    return Target([page, b'Z' + archive(page)], run, (
        b'r="XFD1048576"', b'<f>1</f>', b'<c/>', b'<row>', b'<v>1e400</v>', b'nan', b't="e"', b't="s"', b't="b"',
        b'0 s', b'&#0;', b'<!DOCTYPE a>', b'\xff', b't="d"', b'<v>2024-01-01T00:00:00</v>',
        b'<mergeCell ref="A1:XFD9"/>'))


def drawing(folder: Path) -> Target:
    """Drawings for ``route``: a byte that selects the format, followed by an SVG, a CSV file or a nav_msgs/Path."""
    from dragon_ros.core.tracks.drawn import along
    from dragon_ros.messages.decode import read_path
    from dragon_ros.scenes.drawings import csv_line, svg_line
    svg, csv = folder / 'a.svg', folder / 'a.csv'

    def run(data: bytes) -> None:
        with suppress(DragonError):
            if data[:1] == b'S':
                svg.write_bytes(data[1:])
                along(svg_line(svg, None, (0.1, False)).parts, 3.0, 1.5, 0.5)
            elif data[:1] == b'C':
                csv.write_bytes(data[1:])
                along(csv_line(csv, 1.0).placed(None).parts, 3.0, 1.5, 0.5)
            else:
                read_path(data[1:])
    curves = (b'S<svg width="9mm" viewBox="0 0 9 9"><g transform="scale(9)">'
              b'<path d="M1 2h40c9 0 9 9 0 9a9 5 2 0 1 5 9q1 1 5 2"/></g></svg>')
    seeds = [curves, b'Cx,y\n0,0\n60,0\n60,50\n', b'P\0\1\0\0' + bytes(8) + b'\1\0\0\0\0\0\0\0\1\0\0\0'
             + bytes(80)]
    return Target(seeds, run, (b'nan', b'1e400', b'<g>', b'<use href="#a"/>', b'rotate(1e99)', b'z', b'M', b'\xff',
                               b'S', b'C'))


def map_file(folder: Path) -> Target:
    """Maps for ``route``: a byte that selects the format, followed by GeoJSON, WKT, GPX, KML, KMZ or OSM."""
    from dragon_ros.scenes.drawings import map_line
    from dragon_ros.scenes.georeference import own_origin
    from dragon_ros.scenes.maps import read_drawing
    from dragon_ros.scenes.venue_files import venue_of
    suffixes = {b'J': 'geojson', b'W': 'wkt', b'G': 'gpx', b'K': 'kml', b'Z': 'kmz', b'O': 'osm'}

    def run(data: bytes) -> None:
        path = folder / f'a.{suffixes.get(data[:1], "geojson")}'
        path.write_bytes(data[1:])
        with suppress(DragonError):
            drawing = read_drawing(path)
            origin = own_origin('a', [one.geometry for one in drawing.features], drawing.crs)
            with suppress(DragonError):
                venue_of(drawing, origin)
            map_line(drawing, None).placed(origin)
    kml = (b'<kml><Document><Placemark><name>a</name><MultiGeometry><LineString><coordinates>9,48,0 9.001,48 9.001,48.1'
           b'</coordinates></LineString><Polygon><outerBoundaryIs><LinearRing><coordinates>9,48 9.1,48 9.1,48.1 9,48'
           b'</coordinates></LinearRing></outerBoundaryIs></Polygon></MultiGeometry></Placemark></Document></kml>')
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, 'w', zipfile.ZIP_DEFLATED) as archive:
        archive.writestr('doc.kml', kml)
    seeds = [
        b'J{"type":"FeatureCollection","features":[{"type":"Feature","properties":{"name":"a","building":"yes"},'
        b'"geometry":{"type":"Polygon","coordinates":[[[9,48],[9.1,48],[9.1,48.1],[9,48]]]}},{"type":"Feature",'
        b'"properties":null,"geometry":{"type":"MultiLineString","coordinates":[[[9,48],[9.1,48]],[[9.1,48],[9.2,49]]]}}]}',
        b'Wa: LINESTRING (0 0, 60 0, 60 50)\nb: POLYGON ((0 0, 4 0, 4 3))\n',
        b'G<gpx><trk><name>a</name><trkseg><trkpt lat="48" lon="9"/><trkpt lat="48.001" lon="9"/></trkseg></trk></gpx>',
        b'K' + kml, b'Z' + packed.getvalue(),
        b'O<osm><node id="1" lat="48" lon="9"/><node id="2" lat="48" lon="9.1"/><node id="3" lat="48.1" lon="9"/><way '
        b'id="4"><nd ref="1"/><nd ref="2"/><nd ref="3"/><nd ref="1"/><tag k="building" v="yes"/></way><way id="5"><nd '
        b'ref="1"/><nd ref="2"/></way><relation id="6"><member type="way" ref="4" role="outer"/><tag k="type" '
        b'v="multipolygon"/></relation></osm>']
    return Target(seeds, run, (b'nan', b'1e400', b'null', b'[]', b'SRID=4326;', b'units: degrees\n', b'"units":"m",',
                               b'EMPTY', b'<Point>', b'\xff', b'inside', b'<!DOCTYPE a>', b'9', b'-'))


def command(folder: Path) -> Target:
    """Commands on cmd_vel for a led dragon, with and without a stamp; each command is valid for one tick."""
    import rclpy
    from geometry_msgs.msg import Twist, TwistStamped
    from rclpy.serialization import deserialize_message, serialize_message

    from dragon_ros.nodes.led import Commands, LedFrames
    from dragon_ros.nodes.monitor import Monitor
    context_was = rclpy.ok()
    if not context_was:
        rclpy.init()
    node, led = Monitor(), load_scene('led', ['dragon.benches=3', 'run.stop_s=1e6', 'effects=[leader]'])
    commands = Commands(node, 1e9, True)
    walked = LedFrames(led, commands.wanted_m_s, 'stop', lambda line: None, 1.0)

    def run(data: bytes) -> None:
        take, kind = (commands._on_stamped, TwistStamped) if data[:1] == b'S' else (commands._take, Twist)
        try:
            message = deserialize_message(data[1:], kind)
        except (RuntimeError, ValueError):      # DDS would not have delivered this message
            return
        take(message)
        frame = walked.take()
        assert bool((frame.chain.p == frame.chain.p).all())
        if walked.next_ns() is None:
            walked.rewind()

    def close() -> None:
        node.destroy_node()
        if not context_was:
            rclpy.shutdown()
    fast, slow = Twist(), TwistStamped()
    fast.linear.x, slow.twist.linear.x = 1.5, -0.25
    return Target([b'P' + serialize_message(fast), b'S' + serialize_message(slow)], run,
                  (struct.pack('<d', float('nan')), struct.pack('<d', float('inf')), struct.pack('<d', -1e308),
                   struct.pack('<d', 5e-324), struct.pack('<i', -2**31), b'\xff' * 8, bytes(8), b'P', b'S'), [close])


def filters(folder: Path) -> Target:
    """Entity filters: a byte that selects the bounds, the number of points, the points, and an expression."""
    import numpy as np

    from dragon_ros.nodes.entities import bodies_of_frame, box, chosen, convex_hull, sphere
    bodies = bodies_of_frame(tick(SCENE, 0), SCENE.dragon, 'dragon')

    def run(data: bytes) -> None:
        kind, count = data[0] if data else 0, data[1] % 16 if len(data) > 1 else 0
        values = np.frombuffer(data[2:2 + 24 * count].ljust(24 * count, b'\0'), '<f8').reshape(-1, 3)
        with suppress(DragonError):
            region = None if kind % 4 == 0 else (sphere, box, convex_hull)[kind % 4 - 1](values)
            pattern, tags = data[2 + 24 * count:].decode(errors='replace'), ['head'] * (kind & 4)
            chosen(bodies, pattern, tags, bool(kind & 8), region)
    points = [struct.pack('<9d', *values) for values in ((8.8, 0, 0.1, 1, 0, 0, 0, 0, 0), (0, 0, 1, 9, 9, -1, 9, 0, 0))]
    seeds = [bytes([kind, 2 + (kind == 3)]) + points[kind > 1][:24 * (2 + (kind == 3))] + b'(bench|handle)_[[:digit:]]+'
             for kind in range(4)]
    return Target(seeds, run, (struct.pack('<d', float('nan')), struct.pack('<d', 1e308), b'\xff' * 8, bytes(8),
                               b'(.*?)', b'{9999}', b'(?', b'[', b'\\', b'*', b'(?R)', b'{e<=9}'))


def results(folder: Path) -> Target:
    """CSV files of results that are graded: layouts of teams with other labels, numbers and separators."""
    import json

    from dragon_contest.grade.tables import csv_text, json_text, text_of
    from dragon_contest.grade.team import Team, grade_team
    path = folder / 'result1.csv'

    def run(data: bytes) -> None:
        path.write_bytes(data)
        grade = grade_team(Team('a', [path]))
        for lang in ('en', 'zh'):
            assert all('\n' not in one.line(lang) for one in grade.problems)
            assert all(line.startswith(('a', ' ')) for line in text_of([grade], lang).split('\n'))
        json.loads(json_text([grade]), parse_constant=lambda name: 1 / 0)
        assert csv_text([grade]).count('\n') == 1
    names = ['龙头', *(f'第{n}节龙身' for n in range(1, 6)), '龙尾', '龙尾（后）']
    wide = '\n'.join([',0 s,60 s,120 s', *(f'{name}{axis} (m),{k}.5,{k}.25,-{k}.125' for k, name in enumerate(names)
                                          for axis in 'xy')])
    long = '\n'.join(['time,section,x,y,v', *(f'{t},{k},{k}.5,-{k}.5,1.0' for t in range(-3, 3) for k in range(1, 9))])
    plain = '\n'.join(f'{k / 9:.6f},{-k / 7:.6f},1.0' for k in range(224))
    return Target([one.encode() for one in (wide, long, plain)], run, (
        b'\n', b',', b';', b'\t', b'"', b'nan', b'inf', b'-1e308', b'1e99', b's', b'-100_x', '速度'.encode(), b'tail',
        b'225', b'0:01:00', b'45000', '\u2028'.encode(), b'=1+1', b'\x1b[2J', b'\r'))


def answers(folder: Path) -> Target:
    """Files of answers for ``grade --answers``: one team's, several teams', and JSON in the published form."""
    from dragon_contest.answers import right_answers
    from dragon_contest.grade.team import grade_team, teams_in
    path = folder / 'answers.json'

    def run(data: bytes) -> None:
        path.write_bytes(data)
        with contextlib.suppress(DragonError):
            for team in teams_in(path)[:8]:
                assert len(grade_team(team).answers) == len(team.answers)
    seeds = ('t_s: 412.47\npitch_m: 0.45\n', 'team 1: {t_s: 464, turn_m: 14.1372}\n',
             '{"t_s": 412.473838, "speed_m_s": 2.00002}',
             json.dumps({'answers': right_answers()['answers']}))
    return Target([one.encode() for one in seeds], run, (
        b'nan', b'1e400', b'null', b'[]', b'{}', b'&a ', b'*a', b'!!int ""', b'\x1b[2J', b'-1', b'true', b'"',
        b'answers', b'0x1F', b'1_0', '\u2028'.encode()))


TARGETS: dict[str, Callable[[Path], Target]] = {
    'bag': bag, 'mix': mix, 'folder': folder_of_parts, 'scene': scene, 'override': override, 'certificate': certificate,
    'study': study, 'request': request, 'command_line': command_line, 'workbook': workbook, 'results': results,
    'answers': answers, 'message': message, 'obstacles': obstacles, 'command': command, 'drawing': drawing,
    'map': map_file, 'filters': filters}


@contextlib.contextmanager
def opened(name: str, folder: Path) -> Iterator[Target]:
    """Yield a target, and close everything that it opened afterwards."""
    target = TARGETS[name](folder)
    try:
        yield target
    finally:
        for close in target.close:
            close()
