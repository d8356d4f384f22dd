# SPDX-License-Identifier: BSD-3-Clause
"""Who watches a run."""

from __future__ import annotations

import logging
from typing import Final, Protocol

from flexbt_core.state_machine.model import ExitReason, Severity

_logger = logging.getLogger(__name__)

_LEVELS: Final = {
    Severity.DEBUG: logging.DEBUG,
    Severity.INFO: logging.INFO,
    Severity.HINT: logging.INFO,
    Severity.WARN: logging.WARNING,
    Severity.ERROR: logging.ERROR,
}


class RunObserver(Protocol):
    """Hears of a run, on the thread of the run; lines of states may come from any thread."""

    def changed(self) -> None:
        """Something that the operator is shown has changed."""

    def log(self, severity: Severity, path: str, text: str) -> None:
        """A line for the operator."""

    def fault(self, path: str, text: str) -> None:
        """A state raised, or did not halt."""

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        """A state or machine was left.

        ``target`` is the path of what follows, ``=OUTCOME`` of the machine around it, or '' for a child of a
        concurrency container which goes on without it. One that is repeated has no outcome, and follows itself.
        """


class LoggingObserver:
    """Writes what a run tells to the log of Python: each transition as INFO, faults as ERROR."""

    def changed(self) -> None:
        """Nothing to write: what changed is told by the rest."""

    def log(self, severity: Severity, path: str, text: str) -> None:
        _logger.log(_LEVELS[severity], '%s: %s', path, text)

    def fault(self, path: str, text: str) -> None:
        _logger.error('%s: %s', path, text)

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        _logger.info('%s > %s, %s', path, outcome or '(again)', reason.value)
