"""The web view of a run as a single file that needs no server or network."""
import json
from base64 import b64encode
from hashlib import sha256
from pathlib import Path

from dragon_ros.cli import command_line
from dragon_ros.commands.view.data import ViewData
from dragon_ros.core.numerics.types import Floats
from dragon_ros.pictures.sources import Progress, Source

WEB = Path(__file__).with_name('web')


def write_page(source: Source, times_s: Floats, pace: float, path: Path, progress: Progress) -> Path:
    """Write a page that plays the run at these times; ``pace`` is in simulated seconds per real second."""
    data = ViewData(source, progress, times_s)
    answers = {'run.json': json.dumps({**data.run(), 'pace': pace}).encode(),
               'contact.json': json.dumps(data.contact()).encode(),
               'clearance.json': json.dumps(data.clearance()).encode(), 'frames/contact': data.contact_frame()}
    answers |= {f'frames/{chunk}': data.frames(chunk) for chunk in range(data.chunks)}
    embedded = json.dumps({name: b64encode(answer).decode() for name, answer in answers.items()})
    command_line.write_output(path, _page(f'window.EMBEDDED = {embedded};').encode())
    return path


def _page(data: str) -> str:
    """Return the page with all its resources inlined; scripts come last, because they are not deferred.

    The content policy of the page identifies these scripts by their digests, and allows no others.
    """
    scripts = [data, _web('plotly-basic.min.js'), _web('words.js'), _web('benches.js'), _web('webgl.js'),
               _web('view.js')]
    inlined = ''.join(f'<script>{script}</script>\n' for script in scripts)
    digests = ' '.join(f"'sha256-{b64encode(sha256(script.encode()).digest()).decode()}'" for script in scripts)
    policy = (f"default-src 'none'; script-src {digests}; style-src 'unsafe-inline'; img-src data: blob:; "
              "base-uri 'none'; form-action 'none'")
    replaced = {'<link rel="icon" href="icon.svg">\n': '', '<script src="plotly.js" defer></script>\n': '',
                '<script src="words.js" defer></script>\n': '',
                '<script src="benches.js" defer></script>\n': '', '<script src="webgl.js" defer></script>\n': '',
                '<script src="view.js" defer></script>\n': '',
                '</body>': f'{inlined}</body>',
                '<link rel="stylesheet" href="view.css">': f'<style>\n{_web("view.css")}</style>',
                '<meta charset="utf-8">': '<meta charset="utf-8">\n'
                                          f'<meta http-equiv="Content-Security-Policy" content="{policy}">'}
    page = _web('index.html')
    for old, new in replaced.items():
        page = page.replace(old, new, 1)
    return page


def _web(name: str) -> str:
    return (WEB / name).read_text(encoding='utf-8')
