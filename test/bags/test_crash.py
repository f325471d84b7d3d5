"""Whenever a writer is killed, all messages on the disk are recovered from its bag, whatever the form of the bag."""
import pytest
from crash import FORMS, kill
from properties import thinned

from dragon_ros.bags.write import COMPRESSIONS


@pytest.mark.parametrize(('form', 'compression'), thinned(
    [(form, compression) for form in FORMS for compression in COMPRESSIONS],
    [('file', 'zstd'), ('parts', 'none')].__contains__))
def test_all_that_a_killed_writer_left_on_disk_is_recovered(tmp_path, form, compression):
    left = kill(tmp_path, form, compression, 0.05)
    assert left.saved >= left.flushed
