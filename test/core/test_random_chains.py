"""Random chains from the whole world keep their promise, compared with 40 digits (``random_chains.py``)."""
import pytest
from random_chains import measured


@pytest.mark.parametrize('first', [0, *(pytest.param(200 * n, marks=pytest.mark.long) for n in range(1, 20))])
def test_random_chains_of_the_world_keep_their_promise(first):
    found = [*measured(range(first, first + 200))]
    assert len(found) > 120
    assert max(found) <= (1, first + 200)
