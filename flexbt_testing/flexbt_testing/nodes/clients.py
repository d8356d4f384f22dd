# SPDX-License-Identifier: BSD-3-Clause
"""Clients for tests: a goal that a test waits for, and the services of a managed node."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any, Final, TypeVar

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState
from nav2_msgs import action

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, ActionServerLink, GoalOutcome
from flexbt_common.calls.service_call import ServiceCall, ServiceLinks, ServiceOutcome
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.waiting import DEADLINE, RESEND_SECONDS

_TYPES: Final = {name.casefold(): getattr(action, name) for name in dir(action) if not name.startswith('_')}

ACTIONS: Final[Mapping[str, Any]] = {
    name: _TYPES[name.replace('_', '')]
    for name in (
        *itertools.chain.from_iterable(names.ACTIONS_OF_SERVERS.values()),
        names.FOLLOW_OBJECT,
        names.NAVIGATE_TO_POSE,
        names.NAVIGATE_THROUGH_POSES,
    )
}
"""Types of the navigation actions, by name."""


class SentGoal:
    """A goal with its feedback and its end. Do not wait for it on the executor thread.

    ``accepted`` is set once the server has accepted the goal; ``call`` is the call.
    """

    def __init__(self, link: ActionServerLink, goal: Any, deadline: float = 20.0) -> None:
        """Send a goal. ``deadline``, s of wall time, limits discovery, acceptance, canceling, and each :meth:`wait`."""
        self._deadline = deadline
        self._ended = threading.Event()
        self.feedback: list[Any] = []
        self.accepted = threading.Event()
        self.outcomes: list[GoalOutcome] = []
        self.call = ActionCall(
            link,
            goal,
            on_done=self._done,
            on_feedback=self.feedback.append,
            on_accepted=self.accepted.set,
            server_timeout=deadline,
            accept_timeout=deadline,
        )

    def _done(self, outcome: GoalOutcome) -> None:
        self.outcomes.append(outcome)
        self._ended.set()

    @property
    def ended(self) -> bool:
        """True once the outcome is known."""
        return self._ended.is_set()

    def cancel(self) -> None:
        """Ask the server to cancel the goal; see :meth:`ActionCall.cancel`."""
        self.call.cancel(self._deadline)

    def wait(self, timeout: float | None = None) -> GoalOutcome:
        """Return the outcome.

        Raises:
            TimeoutError: the goal did not end in time.
        """
        timeout = self._deadline if timeout is None else timeout
        if not self._ended.wait(timeout):
            raise TimeoutError(f'a goal did not end within {timeout:g} s')
        (outcome,) = self.outcomes
        return outcome

    @property
    def result(self) -> Any:
        """The result message. Raises like :meth:`wait`, and RuntimeError if the goal ended without one."""
        outcome = self.wait()
        if outcome.result is None:
            raise RuntimeError(outcome.reason)
        return outcome.result


# Lifecycle services of a managed node, called as lifecycle managers do.

T = TypeVar('T')


class LifecycleClient:
    """A client that sends requests to the node ``name`` and waits for the answers.

    Do not use it on the executor thread of ``runtime``.
    """

    def __init__(self, runtime: NodeRuntime, name: str) -> None:
        self._links = ServiceLinks(runtime)
        self._name = name

    def state(self) -> str:
        """Return the label of the current state."""
        return str(self._ask(GetState, 'get_state', GetState.Request()).current_state.label)

    def states(self) -> list[str]:
        """Return the labels of all states."""
        answer = self._ask(GetAvailableStates, 'get_available_states', GetAvailableStates.Request())
        return [state.label for state in answer.available_states]

    def transitions(self, service: str = 'get_available_transitions') -> list[tuple[int, str, str]]:
        """Return number, label and start of the possible transitions, or of all (``get_transition_graph``)."""
        answer = self._ask(GetAvailableTransitions, service, GetAvailableTransitions.Request())
        return [
            (one.transition.id, one.transition.label, one.start_state.label) for one in answer.available_transitions
        ]

    def change(self, transition: int | str) -> bool:
        """Make a transition, by number or label. Wait for its end and return whether it succeeded."""
        return self.begin(transition).result(DEADLINE)

    def begin(self, transition: int | str) -> Future[bool]:
        """Request a transition. The future returns whether it succeeded, once it is over.

        The answer of a node that was just discovered may be lost, and a transition must not be requested twice. So
        query the state first.
        """
        self.state()
        wanted = Transition(label=transition) if isinstance(transition, str) else Transition(id=transition)
        request = ChangeState.Request(transition=wanted)
        return self._send(ChangeState, 'change_state', request, lambda answer: bool(answer.success), DEADLINE)

    def _ask(self, service_type: Any, service: str, request: Any) -> Any:
        """Return the answer to a request, repeated until one arrives."""
        deadline = time.monotonic() + DEADLINE
        while True:
            try:
                return self._send(service_type, service, request, lambda answer: answer, RESEND_SECONDS).result()
            except TimeoutError:
                if time.monotonic() > deadline:
                    raise

    def _send(
        self, service_type: Any, service: str, request: Any, read: Callable[[Any], T], response_timeout: float
    ) -> Future[T]:
        answer: Future[T] = Future()

        def done(outcome: ServiceOutcome) -> None:
            if outcome.response is None:
                answer.set_exception(TimeoutError(outcome.reason))
            else:
                answer.set_result(read(outcome.response))

        ServiceCall(
            self._links.link(service_type, f'{self._name}/{service}'),
            request,
            on_done=done,
            server_timeout=DEADLINE,
            response_timeout=response_timeout,
        )
        return answer
