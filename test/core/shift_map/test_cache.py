"""A value is built once, whatever threads need it, and the least recently used values are dropped."""
from threading import Barrier, Thread

import pytest

from dragon_ros.core.shift_map.table import BuildCache


def cache_of(most):
    return BuildCache(lambda values: len(values) > most)


def test_the_least_recently_used_values_are_dropped_and_built_again():
    built, cache = [], cache_of(2)

    def build(key):
        built.append(key)
        return -key

    assert [cache.get(key, build) for key in (1, 2, 1, 3, 1, 2)] == [-1, -2, -1, -3, -1, -2]
    assert (built, cache.values) == ([1, 2, 3, 2], [-1, -2])


def test_the_latest_value_stays_even_if_it_is_too_much_alone():
    cache = cache_of(0)
    for key in 'ab':
        cache.get(key, str)
    assert cache.values == ['b']


def test_a_value_that_could_not_be_built_is_tried_again():
    cache = cache_of(1)
    with pytest.raises(KeyError):
        cache.get('a', {}.__getitem__)
    assert cache.get('a', str) == 'a'


def test_threads_build_a_value_once():
    ready, built, got = Barrier(8), [], []
    cache = cache_of(4)

    def build(key):
        built.append(key)
        return object()

    def run():
        ready.wait()
        got.append([cache.get(key, build) for key in range(4)])

    threads = [Thread(target=run) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(built) == [0, 1, 2, 3]
    assert all(one == got[0] for one in got)
