# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors that are built and never run: for tools that inspect their state machines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from flexbt_common.runtime import NodeRuntime, offline_default_context, undiscovered
from flexbt_core.state_machine import Severity

from .run_context import RunContext
from .run_services import StateServices


@contextmanager
def building() -> Iterator[None]:
    """For the length of the block behaviors can be built whose constructors want ROS, as FlexBE's do.

    They get a node when they ask for one, and rclpy's default context. Their nodes discover nobody and are discovered
    by nobody.
    """
    run = RunContext(lambda: _services(run), _say_nothing)
    with offline_default_context(), run.entered():
        yield


def _services(run: RunContext) -> StateServices:
    with undiscovered():
        runtime = NodeRuntime('building', args=())
    run.at_end(runtime.close)
    return StateServices.of(runtime)


def _say_nothing(severity: Severity, path: str, text: str) -> None:
    """What states say in their constructors is for the operator of a run."""
