"""A domain is free only if no participant remains in it, whichever participant joined first."""
import os
import socket
import subprocess
import sys

import pytest
from properties import thinned

from dragon_ros.cli import dds_domain
from dragon_ros.cli.dds_domain import free_domain, give_up_domains

BASE, GAIN = 7400, 250      # the ports of a domain according to DDS-RTPS 9.6.1
WORKER = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw')) % 7
# The ports of these domains are above those that Linux assigns to sockets that request no particular port.
DOMAIN, OTHER = 216 + 2 * WORKER, 217 + 2 * WORKER


@pytest.fixture(autouse=True)
def others_may_have_them():
    yield
    give_up_domains()


def chosen(times):
    """Choose domains repeatedly without reserving them, and return which of the two domains were free."""
    out = set()
    for _ in range(times):
        out.add(free_domain([DOMAIN, OTHER]))
        give_up_domains()
    return out


@pytest.mark.parametrize(('of', 'address'), thinned(
    [(of, address) for of in (0, 10, 11, 12, 24, 248) for address in ('127.0.0.1', '')],    # discovery and participants
    {(0, '127.0.0.1'), (10, ''), (11, '127.0.0.1'), (248, '127.0.0.1')}.__contains__))
def test_a_domain_with_any_participant_is_not_free(of, address):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind((address, BASE + GAIN * DOMAIN + of))
        assert chosen(20) == {OTHER}
    assert any(chosen(1) == {DOMAIN} for _ in range(60))


def test_where_none_is_free_one_is_returned_all_the_same():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(('', BASE + GAIN * DOMAIN + 10))
        assert free_domain([DOMAIN]) == DOMAIN


def test_two_who_look_at_the_same_time_get_two_domains():
    first = free_domain([DOMAIN, OTHER])
    command = ('from dragon_ros.cli.dds_domain import free_domain, give_up_domains\n'
               f'for _ in range(20): print(free_domain([{DOMAIN}, {OTHER}])); give_up_domains()')
    found = subprocess.run([sys.executable, '-c', command], capture_output=True, text=True, check=True, timeout=60)
    assert {first, *map(int, found.stdout.split())} == {DOMAIN, OTHER}
    assert str(first) not in found.stdout.split()


def test_a_process_that_looks_for_many_keeps_the_last_ones(monkeypatch):
    monkeypatch.setattr(dds_domain, '_MOST_KEPT', 1)
    first = free_domain([DOMAIN, OTHER])
    assert {first, free_domain([DOMAIN, OTHER])} == {DOMAIN, OTHER}
    assert free_domain([DOMAIN, OTHER]) == first
