"""A free domain is one in which no participant is left, whichever came first."""
import socket

import pytest

from dragon_ros.cli.dds_domain import free_domain

BASE, GAIN = 7400, 250      # of the ports of a domain: DDS-RTPS 9.6.1
DOMAIN, OTHER = 220, 225    # beyond the ports that Linux gives to sockets that ask for none, and those of other tests


@pytest.mark.parametrize('of', [0, 10, 11, 12, 24, 248], ids=[
    'discovery', 'first participant', 'its data', 'second', 'eighth', 'last'])
@pytest.mark.parametrize('address', ['127.0.0.1', ''])
def test_a_domain_with_any_participant_is_not_free(of, address):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind((address, BASE + GAIN * DOMAIN + of))
        assert {free_domain([DOMAIN, OTHER]) for _ in range(20)} == {OTHER}
    assert DOMAIN in {free_domain([DOMAIN, OTHER]) for _ in range(60)}


def test_where_none_is_free_one_is_returned_all_the_same():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.bind(('', BASE + GAIN * DOMAIN + 10))
        assert free_domain([DOMAIN]) == DOMAIN
