"""The stages of one tick, from the head to the bytes, each measured separately."""
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle

from benchmarks.rates import NUMBER, Amounts
from benchmarks.solvers import CHAIN_SOLVERS
from dragon_ros.core.batches import velocity_of
from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.geometry.near_pairs import NearPairs
from dragon_ros.core.geometry.rectangles import Benches, axes_of, benches_of
from dragon_ros.core.model import compile_scene
from dragon_ros.core.numerics.types import Floats
from dragon_ros.core.scene import NS, Scene
from dragon_ros.core.shift_map.blocks import TabulatedLinks
from dragon_ros.core.step import frame_of, state
from dragon_ros.core.tracks.composite import Place
from dragon_ros.messages.encode import encoders

MODEL = ('head', 'chain', 'velocities', 'benches')
STAGES = (*MODEL, 'look', 'encode')
_LOOKS = 25     # number of ticks that the contact check passes through, back and forth


def stages_of(scene: Scene, solver: str, t_s: float) -> dict[str, Callable[[], object]]:
    """Return, for each stage, a call that runs it at the given time; earlier stages are computed in advance."""
    head = _head(scene, t_s)
    chain = CHAIN_SOLVERS[solver](scene, head)
    near, looks = NearPairs(), ticks_from(scene, t_s)
    encode = list(encoders(scene).values())
    frame = frame_of(compile_scene(scene), None, round(t_s * NS), chain)
    return {'head': partial(_head, scene, t_s), 'chain': partial(CHAIN_SOLVERS[solver], scene, head),
            'velocities': partial(velocity_of, scene, chain, t_s),
            'benches': lambda: benches_of(chain, scene.dragon, axes_of(chain)),
            'look': lambda: near.look(*next(looks)),
            'encode': lambda: [one(frame) for one in encode]}


def needs_of(scene: Scene, t_s: float) -> dict[str, Amounts]:
    """Return the amounts that each stage must process at the given time, whatever its method; the head has none."""
    simulation, handles = compile_scene(scene), scene.dragon.benches + 1
    chain, rectangles = simulation.chain(t_s), 4.0 * scene.dragon.benches
    placed = needs_of_chain(chain)
    frame = frame_of(simulation, None, round(t_s * NS), chain)
    return {'head': {}, 'chain': placed, 'velocities': placed,
            'benches': {'cache': NUMBER * (2.0 * handles + rectangles)}, 'look': {'cache': NUMBER * rectangles},
            'encode': {'cache': float(sum(len(one(frame)) for one in encoders(scene).values()))}}


def needs_of_chain(chain: Chain) -> Amounts:
    """Return the amounts for placing a chain: a product with a table, which is read once, or only the coordinates."""
    count = multiplications(chain)
    return {'product': 2.0 * count, 'cache': NUMBER * max(float(count), 2.0 * (len(chain.links_m) + 1))}


def multiplications(chain: Chain) -> int:
    """Return the number of multiplications in the products that place a chain's handles."""
    return sum(product.terms * (product.stop - product.start)
               for part in chain.parts if isinstance(part, TabulatedLinks) for product in part.products)


def ticks_from(scene: Scene, t_s: float) -> Iterator[tuple[Floats, Benches]]:
    """Yield handles and benches tick by tick, endlessly back and forth through the ticks after a given time."""
    chains = [state(scene, t_s + n / float(scene.run.rate_hz)) for n in range(_LOOKS)]
    ticks = [(chain.p, benches_of(chain, scene.dragon, axes_of(chain))) for chain in chains]
    return cycle([*ticks, *ticks[-2:0:-1]])


def _head(scene: Scene, t_s: float) -> Place:
    simulation = compile_scene(scene)
    simulation.check_time(t_s)
    return simulation.model.leader.place(scene.head.travelled_m(t_s))
