"""The accuracy with which a tick was solved."""
from dragon_ros.core.chain.chain import Chain
from dragon_ros.core.frame import Health


def chain_health(chain: Chain, promise_m: float) -> Health:
    """Return how accurately a chain preserves its link lengths; each handle may have an error of ``promise_m``."""
    off_m, link = chain.worst
    return Health(chain.solver, chain.evaluations, link, off_m, 2 * promise_m)
