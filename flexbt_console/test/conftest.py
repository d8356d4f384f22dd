# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the console's tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest


@pytest.fixture
def executives() -> Iterator[Any]:
    """Start executives in a namespace of their own: ``executives('name', heartbeat=0.25, faults=...)``."""
    from flexbt_common.runtime.node_runtime import NodeRuntime
    from flexbt_testing.nodes.scripted_executive import ScriptedExecutive

    with ExitStack() as stack:

        def start(namespace: str, **options: Any) -> ScriptedExecutive:
            runtime = stack.enter_context(NodeRuntime.open('onboard_executive', namespace=namespace))
            return ScriptedExecutive(runtime, **options)

        yield start
