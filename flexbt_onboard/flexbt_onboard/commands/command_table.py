# SPDX-License-Identifier: BSD-3-Clause
"""What became of the operator's commands: each is applied at most once, and answered as often as it is sent."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Iterable
from typing import Final

from flexbt_msgs.msg import CommandResult

REMEMBERED_COMMANDS: Final = 4096
"""Commands whose identifiers are remembered; a resend of an older one would be taken for a new command."""

REPORTED_RESULTS: Final = 32
"""Results that are part of a status at most (ExecutiveStatus.results)."""

REPORT_TIME: Final = 5.0
"""Seconds for which a result is part of every status. A console that has lost it sends the command again, and so has it
reported again; without this limit most of a quiet link's traffic would be old results."""


class CommandTable:
    """Results by command identifier. Used on the executor thread only."""

    def __init__(
        self,
        remembered: int = REMEMBERED_COMMANDS,
        reported: int = REPORTED_RESULTS,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._remembered = remembered
        self._reported = reported
        self._now = now
        self._results: OrderedDict[str, CommandResult | None] = OrderedDict()
        self._latest: OrderedDict[str, float] = OrderedDict()  # when each was reported last

    def restore(self, results: Iterable[CommandResult]) -> None:
        """Remember what was decided before a restart, the oldest first."""
        for result in results:
            self._results[result.command_id] = result
        self._forget_old()

    def __contains__(self, command_id: str) -> bool:
        """Whether the command was seen before, and is remembered."""
        return command_id in self._results

    def admit(self, command_id: str) -> bool:
        """Whether the command is new. The result of one that was decided is reported again."""
        if command_id in self._results:
            if self._results[command_id] is not None:
                self._report(command_id)
            return False
        self._results[command_id] = None
        self._forget_old()
        return True

    def settle(self, command_id: str, reason: str | None = None) -> CommandResult:
        """Record the result of an admitted command: applied, or refused for ``reason``."""
        code = CommandResult.APPLIED if reason is None else CommandResult.REFUSED
        result = CommandResult(command_id=command_id, code=code, reason=reason or '')
        self._results[command_id] = result
        self._report(command_id)
        return result

    def latest(self) -> list[CommandResult]:
        """The latest results, oldest first."""
        oldest = self._now() - REPORT_TIME
        while self._latest and next(iter(self._latest.values())) < oldest:
            self._latest.popitem(last=False)
        return [result for command_id in self._latest if (result := self._results.get(command_id)) is not None]

    def _report(self, command_id: str) -> None:
        self._latest[command_id] = self._now()
        self._latest.move_to_end(command_id)
        while len(self._latest) > self._reported:
            self._latest.popitem(last=False)

    def _forget_old(self) -> None:
        while len(self._results) > self._remembered:
            # A command that is not decided yet is never the oldest by far: only a START takes longer than a moment.
            oldest = next((key for key, result in self._results.items() if result is not None), None)
            if oldest is None:
                return
            del self._results[oldest]
