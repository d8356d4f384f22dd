# SPDX-License-Identifier: BSD-3-Clause
"""What a state sees of the run that it is part of."""

from __future__ import annotations

from enum import Enum
from typing import Any, Protocol

from flexbt_core.clock import Clock


class Severity(Enum):
    """Weight of a line for the operator; the values are the constants of ExecutiveLog."""

    DEBUG = 1
    INFO = 2
    HINT = 3
    WARN = 4
    ERROR = 5


class StateHost(Protocol):
    """The place of a state in its run. A state is bound to one from before on_start until after on_stop."""

    @property
    def path(self) -> str:
        """Path of the state in its run, as in ``/Outer/Inner``."""

    @property
    def outcome(self) -> str | None:
        """The outcome by which the state is to be left, be it the state that wants it or the operator; None to stay."""

    @property
    def clock(self) -> Clock:
        """The clock of the run, which stands still while the state is paused."""

    @property
    def services(self) -> Any:
        """What whoever runs the machine provides to its states."""

    def wake(self) -> None:
        """Execute the state soon; from any thread."""

    def wake_at(self, time: float) -> None:
        """Execute the state at a time of its clock, too."""

    def ask(self, prompt: str, suggestion: str | None) -> None:
        """Let the operator choose the outcome."""

    def log(self, severity: Severity, text: str) -> None:
        """Tell the operator something; from any thread."""
