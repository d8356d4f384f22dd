# SPDX-License-Identifier: BSD-3-Clause
"""Whose an operator's name is: of the participant that commands under it, as long as that is there.

The name says who has the authority and who did what, and anybody can write any name into a command. But the middleware
tells which participant has sent it, so that a name which is in use is nobody else's. It is free again when its console
has ended, or the middleware misses it. (Which participants may command at all is for DDS security.)
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from flexbt_common.runtime import UNKNOWN_WRITER
from flexbt_onboard.errors import CommandRefusedError

NAMES_OF_PARTICIPANT: Final = 16
"""Names of one participant, at most: a program may speak for several operators."""

_TOLD: Final = 256


class OperatorNames:
    """The names that are in use. Used on the executor thread only.

    ``node_of`` gives the node of a participant that can command, '' when there is none any more; ``has_gone`` whether a
    participant has said that it goes; ``tell`` gets a line for the operators.
    """

    def __init__(
        self, node_of: Callable[[bytes], str], has_gone: Callable[[bytes], bool], tell: Callable[[str], None]
    ) -> None:
        self._node_of = node_of
        self._has_gone = has_gone
        self._tell = tell
        self._owners: OrderedDict[str, bytes] = OrderedDict()
        self._told: OrderedDict[tuple[str, bytes], None] = OrderedDict()

    def check(self, operator: str, participant: bytes) -> None:
        """Note that a participant commands under a name.

        Raises:
            CommandRefusedError: another one does, and is there.
        """
        if not operator or participant == UNKNOWN_WRITER:
            return
        owner = self._owners.get(operator, participant)
        if owner != participant and not self._has_gone(owner) and (node := self._node_of(owner)):
            self._tell_once(operator, participant, node)
            raise CommandRefusedError(
                f'operator {operator!r} commands from another console, {node}; end that one, or choose another name '
                '(--operator, FLEXBT_OPERATOR)'
            )
        self._owners[operator] = participant
        self._owners.move_to_end(operator)
        own = [name for name, owner in self._owners.items() if owner == participant]
        if len(own) > NAMES_OF_PARTICIPANT:  # whoever uses up many names loses its own ones, and no one else's
            del self._owners[own[0]]

    def _tell_once(self, operator: str, participant: bytes, owner: str) -> None:
        if (operator, participant) in self._told:
            return
        self._told[operator, participant] = None
        while len(self._told) > _TOLD:
            self._told.popitem(last=False)
        node = self._node_of(participant) or 'a node that is gone'
        self._tell(f'{node} commands under the name of operator {operator!r}, who is at {owner}; that is refused')
