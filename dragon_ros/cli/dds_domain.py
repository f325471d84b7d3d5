"""Find a free ROS domain, so that concurrent runs do not receive each other's messages."""
import atexit
import os
import random
import socket
from collections import deque
from collections.abc import Sequence

_PORTS = 7400, 250      # DDS-RTPS 9.6.1: the first port, and the number of ports per domain
_MOST_KEPT = 16         # number of domains that a process keeps reserved; earlier domains already have participants
_KEPT: deque[socket.socket] = deque()


def free_domain(among: Sequence[int] = range(1, 102)) -> int:
    """Return a domain without participants on this host; if all domains have participants, return any of them.

    To reserve the domain, this process binds the port of a 120th participant. A concurrent search therefore chooses
    another domain even before this process has a participant.
    """
    domains = random.SystemRandom().sample(among, len(among))
    return next((domain for domain in domains if _is_free(domain) and _keep(domain)), domains[0])


@atexit.register
def give_up_domains() -> None:
    """Release the domains that this process has reserved."""
    while _KEPT:
        _KEPT.popleft().close()


def _keep(domain: int) -> bool:
    """Reserve a domain by binding its last port; return whether that succeeded."""
    last = _bound(_PORTS[0] + _PORTS[1] * (domain + 1) - 1)
    if last:
        _KEPT.append(last)
        if len(_KEPT) > _MOST_KEPT:
            _KEPT.popleft().close()
    return last is not None


def local_environment(domain: int) -> dict[str, str]:
    """Return this process's environment with a domain; discovery stays on this host unless a variable widens it."""
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', **os.environ, 'ROS_DOMAIN_ID': str(domain)}


def _is_free(domain: int) -> bool:
    """Return whether all ports of a domain are free.

    Every port is checked, because the first participants may have left.
    """
    base, count = _PORTS
    for port in range(base + count * domain, base + count * (domain + 1)):
        probe = _bound(port)
        if probe is None:
            return False
        probe.close()
    return True


def _bound(port: int) -> socket.socket | None:
    """Return a socket bound to a port on all interfaces, or None if the port is in use."""
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        probe.bind(('', port))
    except OSError:
        probe.close()
        return None
    return probe
