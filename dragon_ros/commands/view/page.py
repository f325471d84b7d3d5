"""The web view of a run as a single file, which needs neither a server nor a network."""
import json
from base64 import b64encode
from pathlib import Path

from dragon_ros.commands.sources import Progress, Source
from dragon_ros.commands.view.data import ViewData
from dragon_ros.core.errors import MissingError
from dragon_ros.core.numerics.types import Floats

WEB = Path(__file__).with_name('web')


def write_page(source: Source, times_s: Floats, pace: float, path: Path, progress: Progress) -> Path:
    """Write a page that plays the run at these times, at a pace in seconds of the run per second."""
    data = ViewData(source, progress, times_s)
    answers = {'run.json': json.dumps({**data.run, 'pace': pace}).encode(),
               'clearance.json': json.dumps(data.clearance()).encode(), 'frames/contact': data.contact_frame()}
    answers |= {f'frames/{chunk}': data.frames(chunk) for chunk in range(data.chunks)}
    embedded = json.dumps({name: b64encode(answer).decode() for name, answer in answers.items()})
    try:
        path.write_text(_page(f'window.EMBEDDED = {embedded};'), encoding='utf-8')
    except OSError as error:
        raise MissingError(f'--output {path}: cannot be written: {error.strerror}') from None
    return path


def _page(data: str) -> str:
    """Return the page with everything that it refers to inlined; scripts are last, since they are not deferred."""
    def web(name: str) -> str:
        return (WEB / name).read_text(encoding='utf-8')
    scripts = ''.join(f'<script>{script}</script>\n' for script in (data, web('plotly-basic.min.js'), web('view.js')))
    replaced = {'<link rel="icon" href="icon.svg">\n': '', '<script src="plotly.js" defer></script>\n': '',
                '<script src="view.js" defer></script>\n': '', '</body>': f'{scripts}</body>',
                '<link rel="stylesheet" href="view.css">': f'<style>\n{web("view.css")}</style>'}
    page = web('index.html')
    for old, new in replaced.items():
        page = page.replace(old, new)
    return page
