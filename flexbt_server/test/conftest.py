# SPDX-License-Identifier: BSD-3-Clause
"""A ROS domain of their own for the tests of one run, so that runs do not meet."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from domain_coordinator import domain_id


@pytest.fixture(scope='session', autouse=True)
def ros_domain() -> Iterator[int]:
    """The domain that all nodes of this run live in, child processes included."""
    with domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        yield domain
