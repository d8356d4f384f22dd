# SPDX-License-Identifier: BSD-3-Clause
"""Keeps the tree that a state runs paused as long as the state is."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Final

from flexbt_common.calls import ServiceCall, ServiceLink, ServiceOutcome
from flexbt_core.state_machine import EventState
from flexbt_msgs.srv import ControlTree
from flexbt_onboard.behaviors import state_services

_RESPONSE_SECONDS: Final = 10.0
"""A pause is answered when the tick that is under way is over."""

_PATIENCE_SECONDS: Final = 0.5
"""A tree that is not known to be paused after this time counts as one that is not."""


class TreePause:
    """Asks the BT server to pause and resume the run of one goal, one request at a time, until it is as wanted.

    A run that the server does not know yet is asked for again when its feedback comes. From any thread. What the server
    says that goes on all the same is told by :meth:`not_paused`.
    """

    def __init__(self, state: EventState, link: ServiceLink, run_id: str) -> None:
        self._state = state
        self._services = state_services(state)
        self._link = link
        self._run_id = run_id
        self._lock = threading.Lock()
        self._is_known = self._is_over = False
        self._wanted = self._is = False
        self._wanted_at = 0.0
        self._goes_on: Sequence[str] = ()
        self._call: ServiceCall | None = None

    def set(self, paused: bool) -> None:
        """The tree is to be paused, or not."""
        with self._lock:
            self._wanted = paused
            self._wanted_at = self._services.runtime.steady.now()
            self._agree()

    def end(self) -> None:
        """The state is left, and the server has said that the goal has ended: whoever has taken over the tree that was
        paused for it is not to wait for this state.
        """
        with self._lock:
            self._wanted = False
            self._is_known = self._is_over = True
            self._agree()

    @property
    def wanted(self) -> bool:
        """Whether the tree is to be paused."""
        return self._wanted

    def not_paused(self) -> Sequence[str]:
        """Why the tree goes on although it is to be paused, or which of its leaves do; empty when all stands still."""
        with self._lock:
            waits = self._wanted and not self._is
            goes_on, wanted_at = self._goes_on, self._wanted_at
        if waits and self._services.runtime.steady.now() - wanted_at > _PATIENCE_SECONDS:
            return (f'{self._link.name} has not confirmed the pause of the tree',)
        return goes_on

    def run_seen(self) -> None:
        """The run exists, and knows its goal."""
        if self._wanted is not self._is:
            with self._lock:
                self._is_known = True
                self._agree()

    def _agree(self) -> None:
        if self._call is not None or self._wanted is self._is:
            return
        wanted, is_known = self._wanted, self._is_known
        command = ControlTree.Request.PAUSE if wanted else ControlTree.Request.RESUME
        self._call = ServiceCall(
            self._link,
            ControlTree.Request(command=command, run_id=self._run_id, owner=self._services.node_name),
            on_done=lambda outcome: self._answered(wanted, is_known, outcome),
            response_timeout=_RESPONSE_SECONDS,
        )

    def _answered(self, wanted: bool, was_known: bool, outcome: ServiceOutcome) -> None:
        reason = outcome.reason if outcome.response is None else str(outcome.response.message)
        with self._lock:
            self._call = None
            if was_known or not reason:
                self._is = wanted
                self._goes_on = _what_goes_on(outcome) if wanted else ()
            if was_known or self._is_known or not reason:
                self._agree()  # otherwise it is asked again by run_seen
            is_over = self._is_over  # then nobody may have taken the tree over, and there is no run
        if is_over:
            return
        self._services.changed()
        if reason and was_known and not wanted:
            self._state.log_warn(f'the tree was not resumed: {reason}')


def _what_goes_on(outcome: ServiceOutcome) -> Sequence[str]:
    """Of a tree that was asked to pause, from the answer."""
    if outcome.response is None:
        return (f'the tree was not paused: {outcome.reason}',)
    if outcome.response.message:
        return (f'the tree was not paused: {outcome.response.message}',)
    return tuple(outcome.response.not_paused)
