# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's StateLogger: records for the analysis of runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from flexbt_core.state_machine import EventState, Severity
from flexbt_onboard.behaviors import current_run

from .ros_access import RosAccess

Class = TypeVar('Class', bound=type[Any])


class StateLogger(RosAccess):
    """Records become debug lines of the run.

    The executive records entering, leaving, outcomes and decisions of every state by itself, so that the decorators
    which add this to single classes leave them as they are.
    """

    @staticmethod
    def initialize(be_name: str | None = None) -> None:
        """Does nothing: a run always records."""

    @staticmethod
    def shutdown() -> None:
        """Does nothing."""

    @staticmethod
    def log(name: str, state: EventState, **kwargs: Any) -> None:
        """Record something of a state, under the name of a logger."""
        fields = ' '.join(f'{key}={value!r}' for key, value in kwargs.items())
        current_run().log(Severity.DEBUG, state.path, f'{name}: {fields}')

    @staticmethod
    def log_events(name: str, **events: str) -> Callable[[Class], Class]:
        """Decorator of classes."""
        return _unchanged

    @staticmethod
    def log_outcomes(name: str) -> Callable[[Class], Class]:
        """Decorator of classes."""
        return _unchanged

    @staticmethod
    def log_userdata(name: str, keys: list[str] | None = None) -> Callable[[Class], Class]:
        """Decorator of classes."""
        return _unchanged


def _unchanged(decorated: Class) -> Class:
    return decorated
