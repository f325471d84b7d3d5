"""Budgets: upper limits for all external input. ``docs/limits.md`` is generated from this table.

An *untrusted* scene comes from a bag or a topic. Input that exceeds a budget is rejected with a one-line error that
names the budget. The certificate checker shares no code with the other packages, so it has its own budgets
(``verify/reading.py``).
"""
from typing import NamedTuple

KB, MB = 2**10, 2**20

# Scenes
SCENE_FILE_BYTES = 2 * MB
SCENE_CHARACTERS = 64 * KB
YAML_DEPTH = 32
YAML_VALUES = 100_000
SCENE_TICKS = 10_000_000
SEARCHED_BENCHES = 2000
SEARCH_WORK = 50_000_000
PROOF_S = 60.0
VENUE_CORNERS = 100_000
VENUE_BYTES = 16 * MB
DRAWING_BYTES = 8 * MB
DRAWING_POINTS = 100_000
DRAWING_WORK = 8_000_000
XML_DEPTH = 64
XML_ELEMENTS = 50_000
MAP_ELEMENTS = 1_000_000
KMZ_FILES = 1000

# Bags
CHUNK_BYTES = 128 * MB
RECORD_BYTES = 16 * MB
SUMMARY_BYTES = 64 * MB
OPEN_CHUNKS_BYTES = 64 * MB
FOLDER_BYTES = MB
FOLDER_FILES = 10_000
QOS_CHARACTERS = 16 * KB
WAITING_TICKS = 128
CHECKED_TIMES = 10_000_000
PICTURE_TICKS = 2_000_000
LED_TICKS = 2_000_000

# Messages and nodes
COORDINATE_M = 1e7      # beyond the world: northings of maps on a Path, and bags of earlier versions
MARKER_RUNS = 10_000
LISTED_OBJECTS = 500_000
MONITOR_BYTES = 256 * MB
INBOX_BYTES = 128 * MB
INBOX_MESSAGES = 10_000
HELD_BYTES = 64 * MB
REPLAYED_BYTES = 64 * MB
MAP_BYTES = 256 * MB
MAP_EDGES = 400_000
SHOWN_EDGES = 20_000
KNOWN_FRAMES = 10_000
RECORDED_SCENES = 16
SUBSCRIBERS = 1000
FILTER_CHARACTERS = 256
FILTER_S = 1.0
FILTER_POINTS = 1000

# The web view
VIEW_CONNECTIONS = 32
VIEW_IDLE_S = 10.0
VIEW_ANSWER_S = 60.0
VIEW_TICKS = 100_000


class Limit(NamedTuple):
    """One budget: the name of its constant, the quantity that it bounds, its unit, and the effect of exceeding it."""

    name: str
    bounds: str
    unit: str
    beyond: str


LIMITS = (
    Limit('SCENE_FILE_BYTES', 'a scene file or any other YAML file', 'bytes', 'rejected'),
    Limit('SCENE_CHARACTERS', 'the text of an untrusted scene, without the corners of its venue', 'characters',
          'not read without `--trust`; a recorder stores it unread'),
    Limit('YAML_DEPTH', 'the nesting depth of a YAML document', 'levels', 'rejected'),
    Limit('YAML_VALUES', 'the values of a YAML document with expanded aliases', 'values', 'rejected'),
    Limit('SCENE_TICKS', 'the ticks of an untrusted scene', 'ticks', 'not computed without `--trust`'),
    Limit('SEARCHED_BENCHES', 'the benches of an untrusted scene in a search for the first contact', 'benches',
          'reported as unknown without `--trust`; `inspect --check` uses the certificate in the bag'),
    Limit('SEARCH_WORK', 'the work of a first-contact search in an untrusted scene', 'states times benches',
          'the search is abandoned without `--trust`'),
    Limit('PROOF_S', 'the time that the checker may take for the certificate in a bag', 'seconds',
          'the checker is stopped; without `--trust`, a run that ends in a contact is then not checked'),
    Limit('VENUE_CORNERS', 'the obstacles and the inside of a venue', 'corners', 'rejected'),
    Limit('VENUE_BYTES', 'a map or a venue file, unpacked; the lines with the corners of the venue in the text of an '
          'untrusted scene', 'bytes', 'rejected'),
    Limit('DRAWING_BYTES', 'an SVG or CSV drawing that `route` reads', 'bytes', 'rejected'),
    Limit('DRAWING_POINTS', 'the line that `route` follows, or its path in SVG', 'points or pieces', 'rejected'),
    Limit('DRAWING_WORK', 'the work to follow a drawn line (about ten seconds)', 'points examined',
          'rejected; a larger `--tolerance` takes less'),
    Limit('XML_DEPTH', 'the nesting depth of an SVG drawing or a map in XML', 'levels', 'rejected'),
    Limit('XML_ELEMENTS', 'the elements of an SVG drawing', 'elements', 'rejected'),
    Limit('MAP_ELEMENTS', 'the elements of a map in GPX, KML or OpenStreetMap XML', 'elements', 'rejected'),
    Limit('KMZ_FILES', 'the files in a KMZ archive', 'files', 'rejected'),
    Limit('CHUNK_BYTES', 'a chunk of a bag after decompression, and a message outside chunks', 'bytes',
          'rejected; a recorder omits such a message, counts it and names its topic'),
    Limit('RECORD_BYTES', 'any other record of a bag: schema, channel, metadata, attachment', 'bytes', 'rejected'),
    Limit('SUMMARY_BYTES', 'the summary of a bag, and all its schemas and channels', 'bytes', 'rejected'),
    Limit('OPEN_CHUNKS_BYTES', 'the chunks that a reader holds open', 'bytes',
          'the least recently used chunk is closed'),
    Limit('FOLDER_BYTES', 'the `metadata.yaml` of a bag', 'bytes', 'rejected'),
    Limit('FOLDER_FILES', 'the files of a bag', 'files', 'rejected'),
    Limit('QOS_CHARACTERS', 'the QoS profile of a recorded topic', 'characters', 'the default profile is used'),
    Limit('WAITING_TICKS', 'recorded handles whose benches have not been read yet', 'ticks',
          'the oldest handles are read without benches'),
    Limit('CHECKED_TIMES', 'messages whose times `inspect` stores to find gaps', 'messages',
          'further messages are only counted'),
    Limit('PICTURE_TICKS', 'the ticks of a bag for `plot` and `view`', 'ticks', 'rejected'),
    Limit('LED_TICKS', 'the ticks of a led dragon whose walk is read back from a bag', 'ticks', 'rejected'),
    Limit('COORDINATE_M', 'a coordinate, a size or a speed of a dragon in messages; live handles lie in the world',
          'metres', 'rejected'),
    Limit('MARKER_RUNS', 'the markers of a message whose layout differs from that of the previous marker', 'markers',
          'rejected'),
    Limit('LISTED_OBJECTS', 'the messages and strings in the lists of a message whose fields are read one by one',
          'objects', 'rejected'),
    Limit('MONITOR_BYTES', 'messages that the monitor holds until their counterparts arrive', 'bytes',
          'the oldest message is dropped, with a warning'),
    Limit('INBOX_BYTES', 'messages in the inbox of the monitor', 'bytes',
          'above half of this, whole ticks are skipped at even intervals, and `/diagnostics` reports it immediately'),
    Limit('INBOX_MESSAGES', 'messages in the inbox of the monitor', 'messages', 'likewise'),
    Limit('HELD_BYTES', 'messages without a stamp that the recorder holds until a tick arrives', 'bytes',
          'the oldest message is omitted and counted'),
    Limit('REPLAYED_BYTES', 'messages of one log time that `replay` holds', 'bytes', 'published in parts'),
    Limit('MAP_BYTES', 'a map for the monitor', 'bytes', 'not used; `/diagnostics` reports it'),
    Limit('MAP_EDGES', 'the edges of the occupied cells of a map, and those of the venue in a message', 'edges',
          'likewise'),
    Limit('SHOWN_EDGES', 'obstacles on `collision/obstacles`', 'edges',
          'obstacles of a file or map are not published, with a warning'),
    Limit('KNOWN_FRAMES', 'the frames of `/tf` and `/tf_static` that the monitor keeps', 'frames',
          'further frames are ignored'),
    Limit('RECORDED_SCENES', 'different scenes that a recorder reads and attaches to one bag', 'scenes',
          'further scenes are only stored as messages, with a warning'),
    Limit('SUBSCRIBERS', 'subscribers that `wait_subscribers` can require', 'subscribers', 'rejected'),
    Limit('FILTER_CHARACTERS', 'a regular expression that filters entities', 'characters', 'rejected'),
    Limit('FILTER_S', 'the time to match an expression against the names of all entities', 's', 'rejected'),
    Limit('FILTER_POINTS', 'points of a convex hull that filters entities', 'points', 'rejected'),
    Limit('VIEW_CONNECTIONS', 'connections that `view` serves at a time', 'connections',
          'the connection that has been idle longest is closed'),
    Limit('VIEW_IDLE_S', 'the time for a request to `view` to arrive', 'seconds', 'closed'),
    Limit('VIEW_ANSWER_S', 'the time that `view` may spend on an answer', 'seconds', 'rejected, with a suggestion'),
    Limit('VIEW_TICKS', 'ticks that `view` shows', 'ticks', 'thinned out evenly, with a note'),
)
