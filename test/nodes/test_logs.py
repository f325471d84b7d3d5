"""A message in a node's log names the line that logs it as its caller, not a line of the package's logger."""
from pathlib import Path

from dragon_ros.nodes.logs import logger


def test_a_filter_is_kept_for_each_line_that_logs():
    logged = [(logger('test').info('one', once=True), logger('test').warning('two', once=True)) for _ in range(2)]
    assert logged == [(True, True), (False, False)]


def test_the_log_names_the_file_that_logs():
    one = logger('another test')
    one.info('here')
    assert {Path(caller.file_path).name for caller in one.contexts} == {Path(__file__).name}
