# SPDX-License-Identifier: BSD-3-Clause
"""All that this code uses of rclpy's private parts, and what stands for them where rclpy has changed.

rclpy (7.1, ROS 2 Jazzy) can be used without them, and everything works then: each use of private parts below only makes
something faster, or mends something that rclpy leaves undone. Once in a process, before the first node is made, it is
looked whether rclpy still has each part, with the signature that is expected. Where one is missing, its use is left
out as a whole, what is documented takes its place, and every node warns at its start (:func:`warnings`).

The environment variable FLEXBT_STOCK_RCLPY=1 leaves out all of them. :func:`release_lifecycle` has no private name:
it finds an attribute by its type, and does nothing where there is none.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Coroutine, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from time import monotonic
from types import FunctionType
from typing import Any, Final

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer
from rclpy.action.server import GoalEvent, RCLError, ServerGoalHandle
from rclpy.exceptions import InvalidHandle
from rclpy.executors import SingleThreadedExecutor
from rclpy.guard_condition import GuardCondition
from rclpy.impl import rcutils_logger
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.task import Task
from rclpy.waitable import NumberOfEntities

SWITCH: Final = 'FLEXBT_STOCK_RCLPY'


@dataclass(frozen=True)
class PrivatePart:
    """A private part of rclpy: a method with the number of its parameters after ``self``, an attribute that methods of
    the class set (``parameters`` None), or a member of a compiled class (None as well)."""

    owner: type
    name: str
    parameters: int | None = None

    def fault(self) -> str:
        """Return what is wrong with it; '' when it is as expected."""
        where = f'{self.owner.__module__}.{self.owner.__qualname__}.{self.name}'
        if not (hasattr(self.owner, self.name) or self.name in _named_in_methods(self.owner)):
            return f'{where} is missing'
        if self.parameters is None:
            return ''
        signature = inspect.signature(getattr(self.owner, self.name))
        return '' if len(signature.parameters) == 1 + self.parameters else f'{where}{signature} has another signature'


@dataclass(frozen=True)
class PrivateUse:
    """Something for which private parts are used. ``loss``: what is slower or missing without; follows a colon."""

    parts: tuple[PrivatePart, ...]
    loss: str


ExtendedLogger: Final[Any] = rcutils_logger.RcutilsLogger
"""The logger of rclpy's nodes, as a base; it has no public name."""


def log_for_callers_of(file: str) -> None:
    """Have rclpy's logger take who calls a function of this file for the place that logs, by which it throttles.

    rclpy keeps the names that others add to this list.
    """
    rcutils_logger._internal_callers.append(os.path.realpath(file))


def _named_in_methods(owner: type) -> set[str]:
    functions = (member for base in owner.__mro__ for member in vars(base).values() if isinstance(member, FunctionType))
    return {name for function in functions for name in function.__code__.co_names}


_STATE_MACHINE: Final = getattr(rclpy_implementation, 'LifecycleStateMachine', ())
_WAIT_SET: Final = getattr(rclpy_implementation, 'WaitSet', object)
_SUBSCRIPTION: Final = getattr(rclpy_implementation, 'Subscription', object)
_WAIT_SET_MEMBERS: Final = (
    'add_client',
    'add_guard_condition',
    'add_service',
    'add_subscription',
    'add_timer',
    'clear_entities',
    'get_ready_entities',
    'wait',
)

EXECUTOR: Final = PrivateUse(
    (
        *(
            PrivatePart(SingleThreadedExecutor, f'_take_{kind}', 1)
            for kind in ('timer', 'subscription', 'client', 'service', 'guard_condition', 'waitable')
        ),
        PrivatePart(SingleThreadedExecutor, '_make_handler', 3),
        PrivatePart(SingleThreadedExecutor, '_guard'),
        PrivatePart(SingleThreadedExecutor, '_sigint_gc'),
        PrivatePart(SingleThreadedExecutor, '_cb_iter'),
        PrivatePart(GuardCondition, '_executor_triggered'),
        PrivatePart(_SUBSCRIPTION, 'take_message'),
        *(PrivatePart(_WAIT_SET, member) for member in _WAIT_SET_MEMBERS),
    ),
    'the stock executor takes about 0.15 ms of processor time longer for each callback, is woken by each message of '
    '/clock, leaves services without an answer to clients that are not discovered yet, and does not tell who has '
    'written a message: floods of commands are not told from those of operators, nor names that others use',
)
ACTION_CLIENT: Final = PrivateUse(
    (
        PrivatePart(ActionClient, '_is_result_response_ready'),
        PrivatePart(ActionClient, '_is_status_ready'),
        PrivatePart(ActionClient, '_goal_handles'),
    ),
    'lists of goals are unpacked twice, and before the results that come with them; identifiers of goals whose end no '
    'list has told are kept for ever',
)
ACTION_SERVER: Final = PrivateUse(
    (
        PrivatePart(ActionServer, '_execute_goal_request', 1),
        PrivatePart(ActionServer, '_execute_cancel_request', 1),
        PrivatePart(ActionServer, '_execute_get_result_request', 1),
        PrivatePart(ActionServer, '_handle'),
        PrivatePart(ActionServer, '_goal_handles'),
        PrivatePart(ActionServer, '_handle_accepted_callback'),
        PrivatePart(ActionServer, '_logger'),
        PrivatePart(ServerGoalHandle, '_goal_handle'),
        PrivatePart(ServerGoalHandle, '_lock'),
    ),
    'results are sent some turns of the executor later, lists of goals are as long as results are kept, and a goal '
    'that comes before its client has been discovered is not begun',
)
PARAMETERS: Final = PrivateUse(
    (PrivatePart(Node, '_parameter_overrides'),),
    'a parameter that was given and that a node does not have is not told; a whole number is refused where a parameter '
    'is a real one, [] where it is a list, and $(find-pkg-share PACKAGE) is not replaced',
)
_USES: Final = (EXECUTOR, ACTION_CLIENT, ACTION_SERVER, PARAMETERS)


@cache
def _faults(use: PrivateUse) -> tuple[str, ...]:
    return tuple(fault for part in use.parts if (fault := part.fault()))


def is_usable(use: PrivateUse) -> bool:
    """Return whether rclpy has all the parts for it, and the environment does not forbid them."""
    return os.environ.get(SWITCH, '0') in ('', '0') and not _faults(use)


def warnings() -> Iterator[str]:
    """Yield a line for each use for which a part is missing: which ones, and what is slower or lost."""
    for use in _USES:
        if _faults(use):
            yield f'this version of rclpy is not fully known: {", ".join(_faults(use))}. Without: {use.loss}'


# --------------------------------------------------------------------------------------------------------- executor

Take = Callable[[Any], Callable[[], Coroutine[Any, Any, None]] | None]
"""Takes what has come for an entity; gives the call of its callback, if there is one to be made."""


Later = Callable[[float, Callable[[], object]], object]
"""Calls something after so many seconds of wall time, on the thread of the executor."""

UNSENT_SECONDS: Final = 0.09
"""To send an answer takes longer than this, s, when it is left unsent: rmw_fastrtps waits 0.1 s for its reader."""

AGAIN_SECONDS: Final = (0.2, 0.5, 1.0, 3.0)
"""After how long an answer that may be unsent is sent again, s of wall time. A client ignores one that it has."""

MOST_UNSENT: Final = 4
"""So many answers of a service are sent again at the same time; each attempt holds the executor up for 0.1 s."""


class ResendingService:
    """A service as the executor sees it, whose answers are sent until there is somebody to get them.

    A request may come before its client has been discovered as a reader of answers, on a busy computer above all. The
    middleware then leaves the answer unsent, rclpy tells it by a warning of Python, and clients such as BasicNavigator
    of nav2_simple_commander wait for ever.
    """

    def __init__(self, service: Service, later: Later) -> None:
        self.handle = service.handle
        self.srv_type = service.srv_type
        self.callback = service.callback
        self._service = service
        self._later = later
        self._unsent = 0

    def send_response(self, response: Any, header: Any) -> None:
        """As that of rclpy, from the thread of the executor."""
        if self._is_sent(response, header) or self._unsent == MOST_UNSENT:
            return
        self._unsent += 1
        pauses = iter(AGAIN_SECONDS)

        def send_later() -> None:
            pause = next(pauses, None)
            if pause is None:
                self._unsent -= 1
            else:
                self._later(pause, send_again)

        def send_again() -> None:
            with suppress(InvalidHandle):  # the service is gone by now
                if not self._is_sent(response, header):
                    send_later()
                    return
            self._unsent -= 1

        send_later()

    def _is_sent(self, response: Any, header: Any) -> bool:
        began = monotonic()
        self._service.send_response(response, header)
        return monotonic() - began < UNSENT_SECONDS


class ExtendedExecutor(SingleThreadedExecutor):
    """rclpy's executor, with what a loop of one's own beside rclpy's needs. EXECUTOR is to be usable."""

    later: Later
    """How answers are sent once more."""

    def takes(self) -> dict[str, Take]:
        """Return how what has come is taken, for each kind of entity as wait sets name it; waitables are 'waitable'."""
        return {
            'timer': self._take_timer,
            'subscription': self._take_subscription,
            'guard_condition': self._take_guard_condition,
            'client': self._take_client,
            'service': self._take_service,
            'waitable': self._take_waitable,
        }

    def own_guards(self) -> tuple[Any, ...]:
        """Return the guard conditions by which the executor itself is woken."""
        return self._guard, self._sigint_gc

    def taking_all(self, subscription: Subscription) -> Callable[[Subscription], object] | None:
        """Return what takes all messages of a subscription that there are, and calls for them what is to be called;
        None where rclpy takes one. A callback may have that as ``take_all`` (received_messages.py).
        """
        taking: Callable[[Subscription], object] | None = getattr(subscription.callback, 'take_all', None)
        return taking

    def _take_subscription(self, subscription: Subscription) -> Callable[[], Coroutine[Any, Any, None]] | None:
        take_all = self.taking_all(subscription)
        if take_all is None:
            taken: Callable[[], Coroutine[Any, Any, None]] | None = super()._take_subscription(subscription)
            return taken

        async def execute() -> None:
            take_all(subscription)

        return execute

    def _take_service(self, service: Service) -> Callable[[], Coroutine[Any, Any, None]] | None:
        taken: Callable[[], Coroutine[Any, Any, None]] | None = super()._take_service(
            ResendingService(service, self.later)
        )
        return taken

    def on_handler(self, task: Task) -> None:
        """rclpy's own loop has made ``task`` to call the callback of an entity; it may await something."""

    def forget_iteration(self) -> None:
        """Have rclpy's own loop, which rests between two turns, let go of the entities that it holds."""
        self._cb_iter = None

    def _make_handler(self, *arguments: Any, **options: Any) -> Task:
        task = super()._make_handler(*arguments, **options)
        self.on_handler(task)
        return task


def trigger_again(guard: Any) -> None:
    """Trigger a guard condition that rclpy's own loop has seen triggered, and not come to call."""
    if guard._executor_triggered:
        guard._executor_triggered = False
        guard.trigger()


def wait_set(count: NumberOfEntities, context: Any) -> Any:
    """Return a wait set with room for so many entities."""
    return rclpy_implementation.WaitSet(
        count.num_subscriptions,
        count.num_guard_conditions,
        count.num_timers,
        count.num_clients,
        count.num_services,
        count.num_events,
        context.handle,
    )


# ---------------------------------------------------------------------------------------------------- action client


class ExtendedActionClient(ActionClient):
    """An action client that passes the server's list of goals on, also of goals whose acceptance it does not know.

    The list waits while there is a result: to unpack it takes longer than all the rest. ACTION_CLIENT is to be usable.

    rclpy forgets a goal when a list tells its end. A list that tells it may be replaced by the next one, which does not
    have the goal any more: what has no handle is forgotten with the next goal.
    """

    on_list: Callable[[Any], None]

    def take_data(self) -> Any:
        if self._is_result_response_ready:
            self._is_status_ready = False
        return super().take_data()

    async def execute(self, taken_data: Any) -> None:
        await super().execute(taken_data)
        if 'goal' in taken_data:
            for goal_id in [goal_id for goal_id, handle in self._goal_handles.items() if handle() is None]:
                del self._goal_handles[goal_id]
        if 'status' in taken_data:
            self.on_list(taken_data['status'])


# ---------------------------------------------------------------------------------------------------- action server


class ExtendedActionServer(ActionServer):
    """rclpy's action server, whose results and cancels are answered by a subclass. ACTION_SERVER is to be usable."""

    def refused_cancel(self, request: Any) -> Any | None:
        """Return the answer to a request to cancel; None for rclpy's."""
        raise NotImplementedError

    def on_result_request(self, request_header: Any, goal_id: bytes) -> None:
        """Somebody asks for a result, now or later to be answered by :meth:`send_result`."""
        raise NotImplementedError

    def knows(self, goal_id: bytes) -> bool:
        """Return whether the goal is in the list of goals."""
        return goal_id in self._goal_handles

    def update(self, handle: ServerGoalHandle, event: GoalEvent) -> int | None:
        """Make a transition of a goal, of which the list of goals is to tell later, and give the new status.

        None when the server is closed: nobody hears of it.
        """
        with handle._lock:
            if handle._goal_handle is None:
                return None
            handle._goal_handle.update_goal_state(event)
            status: int = handle._goal_handle.get_status()
            return status

    def publish_list(self) -> None:
        """Publish the list of goals."""
        self._handle.publish_status()

    def send_result(self, request_header: Any, response: Any) -> None:
        """Answer a request for a result."""
        try:
            self._handle.send_result_response(request_header, response)
        except RCLError:
            self._logger.warning('a result was not sent: its client is gone')

    async def _execute_goal_request(self, request_header_and_message: Any) -> None:
        await super()._execute_goal_request(request_header_and_message)
        handle = self._goal_handles.get(bytes(request_header_and_message[1].goal_id.uuid))
        if handle is not None and handle.status == GoalStatus.STATUS_ACCEPTED:
            # The answer cannot be sent to a client that is not discovered yet, and rclpy leaves the goal like this for
            # ever. The list of goals tells the client.
            self.publish_list()
            self._handle_accepted_callback(handle)

    async def _execute_cancel_request(self, request_header_and_message: Any) -> None:
        request_header, request = request_header_and_message
        response = self.refused_cancel(request)
        if response is None:
            await super()._execute_cancel_request(request_header_and_message)
            return
        try:
            self._handle.send_cancel_response(request_header, response)
        except RCLError:
            self._logger.warning('the answer to a cancel was not sent: its client is gone')

    async def _execute_get_result_request(self, request_header_and_message: Any) -> None:
        request_header, request = request_header_and_message
        self.on_result_request(request_header, bytes(request.goal_id.uuid))


# ------------------------------------------------------------------------------------------------------- parameters


def given_parameters(node: Node) -> Mapping[str, Parameter]:
    """Return the parameters that arguments and files give to a node, declared or not; none without PARAMETERS."""
    return node._parameter_overrides if is_usable(PARAMETERS) else {}


# -------------------------------------------------------------------------------------------------------- lifecycle


def release_lifecycle(node: Node) -> None:
    """Take what the lifecycle of a node has in the graph out of it, after the node is destroyed.

    rclpy's state machine, a compiled object, keeps the services of the lifecycle, and with them the participant and
    its threads, until Python collects the node. It is found by its type, whatever rclpy calls it.
    """
    for name, part in tuple(vars(node).items()):
        if isinstance(part, _STATE_MACHINE):
            delattr(node, name)
