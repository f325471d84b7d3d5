"""A free ROS domain, so that concurrent runs do not hear each other."""
import os
import random
import socket
from collections.abc import Sequence

_PORTS = 7400, 250, 10      # DDS-RTPS 9.6.1: base, gain of a domain, first unicast port


def free_domain(among: Sequence[int] = range(1, 102)) -> int:
    """Return a domain in which no participant of this host has its first port."""
    domains = random.SystemRandom().sample(among, len(among))
    return next((domain for domain in domains if _is_free(domain)), domains[0])


def local_environment(domain: int) -> dict[str, str]:
    """Return this process's environment with a domain; discovery stays on this host unless it is widened there."""
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', **os.environ, 'ROS_DOMAIN_ID': str(domain)}


def _is_free(domain: int) -> bool:
    base, gain, unicast = _PORTS
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('', base + gain * domain + unicast))
        except OSError:
            return False
    return True
