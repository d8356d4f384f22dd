# SPDX-License-Identifier: BSD-3-Clause
"""What an operator is told of the commands that were sent: that there is no answer yet, and what became of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from flexbt_console.mirror import CommandState, Confirmation, Mirror
from flexbt_console.present import command_result_lines
from flexbt_core.clock import Clock

SOON_SECONDS: Final = 0.5
"""Of a command that is answered within that time only the answer is told."""


@dataclass(frozen=True, slots=True)
class _Sent:
    mirror: Mirror
    given: float
    told: tuple[CommandState, Confirmation | None] | None = None


class SentCommands:
    """The commands of one operator, for one robot or several. An answer after the time-out is told, too."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._sent: dict[str, _Sent] = {}

    def add(self, mirror: Mirror, command_id: str) -> None:
        """It was given to the robot of that mirror."""
        self._sent[command_id] = _Sent(mirror, self._clock.now())

    def __bool__(self) -> bool:
        """Whether there is a command of which more may be told."""
        return bool(self._sent)

    def updates(self) -> list[list[str]]:
        """The lines of each command whose state has changed since the last call, in the order of sending."""
        updates = []
        for command_id, sent in list(self._sent.items()):
            tracked = sent.mirror.command(command_id)
            if tracked is None or (
                tracked.state in (CommandState.APPLIED, CommandState.REFUSED)
                and tracked.confirmed_by is not Confirmation.STOP_GUARD  # the executive may still confirm it
            ):
                del self._sent[command_id]
            elif (tracked.state, tracked.confirmed_by) == sent.told or (
                tracked.state is CommandState.PENDING and self._clock.now() < sent.given + SOON_SECONDS
            ):
                continue
            else:
                self._sent[command_id] = _Sent(sent.mirror, sent.given, (tracked.state, tracked.confirmed_by))
            if tracked is not None:
                updates.append(command_result_lines(tracked))
        return updates
