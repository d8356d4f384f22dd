# SPDX-License-Identifier: BSD-3-Clause
"""Who may command: any number of operators watch, and at most one holds the authority.

- While nobody holds it, every operator may command.
- Whoever claims it gets it when it is free, and is a requester otherwise, whom the holder sees.
- The holder gives it back, or hands it over to somebody. What is given back goes to the oldest requester.
- It is lost when the holder was gone for a set time: no console of theirs, and no command. That goes on to the oldest
  requester, too.
- Stopping the robot needs no authority: anybody may do that at any time.

Goals of the action ``execute_behavior`` come from programs, not from operators; they need no authority either.
"""

from __future__ import annotations

from collections.abc import Callable

from flexbt_common.liveness import PresenceWatch
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import Timer
from flexbt_onboard.errors import CommandRefusedError


class Authority:
    """The authority over one executive. Used on the executor thread only.

    ``holder`` is the operator who has it, '' for nobody; ``requests`` are those who ask for it, the oldest first.
    ``presence`` tells who is there, ``timeout`` is in seconds of wall time. ``on_change`` gets a line that says who has
    it now, and why.
    """

    def __init__(
        self, runtime: NodeRuntime, presence: PresenceWatch, timeout: float, on_change: Callable[[str], None]
    ) -> None:
        self.holder = ''
        self.requests: list[str] = []
        self._runtime = runtime
        self._timeout = timeout
        self._on_change = on_change
        self._presence = presence
        self._was_present = False
        self._last_seen = 0.0
        self._timer: Timer | None = None
        presence.add_listener(self._presence_changed)

    def check(self, operator: str) -> None:
        """Take note that an operator commands.

        Raises:
            CommandRefusedError: another one has the authority.
        """
        if self.holder and operator != self.holder:
            raise CommandRefusedError(
                f'operator {self.holder!r} has the authority to command; claim it, and wait until it is handed over'
            )
        self._seen()

    def claim(self, operator: str) -> None:
        """Give the authority to an operator, or put their request on the list.

        Raises:
            CommandRefusedError: the operator has no name.
        """
        if not operator:
            raise CommandRefusedError('only an operator with a name can claim the authority; set operator_id')
        if self.holder == operator:
            self._seen()
        elif not self.holder:
            self._give(operator, 'claimed it')
        elif operator not in self.requests:
            self.requests.append(operator)
            self._on_change(f'operator {operator!r} asks {self.holder!r} for the authority to command')

    def release(self, operator: str) -> None:
        """Take the authority back from its holder, or a requester from the list.

        Raises:
            CommandRefusedError: the operator is neither.
        """
        if operator and operator == self.holder:
            self._pass_on(f'{operator!r} released it')
        elif operator in self.requests:
            self.requests.remove(operator)
            self._on_change(f'operator {operator!r} does not ask for the authority to command any more')
        else:
            raise CommandRefusedError(f'{operator!r} does not have the authority to command, and did not ask for it')

    def hand_over(self, operator: str, grantee: str) -> None:
        """Give the authority of ``operator`` to another operator.

        Raises:
            CommandRefusedError: the operator does not have it, or the other one has no name.
        """
        if not operator or operator != self.holder:
            raise CommandRefusedError(f'{operator!r} does not have the authority to command; nothing to hand over')
        if not grantee:
            raise CommandRefusedError('HAND_OVER_AUTHORITY must name in grantee who gets it')
        if grantee != operator:
            self._give(grantee, f'{operator!r} handed it over')

    def _pass_on(self, why: str) -> None:
        if self.requests:
            self._give(self.requests[0], why)
        else:
            self._set_holder('')
            self._on_change(f'nobody has the authority to command: {why}; every operator may')

    def _give(self, operator: str, why: str) -> None:
        if operator in self.requests:
            self.requests.remove(operator)
        self._set_holder(operator)
        self._on_change(f'operator {operator!r} has the authority to command: {why}')

    def _set_holder(self, operator: str) -> None:
        self.holder = operator
        self._seen()

    def _presence_changed(self) -> None:
        if self._is_present is not self._was_present:
            self._seen()

    def _seen(self) -> None:
        """The holder gave a sign of life, or their last console went: the time counts from now."""
        self._last_seen = self._runtime.steady.now()
        self._was_present = self._is_present
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self.holder and not self._is_present:
            when = self._last_seen + self._timeout
            self._timer = self._runtime.steady.call_at(when, lambda: self._runtime.post(self._time_is_over))

    @property
    def _is_present(self) -> bool:
        return self.holder in self._presence.present

    def _time_is_over(self) -> None:
        is_late = self._runtime.steady.now() >= self._last_seen + self._timeout
        if self.holder and is_late and not self._is_present:  # nothing happened since this was posted
            self._pass_on(f'{self.holder!r} was gone for {self._timeout:g} s')
