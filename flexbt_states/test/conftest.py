# SPDX-License-Identifier: BSD-3-Clause
"""A ROS domain of their own for these tests, and what they run states with."""

from __future__ import annotations

import os
from collections.abc import Iterator

import domain_coordinator
import pytest
from state_bench import StateBench


@pytest.fixture(scope='session', autouse=True)
def ros_domain() -> Iterator[None]:
    """A domain that nobody else uses, and field checks in every message."""
    before = dict(os.environ)
    with domain_coordinator.domain_id() as domain:
        os.environ.update(
            ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST', ROS_PYTHON_CHECK_FIELDS='1'
        )
        yield
    os.environ.clear()
    os.environ.update(before)


@pytest.fixture
def bench() -> Iterator[StateBench]:
    """Runs states, with action servers that do what the test says."""
    bench = StateBench()
    yield bench
    bench.close()
