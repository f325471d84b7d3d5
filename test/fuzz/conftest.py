"""The ROS domain for nodes that are fuzzed, chosen as in the node tests."""
import pytest

from dragon_ros.cli.dds_domain import free_domain, local_environment


@pytest.fixture
def domain(monkeypatch):
    for key, value in local_environment(free_domain()).items():
        monkeypatch.setenv(key, value)
