# SPDX-License-Identifier: BSD-3-Clause
"""Who hears how a run of a behavior goes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from flexbt_core.state_machine import Position
from flexbt_msgs.msg import BehaviorStructure
from flexbt_onboard.behaviors import RunRequest
from flexbt_onboard.durability import Decided

from .run_snapshot import RunEnd


class BehaviorRunObserver(Protocol):
    """Hears of a run, on the thread of the run; ``changed``, ``log`` and ``stopping`` from any thread."""

    def changed(self) -> None:
        """There is another snapshot."""

    def built(self, request: RunRequest, structure: BehaviorStructure) -> None:
        """The behavior is built and begins; :meth:`BehaviorRun.announce` is called when the structure is published."""

    def refused(self, reason: str) -> None:
        """The behavior could not be built. Nothing follows."""

    def log(self, severity: int, path: str, text: str) -> None:
        """A line for the operator."""

    def event(self, event: str, fields: Mapping[str, Any]) -> None:
        """Something for the event log."""

    def moved(self, position: Callable[[], Position], decided: Sequence[Decided]) -> None:
        """The machine is where it was not before, or commands were decided; both are told when this returns."""

    def switched(self, request: RunRequest, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior, whose structure that is; :meth:`moved` follows."""

    def stopping(self, why: str) -> None:
        """The run is told to stop; it is stopped, and shown so, when this returns."""

    def ended(self, end: RunEnd) -> None:
        """The run has ended. Nothing follows."""
