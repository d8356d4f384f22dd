# SPDX-License-Identifier: BSD-3-Clause
"""The authority to command, and the names of operators.

Any number of operators watch, at most one holds the authority, and each name belongs to one DDS participant.

- While nobody holds the authority, every operator may send commands.
- An operator who claims a free authority gets it. Otherwise the operator becomes a requester, and the holder sees
  the request.
- The holder can release the authority, hand it over to another operator, or refuse a requester, who may ask again.
- The holder loses the authority after a timeout without a connected console and without a command.
- A released or lost authority passes to the oldest requester who is connected.
- A requester who is disconnected for the same timeout is dropped. The number of requesters is limited; connected
  operators take precedence.
- STOP needs no authority. Every operator may stop the robot at any time.

Goals of the action ``execute_behavior`` come from programs, not from operators. They need no authority either.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import Final

from flexbt_common.lifecycle.presence import PresenceWatch
from flexbt_common.middleware.received_messages import UNKNOWN_WRITER
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_msgs.msg import ExecutiveLog
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.link.console_link import ConsoleLink
from flexbt_onboard.link.reporter import Reporter
from flexbt_onboard.link.status_publisher import StatusPublisher

REQUESTS: Final = 16
"""Maximum number of operators that may request the authority at a time, since every status lists them."""


class Authority:
    """The authority over one executive. Used on the executor thread only.

    ``holder`` is the operator who has the authority, '' for nobody. ``presence`` reports the connected operators.
    ``timeout`` is in seconds of wall time.
    """

    def __init__(
        self,
        runtime: Runtime,
        presence: PresenceWatch,
        timeout: float,
        report: Reporter,
        status: StatusPublisher,
    ) -> None:
        self.holder = ''
        self._requests: dict[str, float] = {}  # requesters, and when each has gone; infinity: is connected
        self._runtime = runtime
        self._timeout = timeout
        self._report = report
        self._status = status
        self._presence = presence
        self._was_present = False
        self._timer: Timer | None = None
        self._requests_timer: Timer | None = None
        presence.add_listener(self._presence_changed)

    def _on_change(self, text: str) -> None:
        """Report the current holder and requesters; ``text`` has the reason."""
        self._report.log(ExecutiveLog.INFO, text)
        self._report.event('authority', holder=self.holder, requests=self.requests, text=text)
        self._status.changed()

    @property
    def requests(self) -> list[str]:
        """Operators who ask for the authority, oldest request first."""
        return list(self._requests)

    def check(self, operator: str) -> None:
        """Check that an operator may send commands, and count the command as a sign of life of the holder.

        Raises:
            CommandRefusedError: another operator has the authority.
        """
        if self.holder and operator != self.holder:
            raise CommandRefusedError(
                f'operator {self.holder!r} has the authority to command; claim it, and wait until it is handed over'
            )
        self._seen()

    def claim(self, operator: str) -> None:
        """Give the free authority to an operator, or add the operator to the requesters.

        Raises:
            CommandRefusedError: the operator has no name, or too many operators ask for the authority.
        """
        if not operator:
            raise CommandRefusedError('only an operator with a name can claim the authority; set operator_id')
        if self.holder == operator:
            self._seen()
        elif not self.holder:
            self._give(operator, 'claimed it')
        else:
            self._request(operator)

    def release(self, operator: str) -> None:
        """Release the authority of its holder, or withdraw the request of a requester.

        Raises:
            CommandRefusedError: the operator is neither holder nor requester.
        """
        if operator and operator == self.holder:
            self._pass_on(f'{operator!r} released it')
        elif operator in self._requests:
            del self._requests[operator]
            self._on_change(f'operator {operator!r} does not ask for the authority to command any more')
        else:
            raise CommandRefusedError(f'{operator!r} does not have the authority to command, and did not ask for it')

    def hand_over(self, operator: str, grantee: str) -> None:
        """Hand the authority of ``operator`` over to ``grantee``.

        Raises:
            CommandRefusedError: ``operator`` does not have the authority.
        """
        self._check_holder(operator)
        if grantee != operator:
            is_there = grantee in self._presence.present
            absent = '' if is_there else f'; no console of {grantee!r} is there, and it ends after {self._timeout:g} s'
            self._give(grantee, f'{operator!r} handed it over{absent}')

    def refuse(self, operator: str, requester: str) -> None:
        """Remove a requester who asks for the authority of ``operator``.

        Raises:
            CommandRefusedError: ``operator`` does not have the authority, or ``requester`` does not ask for it.
        """
        self._check_holder(operator)
        if requester not in self._requests:
            raise CommandRefusedError(f'{requester!r} does not ask for the authority to command')
        del self._requests[requester]
        self._on_change(f'operator {operator!r} refuses {requester!r}, who asked for the authority to command')

    def _check_holder(self, operator: str) -> None:
        if not operator or operator != self.holder:
            raise CommandRefusedError(f'{operator!r} does not have the authority to command, so cannot give it away')
        self._seen()

    def _request(self, operator: str) -> None:
        there = self._presence.present
        since = math.inf if operator in there else self._runtime.steady.now()
        if operator in self._requests:
            self._requests[operator] = since
            return
        if len(self._requests) >= REQUESTS:
            absent = next((one for one in self._requests if one not in there), None)
            if absent is None or operator not in there:
                raise CommandRefusedError(
                    f'{len(self._requests)} operators ask for the authority already; try again when there are fewer'
                )
            del self._requests[absent]
        self._requests[operator] = since
        self._on_change(f'operator {operator!r} asks {self.holder!r} for the authority to command')
        self._expire_requests()

    def _expire_requests(self) -> None:
        """Drop the requests of operators who are gone for too long, now and whenever the next one times out."""
        now, there = self._runtime.steady.now(), self._presence.present
        for operator, since in list(self._requests.items()):
            if operator in there:
                self._requests[operator] = math.inf
            elif since == math.inf:
                self._requests[operator] = now
            elif now >= since + self._timeout:
                del self._requests[operator]
                self._on_change(f'operator {operator!r}, who asked for the authority, was gone for {self._timeout:g} s')
        if self._requests_timer is not None:
            self._requests_timer.cancel()
        next_end = min(self._requests.values(), default=math.inf) + self._timeout
        if next_end < math.inf:
            self._requests_timer = self._runtime.post_at(next_end, self._expire_requests)

    def _pass_on(self, why: str) -> None:
        there = self._first_there()
        if there:
            self._give(there, why)
        else:
            self._set_holder('')
            self._on_change(f'nobody has the authority to command: {why}; every operator may')

    def _first_there(self) -> str:
        """Return the oldest requester who is connected; '' for nobody."""
        return next((operator for operator in self._requests if operator in self._presence.present), '')

    def _give(self, operator: str, why: str) -> None:
        self._requests.pop(operator, None)
        self._set_holder(operator)
        self._on_change(f'operator {operator!r} has the authority to command: {why}')

    def _set_holder(self, operator: str) -> None:
        self.holder = operator
        self._seen()

    def _presence_changed(self) -> None:
        if self._is_present is not self._was_present:
            self._seen()
        self._expire_requests()
        if not self.holder and (there := self._first_there()):
            self._give(there, 'asked for it, and is there again')

    def _seen(self) -> None:
        """Restart the timeout: the holder gave a sign of life, or their last console has disconnected."""
        self._was_present = self._is_present
        if self._timer is not None:
            self._timer.cancel()
        if self.holder and not self._is_present:
            self._timer = self._runtime.post_in(self._timeout, self._time_is_over)

    @property
    def _is_present(self) -> bool:
        return self.holder in self._presence.present

    def _time_is_over(self) -> None:
        self._pass_on(f'{self.holder!r} was gone for {self._timeout:g} s')


# The owner of an operator's name is the participant that sends commands under it, as long as it exists.
#
# The authority and the logs refer to the name, but any program can write any name into a command. The middleware
# reports which participant has sent a command, so no other participant can use a name that is in use. A name is free
# again when its console has ended, or when the middleware considers it dead. (DDS security controls which participants
# may send commands at all.)

NAMES_OF_PARTICIPANT: Final = 16
"""Maximum number of names of one participant. It may have several, since a program may act for several operators."""

FEW_NAMES: Final = 256
"""Number of names up to which those of participants that are gone are kept."""

_TOLD: Final = 256


class OperatorNames:
    """The names of operators that are in use. Used on the executor thread only."""

    def __init__(self, link: ConsoleLink, presence: PresenceWatch, report: Reporter) -> None:
        self._link = link
        self._presence = presence
        self._report = report
        self._owners: OrderedDict[str, bytes] = OrderedDict()
        self._limit = FEW_NAMES
        self._told: OrderedDict[tuple[str, bytes], None] = OrderedDict()

    def check(self, operator: str, participant: bytes) -> None:
        """Note that a participant sends commands under a name.

        Raises:
            CommandRefusedError: another participant that still exists uses the name.
        """
        if not operator or participant == UNKNOWN_WRITER:
            return
        owner = self._owners.get(operator, participant)
        if owner != participant and (node := self._node_of(owner)):
            self._tell_once(operator, participant, node)
            raise CommandRefusedError(
                f'operator {operator!r} commands from another console, {node}; end that one, or choose another name '
                '(--operator, FLEXBT_OPERATOR)'
            )
        if len(self._owners) >= self._limit:
            there = {owner for owner in set(self._owners.values()) if self._node_of(owner)}
            self._owners = OrderedDict((name, owner) for name, owner in self._owners.items() if owner in there)
            self._limit = max(FEW_NAMES, 2 * len(self._owners))
        self._owners[operator] = participant
        self._owners.move_to_end(operator)
        own = [name for name, owner in self._owners.items() if owner == participant]
        if len(own) > NAMES_OF_PARTICIPANT:  # a participant that uses many names loses only its own
            del self._owners[own[0]]

    def _node_of(self, owner: bytes) -> str:
        """Return the node of the owner of a name; '' if it is gone."""
        return '' if self._presence.has_gone(owner) else self._link.node_of(owner)

    def _tell_once(self, operator: str, participant: bytes, owner: str) -> None:
        if (operator, participant) in self._told:
            return
        self._told[operator, participant] = None
        while len(self._told) > _TOLD:
            self._told.popitem(last=False)
        node = self._link.node_of(participant) or 'a node that is gone'
        text = f'{node} commands under the name of operator {operator!r}, who is at {owner}; that is refused'
        self._report.operators(text, is_warning=True)
