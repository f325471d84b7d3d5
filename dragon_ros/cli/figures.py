"""Style all figures and write them to files. Matplotlib is imported only when a figure is drawn."""
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dragon_ros.bags.write.whole_file import whole_or_none
from dragon_ros.core.errors import MissingError
from dragon_ros.version import __version__

# Okabe-Ito colours, named by meaning; colour-blind people can distinguish them.
BODY, HEAD, TOUCHED, TRACK, POINT = '#56B4E9', '#D55E00', '#E69F00', '#999999', '#000000'
LINES = ('#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9')
HATCH = '////'          # hatching of touching benches, whose colours look alike in black and white
QUIET = '#555555'       # colour of notes and guide lines
OBSTACLE = '#DDD8CE'    # colour of a venue's obstacles and of the area outside its boundary

PAGE_IN, TEXT_PT = 9.1, 9     # a page about 880 pixels wide shows a figure this wide unscaled, with text of this size

_STYLE: dict[Any, Any] = {
    'figure.constrained_layout.use': True, 'figure.constrained_layout.h_pad': 0.1,
    'figure.constrained_layout.w_pad': 0.08, 'font.family': ['DejaVu Sans', 'sans-serif'], 'font.size': 10,
    'axes.titlesize': 11, 'axes.titlelocation': 'left', 'axes.spines.top': False, 'axes.spines.right': False,
    'axes.edgecolor': QUIET, 'axes.axisbelow': True, 'axes.grid': True, 'grid.color': '#E6E6E6', 'grid.linewidth': 0.6,
    'lines.linewidth': 1.6, 'legend.frameon': False, 'legend.fontsize': TEXT_PT,
    'svg.hashsalt': 'dragon_ros', 'axes.formatter.useoffset': False,
    'figure.titlesize': 12, 'hatch.linewidth': 0.5, 'svg.fonttype': 'none', 'pdf.fonttype': 42,
}
# The settings that apply while a file is written: text stays text, and a figure without a layout engine gets none.
_WRITTEN: dict[Any, Any] = {**{key: _STYLE[key] for key in ('svg.hashsalt', 'svg.fonttype', 'pdf.fonttype')},
            'figure.autolayout': False, 'figure.constrained_layout.use': False}
_LONGEST_NAME = 40          # maximum length of a name in a title, in characters
_CHARACTERS_PER_INCH = 11   # number of characters per inch at the text size of a title
_UNDATED: dict[str, dict[str, Any]] = {'.png': {'Software': None}, '.svg': {'Date': None},
                                       '.pdf': {'CreationDate': None}}
FORMATS = tuple(_UNDATED)
TRACK_ID = 'track'      # id of the track in a figure and in the figure's SVG
_SVG_DPI = 72
_CAPTION_IN, _LEGEND_IN = 0.26, 0.3      # space below a figure for its caption and its legend, in inches
_CAPTION_ID = 'caption'
# File names of Chinese fonts on Linux, Windows and macOS, without suffixes.
_CHINESE_FONTS = ('notosanscjk-regular', 'notosanssc-regular', 'notosanscjksc-regular', 'sourcehansanssc-regular',
                  'sourcehansanscn-regular', 'msyh', 'simhei', 'deng', 'pingfang', 'hiragino sans gb', 'stheiti light',
                  'wqy-microhei', 'wqy-zenhei', 'droidsansfallbackfull')


def drawable(text: str) -> str:
    """Return text in which the bytes of a file name that are not UTF-8 are escaped."""
    return text.encode(errors='backslashreplace').decode()


def short(name: str) -> str:
    """Return a name shortened for a title; the middle of a long name is omitted."""
    name, half = drawable(name), _LONGEST_NAME // 2
    return name if len(name) <= _LONGEST_NAME else f'{name[:half]}…{name[-half:]}'


def titled(name: str, text: str, inches: float) -> str:
    """Return ``name: text`` for a title, on two lines if the axes are too narrow for one line."""
    return joined(f'{short(name)}:', text, ' ', inches)


def joined(one: str, other: str, by: str, inches: float) -> str:
    """Return the two parts of a title on one line, or on two lines if the axes are too narrow for one line."""
    line = f'{one}{by}{other}'
    return line if len(line) <= _CHARACTERS_PER_INCH * inches else f'{one}\n{other}'


def legend_below(axes: Any, columns: int = 2, **options: Any) -> None:
    """Put the legend below the axes, where it covers nothing; constrained layout reserves space for it."""
    axes.legend(loc='upper center', bbox_to_anchor=(0.5, -0.13), ncols=columns, **options)


def add_lines(axes: Any, patch: Any) -> None:
    """Add a patch that consists of straight lines to axes, with the same result as ``axes.add_patch``.

    ``axes.add_patch`` processes each of the thousands of lines as a curve in Python, which takes up to 60 % of the time
    for a picture.
    """
    axes.update_datalim(patch.get_path().vertices)
    axes.add_artist(patch)


@contextmanager
def style(chinese: bool = False, log_ticks: bool = False, needed: bool = True) -> Iterator[None]:
    """Apply the style of dragon_ros to all figures drawn in this block; ``chinese`` adds a Chinese font.

    If the font is not needed and not installed, each letter of it is drawn as a box, without a warning.

    Text between dollar signs, such as a name with two of them, is drawn as it is. With ``log_ticks``, it is parsed as a
    formula, as the labels of logarithmic axes require.

    Raises MissingError if no Chinese font is installed.
    """
    import matplotlib
    # PDF font type 42 does not support the OpenType fonts that most systems have.
    more: dict[Any, Any] = {}
    try:
        more = {'font.family': ['DejaVu Sans', _chinese_font()], 'pdf.fonttype': 3} if chinese else {}
    except MissingError:
        if needed:
            raise
    with matplotlib.rc_context({**_STYLE, **more, 'text.parse_math': log_ticks}), warnings.catch_warnings():
        if not needed:
            warnings.filterwarnings('ignore', 'Glyph .* missing from font')
        yield


def has_chinese_font() -> bool:
    """Return whether a Chinese font is installed."""
    try:
        return bool(_chinese_font())
    except MissingError:
        return False


def _chinese_font() -> str:
    """Return the name of an installed Chinese font.

    The font files of the system are searched, because Matplotlib's font list may be outdated.
    """
    from matplotlib.font_manager import FontProperties, findSystemFonts, fontManager
    files = {Path(file).stem.lower(): file for file in findSystemFonts()}
    for stem in _CHINESE_FONTS:
        if stem in files:
            fontManager.addfont(files[stem])
            logging.getLogger('matplotlib.font_manager').setLevel(logging.ERROR)    # it may have no bold letters
            return FontProperties(fname=files[stem]).get_name()
    raise MissingError('--lang zh: no Chinese font is installed; install one (apt install fonts-noto-cjk), or give '
                       '--lang en')


def write(figure: Any, path: Path, dpi: int = 130, caption: str = '') -> Path:
    """Write a Matplotlib figure reproducibly, in the format given by the path's suffix, and return the path.

    If a caption is given, it is written below the figure, together with the version of dragon_ros. In SVG and PDF, text
    is not converted to outlines.
    """
    import matplotlib
    suffix = path.suffix.lower()
    if caption:
        _add_caption(figure, caption)
    try:
        with whole_or_none(path, overwrite=True) as file, matplotlib.rc_context(_WRITTEN):
            _lay_out(figure, dpi)
            about = _in_metres(figure) if suffix == '.svg' else {}
            figure.savefig(file, format=suffix[1:], dpi=dpi, metadata={**_UNDATED[suffix], **about})
    except OSError as error:
        raise MissingError(f'{path}: cannot be written: {error.strerror}') from None
    return path


def _lay_out(figure: Any, dpi: int) -> None:
    """Compute the layout of a figure once for all formats, unless this has been done.

    Otherwise, ``savefig`` would compute it again for each file, and draw the whole figure without output to do so.
    """
    layout = figure.get_layout_engine()
    if layout is None or not figure.axes:
        return
    given, figure.dpi = figure.dpi, dpi
    layout.execute(figure)
    figure.set_layout_engine(None)
    figure.dpi = given


def _add_caption(figure: Any, caption: str) -> None:
    """Reserve space below a figure and its legends, and write a caption there, unless the figure already has one."""
    if any(one.get_gid() == _CAPTION_ID for one in figure.texts):
        return
    width, height = figure.get_size_inches().tolist()
    height += _CAPTION_IN
    figure.set_size_inches(width, height)
    below = _CAPTION_IN / height
    legends = _LEGEND_IN / height if figure.legends else 0.0       # a layout with a rect reserves no space for legends
    figure.get_layout_engine().set(rect=(0, below + legends, 1, 1 - below - legends))
    for legend in figure.legends:
        legend.set_bbox_to_anchor((0, below, 1, 1 - below), figure.transFigure)
    figure.text(0.1 / width, 0.08 / height, f'{caption}; dragon_ros {__version__}', gid=_CAPTION_ID,
                fontsize=TEXT_PT, color=QUIET, va='bottom', in_layout=False)


def _in_metres(figure: Any) -> dict[str, str]:
    """Return SVG metadata with the scale that ``route`` reads, or empty metadata if the figure has no track.

    An SVG has 72 units per inch, and its vertical coordinate increases downwards from the top.
    """
    found = [axes for axes in figure.axes if any(one.get_gid() == TRACK_ID for one in axes.patches)]
    if not found:
        return {}
    from dragon_ros.scenes.drawings import METRES
    dpi, figure.dpi = figure.dpi, _SVG_DPI
    found[0].apply_aspect()
    (a, c, e), (b, d, f), _ = found[0].transData.inverted().get_matrix().tolist()
    height = float(figure.bbox.height)
    figure.dpi = dpi
    matrix = a, b, -c, -d, e + c * height, f + d * height
    return {'Description': f'{METRES}matrix({", ".join(map(repr, matrix))})'}


def save(figure: Any, stem: Path, caption: str = '') -> list[Path]:
    """Write a Matplotlib figure as PNG and SVG, and return both paths."""
    return [write(figure, stem.with_suffix(suffix), caption=caption) for suffix in ('.png', '.svg')]
