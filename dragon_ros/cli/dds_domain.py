"""A free ROS domain, so that concurrent runs do not hear each other."""
import os
import random
import socket
from collections.abc import Sequence

_PORTS = 7400, 250      # DDS-RTPS 9.6.1: the first one, and how many a domain has


def free_domain(among: Sequence[int] = range(1, 102)) -> int:
    """Return a domain of which no participant of this host has a port; any, where there is none."""
    domains = random.SystemRandom().sample(among, len(among))
    return next((domain for domain in domains if _is_free(domain)), domains[0])


def local_environment(domain: int) -> dict[str, str]:
    """Return this process's environment with a domain; discovery stays on this host unless it is widened there."""
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', **os.environ, 'ROS_DOMAIN_ID': str(domain)}


def _is_free(domain: int) -> bool:
    """Return whether nobody has a port of a domain; the participant that came first may have left before others."""
    base, count = _PORTS
    return all(map(_can_be_bound, range(base + count * domain, base + count * (domain + 1))))


def _can_be_bound(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('', port))
        except OSError:
            return False
    return True
