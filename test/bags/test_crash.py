"""A writer that is killed at any moment leaves a bag of which all that is on disk is recovered, in every form."""
import pytest
from crash import FORMS, kill

from dragon_ros.bags.write import COMPRESSIONS


@pytest.mark.parametrize('compression', COMPRESSIONS)
@pytest.mark.parametrize('form', FORMS)
def test_all_that_a_killed_writer_left_on_disk_is_recovered(tmp_path, form, compression):
    left = kill(tmp_path, form, compression, 0.05)
    assert left.saved >= left.flushed
