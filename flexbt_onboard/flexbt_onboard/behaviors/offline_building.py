# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors that are built and never run: for tools that inspect their state machines."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from flexbt_common.runtime import NodeRuntime
from flexbt_core.state_machine import Severity

from .run_context import RunContext
from .run_services import StateServices

_DISCOVERY: Final = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


@contextmanager
def building() -> Iterator[None]:
    """For the length of the block behaviors can be built whose constructors want ROS, as FlexBE's do.

    They get a node when they ask for one. It discovers nobody and is discovered by nobody.
    """
    run = RunContext(lambda: _services(run), _say_nothing)
    with run.entered():
        yield


def _services(run: RunContext) -> StateServices:
    before = os.environ.get(_DISCOVERY)
    os.environ[_DISCOVERY] = 'OFF'
    try:
        runtime = NodeRuntime('building', args=())
    finally:
        if before is None:
            del os.environ[_DISCOVERY]
        else:
            os.environ[_DISCOVERY] = before
    run.at_end(runtime.close)
    return StateServices.of(runtime)


def _say_nothing(severity: Severity, path: str, text: str) -> None:
    """What states say in their constructors is for the operator of a run."""
