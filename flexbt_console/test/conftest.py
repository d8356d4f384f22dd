# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the console's tests."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest


@pytest.fixture(scope='session')
def domain() -> Iterator[int]:
    """A ROS domain that no other test uses at the same time, in the environment of this and child processes."""
    import domain_coordinator

    with domain_coordinator.domain_id() as number:
        before = dict(os.environ)
        os.environ['ROS_DOMAIN_ID'] = str(number)
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
        yield number
        os.environ.clear()
        os.environ.update(before)


@pytest.fixture
def executives(domain: int) -> Iterator[Any]:
    """Starts executives in a namespace of their own: ``executives('name', heartbeat=0.25, faults=...)``."""
    from console_test_executive import ScriptedExecutive

    from flexbt_common.node_runtime import NodeRuntime

    with ExitStack() as stack:

        def start(namespace: str, **options: Any) -> ScriptedExecutive:
            runtime = stack.enter_context(NodeRuntime.open('onboard_executive', namespace=namespace))
            return ScriptedExecutive(runtime, **options)

        yield start
