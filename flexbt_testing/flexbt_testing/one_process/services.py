# SPDX-License-Identifier: BSD-3-Clause
"""Services, actions and lifecycle state machines: stand-ins for those of rclpy's compiled module.

The rules of actions and of the lifecycle are those of the ROS 2 design articles "Actions" and "Managed nodes".
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Final

from .clocks import Clock, Timer
from .copying import copied
from .graph import DOMAIN, REAL, Destroyable, Entity, InvalidHandle, Node, RCLError, check_support, type_name
from .scheduler import SCHEDULER, SECOND
from .topics import Publisher, Qos, Subscription


def _default(name: str) -> Any:
    return REAL.rmw_qos_profile_t.predefined(name)


class ServiceEnds:
    """The servers and clients of a service."""

    def __init__(self) -> None:
        self.servers: list[Service] = []
        self.clients: list[Client] = []


class rmw_request_id_t:
    """Stand-in: the number of a request, and its client."""

    __slots__ = ('client', 'sequence_number')

    def __init__(self, sequence_number: int, client: Client) -> None:
        self.sequence_number, self.client = sequence_number, client


class rmw_service_info_t:
    """Stand-in: a request with its times."""

    __slots__ = ('received_timestamp', 'request_id', 'source_timestamp')

    def __init__(self, request_id: rmw_request_id_t, sent: int) -> None:
        self.request_id, self.source_timestamp, self.received_timestamp = request_id, sent, SCHEDULER.wall


class _ServiceEnd(Entity):
    """A server or a client, with the requests or responses that have arrived."""

    def __init__(self, node: Node, service_type: Any, name: str, profile: Any) -> None:
        super().__init__()
        check_support(service_type)
        self.node, self.process, self.type = node, node.process, service_type
        node.context.check(f'failed to create {type(self).__name__.lower()}')
        self.service = node.resolved(name, 'service')
        profile = profile or _default('qos_profile_services_default')
        self.given = profile.to_dict()
        self.gid = node.context.gid()
        self.ends = DOMAIN.services.setdefault((node.domain, self.service), ServiceEnds())
        for other in (*self.ends.servers, *self.ends.clients):
            if other.node.context is node.context and other.type is not service_type:
                raise RCLError(f'{self.service} has the type {type_name(other.type)} in this context')
        usual = (Qos(_default('qos_profile_services_default')),)  # which is what is best, too
        self.offered, self.requested = (Qos.of(profile, is_sent, usual) for is_sent in (True, False))
        self._queue: deque[tuple[Any, rmw_request_id_t, int]] = deque(maxlen=self.requested.depth)
        self._last: dict[Any, int] = {}

    def send(self, target: _ServiceEnd, message: Any, request_id: rmw_request_id_t) -> None:
        """Send a request or a response to the other end."""
        sent = SCHEDULER.wall

        def arrive() -> None:
            if not target.is_ended and target.process.is_alive:
                target._queue.append((message, request_id, sent))
                target.notify()

        DOMAIN.transfer(self.process, target.process, True, self._last, target.pointer, arrive)

    def is_ready(self) -> bool:
        return bool(self._queue)

    def take(self) -> tuple[Any, rmw_service_info_t] | None:
        """Return the oldest message and its header."""
        if not self._queue:
            return None
        message, request_id, sent = self._queue.popleft()
        return copied(message), rmw_service_info_t(request_id, sent)

    def get_logger_name(self) -> str:
        return self.node.logger_name()

    def configure_introspection(self, clock: Any, profile: Any, state: Any) -> None:
        """Do nothing: requests can be observed by ``DOMAIN.on_message``."""


class Service(_ServiceEnd):
    """Stand-in for rcl's service."""

    def __init__(self, node: Node, service_type: Any, name: str, profile: Any = None) -> None:
        super().__init__(node, service_type, name, profile)
        self.qos = self.given
        self.ends.servers.append(self)

    @property
    def name(self) -> str:
        return self.service

    def service_take_request(self, _request_type: Any) -> tuple[Any, Any]:
        return self.take() or (None, None)

    def service_send_response(self, response: Any, request_id: rmw_request_id_t) -> None:
        if self.is_ended:
            raise InvalidHandle('cannot use Destroyable because destruction was requested')
        if not isinstance(response, self.type.Response):
            raise TypeError(f'expected a {self.type.Response}, got a {type(response)}')
        self.send(request_id.client, copied(response), request_id)

    def _destroy(self) -> None:
        if self in self.ends.servers:
            self.ends.servers.remove(self)


class Client(_ServiceEnd):
    """Stand-in for rcl's client."""

    def __init__(self, node: Node, service_type: Any, name: str, profile: Any = None) -> None:
        super().__init__(node, service_type, name, profile)
        self._sent = 0
        self.ends.clients.append(self)

    @property
    def service_name(self) -> str:
        return self.service

    def send_request(self, request: Any) -> int:
        self._sent += 1
        message = copied(request)
        if DOMAIN.on_message is not None:
            DOMAIN.on_message(self.process, self.service, message)
        for server in self._servers():
            self.send(server, message, rmw_request_id_t(self._sent, self))
        return self._sent

    def service_server_is_available(self) -> bool:
        self.node.context.check('failed to check service availability')
        return bool(self._servers())

    def take_response(self, _response_type: Any) -> tuple[Any, Any]:
        message, header = self.take() or (None, None)
        return header, message

    def _servers(self) -> list[Service]:
        return [server for server in self.ends.servers if server.type is self.type and _fit(self, server)]

    def _destroy(self) -> None:
        if self in self.ends.clients:
            self.ends.clients.remove(self)


def _fit(one: _ServiceEnd, other: _ServiceEnd) -> bool:
    """Return whether each can receive what the other sends."""
    return one.offered.misfit(other.requested) is None is other.offered.misfit(one.requested)


class TypeDescriptionService(Destroyable):
    """Stand-in: a service that tells that it has no descriptions."""

    def __init__(self, node: Node) -> None:
        from type_description_interfaces.srv import GetTypeDescription

        super().__init__()
        self.impl = Service(node, GetTypeDescription, '~/get_type_description')

    def handle_request(self, _request: Any, response_type: Any, _node: Node) -> Any:
        response = response_type()
        response.successful, response.failure_reason = False, 'a world in one process has no type descriptions'
        return response

    def _destroy(self) -> None:
        if not self.impl.is_ended:
            self.impl.destroy_when_not_in_use()


# ------------------------------------------------------------------------------------------------------------ actions

_ACCEPTED, _EXECUTING, _CANCELING, _SUCCEEDED, _CANCELED, _ABORTED = range(1, 7)
_STATUSES: Final = ('UNKNOWN', 'ACCEPTED', 'EXECUTING', 'CANCELING', 'SUCCEEDED', 'CANCELED', 'ABORTED')
_ACTIVE: Final = (_ACCEPTED, _EXECUTING, _CANCELING)
_FOLLOWING: Final = {
    (_ACCEPTED, 'EXECUTE'): _EXECUTING,
    (_ACCEPTED, 'CANCEL_GOAL'): _CANCELING,
    (_EXECUTING, 'CANCEL_GOAL'): _CANCELING,
    (_EXECUTING, 'SUCCEED'): _SUCCEEDED,
    (_EXECUTING, 'ABORT'): _ABORTED,
    (_CANCELING, 'SUCCEED'): _SUCCEEDED,
    (_CANCELING, 'ABORT'): _ABORTED,
    (_CANCELING, 'CANCELED'): _CANCELED,
}
_REJECTED, _UNKNOWN_GOAL, _TERMINATED = 1, 2, 3
"""Return codes of a cancel request (action_msgs/srv/CancelGoal)."""


class ActionGoalHandle(Destroyable):
    """Stand-in for rcl's goal of an action server."""

    def __init__(self, server: ActionServer, info: Any) -> None:
        super().__init__()
        self.info = copied(info)
        self.status = _ACCEPTED
        self.ended: int | None = None
        self._server = server
        key = bytes(info.goal_id.uuid)
        if key in server.goals:
            raise RCLError('goal id already exists')
        server.goals[key] = self

    def get_status(self) -> int:
        return self.status

    def is_active(self) -> bool:
        return self.status in _ACTIVE

    def is_cancelable(self) -> bool:
        """Return whether it can be asked to cancel: not twice."""
        return (self.status, 'CANCEL_GOAL') in _FOLLOWING

    def update_goal_state(self, event: Any) -> None:
        following = _FOLLOWING.get((self.status, event.name))
        if following is None:
            tried = f'from state {_STATUSES[self.status]} with event {event.name}'
            raise RCLError(f'Failed to update goal state: goal_handle attempted invalid transition {tried}')
        self.status = following
        if following not in _ACTIVE:
            self.ended = self._server.clock.nanoseconds()


class ActionServer(Destroyable):
    """Stand-in for rcl's action server."""

    def __init__(
        self,
        node: Node,
        clock: Clock,
        action_type: Any,
        name: str,
        goal_qos: Any,
        result_qos: Any,
        cancel_qos: Any,
        feedback_qos: Any,
        status_qos: Any,
        result_timeout: float,
    ) -> None:
        super().__init__()
        check_support(action_type)
        if not -1.0 < result_timeout * SECOND < 2.0**63:
            raise ValueError('Failed to create action server: timer period must be non-negative')
        kinds = action_type.Impl
        self.clock = clock
        self.goal = Service(node, kinds.SendGoalService, f'{name}/_action/send_goal', goal_qos)
        self.cancel = Service(node, kinds.CancelGoalService, f'{name}/_action/cancel_goal', cancel_qos)
        self.result = Service(node, kinds.GetResultService, f'{name}/_action/get_result', result_qos)
        self._feedback = Publisher(node, kinds.FeedbackMessage, f'{name}/_action/feedback', feedback_qos)
        self._status = Publisher(node, kinds.GoalStatusMessage, f'{name}/_action/status', status_qos)
        self._timeout = int(result_timeout * SECOND)
        self.expiry = Timer(clock, None, self._timeout, False)
        self.goals: dict[bytes, ActionGoalHandle] = {}
        self._places: tuple[Any, ...] = ()

    @property
    def entities(self) -> tuple[Entity, ...]:
        """What an executor waits for, in the order of :meth:`is_ready`."""
        return self.goal, self.cancel, self.result, self.expiry

    def _destroy(self) -> None:
        for one in (*self.entities, self._feedback, self._status):
            if not one.is_ended:
                one.destroy_when_not_in_use()

    def configure_introspection(self, *_: Any) -> None:
        """Do nothing, as for services."""

    def get_num_entities(self) -> tuple[int, int, int, int, int]:
        return 0, 0, 1, 0, 3

    def add_to_waitset(self, wait_set: Any) -> None:
        wait_set.add_all(self.entities)

    def is_ready(self, wait_set: Any) -> tuple[bool, ...]:
        return tuple(wait_set.has(entity) for entity in self.entities)

    def take_goal_request(self, _type: Any) -> tuple[Any, Any]:
        return _header_first(self.goal)

    def take_cancel_request(self, _type: Any) -> tuple[Any, Any]:
        return _header_first(self.cancel)

    def take_result_request(self, _type: Any) -> tuple[Any, Any]:
        return _header_first(self.result)

    def send_goal_response(self, header: Any, response: Any) -> None:
        self.goal.service_send_response(response, getattr(header, 'request_id', header))

    def send_cancel_response(self, header: Any, response: Any) -> None:
        self.cancel.service_send_response(response, getattr(header, 'request_id', header))

    def send_result_response(self, header: Any, response: Any) -> None:
        self.result.service_send_response(response, getattr(header, 'request_id', header))

    def publish_feedback(self, message: Any) -> None:
        self._feedback.publish(message)

    def publish_status(self) -> None:
        from action_msgs.msg import GoalStatus, GoalStatusArray

        goals = [GoalStatus(goal_info=goal.info, status=goal.status) for goal in self.goals.values()]
        self._status.publish(GoalStatusArray(status_list=goals))

    def goal_exists(self, info: Any) -> bool:
        return bytes(info.goal_id.uuid) in self.goals

    def notify_goal_done(self) -> None:
        """Let the timer expire when the next result may be forgotten."""
        ended = [goal.ended for goal in self.goals.values() if goal.ended is not None]
        if ended:
            self.expiry.change_timer_period(max(0, min(ended) + self._timeout - self.clock.nanoseconds()))
            self.expiry.reset_timer()
        else:
            self.expiry.cancel_timer()

    def expire_goals(self, most: int) -> tuple[Any, ...]:
        now = self.clock.nanoseconds()
        old = [key for key, goal in self.goals.items() if goal.ended is not None and self._timeout <= now - goal.ended][
            :most
        ]
        expired = tuple(self.goals.pop(key).info for key in old)
        self.notify_goal_done()
        return expired

    def process_cancel_request(self, request: Any, response_type: Any) -> Any:
        """Return the goals that the request means; the caller decides which of them are canceled."""
        response = response_type()
        key = bytes(request.goal_info.goal_id.uuid)
        until = _time(request.goal_info.stamp)
        if any(key) and not until:
            goal = self.goals.get(key)
            if goal is None:
                response.return_code = _UNKNOWN_GOAL
            elif goal.is_cancelable():
                response.goals_canceling = [goal.info]
            else:
                response.return_code = _TERMINATED
            return response
        everything = not any(key) and not until
        response.goals_canceling = [
            goal.info
            for one, goal in self.goals.items()
            if goal.is_cancelable() and (everything or one == key or _time(goal.info.stamp) <= until)
        ]
        return response


def _time(stamp: Any) -> int:
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def _header_first(service: Service) -> tuple[Any, Any]:
    request, header = service.service_take_request(None)
    return header, request


class ActionClient(Destroyable):
    """Stand-in for rcl's action client."""

    def __init__(
        self,
        node: Node,
        action_type: Any,
        name: str,
        goal_qos: Any,
        result_qos: Any,
        cancel_qos: Any,
        feedback_qos: Any,
        status_qos: Any,
    ) -> None:
        super().__init__()
        check_support(action_type)
        kinds = action_type.Impl
        self.goal = Client(node, kinds.SendGoalService, f'{name}/_action/send_goal', goal_qos)
        self.cancel = Client(node, kinds.CancelGoalService, f'{name}/_action/cancel_goal', cancel_qos)
        self.result = Client(node, kinds.GetResultService, f'{name}/_action/get_result', result_qos)
        self.feedback = Subscription(node, kinds.FeedbackMessage, f'{name}/_action/feedback', feedback_qos)
        self.status = Subscription(node, kinds.GoalStatusMessage, f'{name}/_action/status', status_qos)

    @property
    def entities(self) -> tuple[Entity, ...]:
        """What an executor waits for, in the order of :meth:`is_ready`."""
        return self.feedback, self.status, self.goal, self.cancel, self.result

    def _destroy(self) -> None:
        for one in self.entities:
            if not one.is_ended:
                one.destroy_when_not_in_use()

    def configure_introspection(self, *_: Any) -> None:
        """Do nothing, as for services."""

    def get_num_entities(self) -> tuple[int, int, int, int, int]:
        return 2, 0, 0, 3, 0

    def add_to_waitset(self, wait_set: Any) -> None:
        wait_set.add_all(self.entities)

    def is_ready(self, wait_set: Any) -> tuple[bool, ...]:
        return tuple(wait_set.has(entity) for entity in self.entities)

    def send_goal_request(self, request: Any) -> int:
        return self.goal.send_request(request)

    def send_cancel_request(self, request: Any) -> int:
        return self.cancel.send_request(request)

    def send_result_request(self, request: Any) -> int:
        return self.result.send_request(request)

    def take_goal_response(self, _type: Any) -> tuple[Any, Any]:
        return _number_first(self.goal)

    def take_cancel_response(self, _type: Any) -> tuple[Any, Any]:
        return _number_first(self.cancel)

    def take_result_response(self, _type: Any) -> tuple[Any, Any]:
        return _number_first(self.result)

    def take_feedback(self, message_type: Any) -> Any:
        taken = self.feedback.take_message(message_type, False)
        return taken and taken[0]

    def take_status(self, message_type: Any) -> Any:
        taken = self.status.take_message(message_type, False)
        return taken and taken[0]

    def is_action_server_available(self) -> bool:
        self.goal.node.context.check('Failed to check if action server is available')
        clients = (self.goal, self.cancel, self.result)
        return all(client.service_server_is_available() for client in clients) and bool(
            self.feedback.matches and self.status.matches
        )


def _number_first(client: Client) -> tuple[Any, Any]:
    header, response = client.take_response(None)
    return (None, None) if header is None else (header.request_id.sequence_number, response)


# ---------------------------------------------------------------------------------------------------------- lifecycle

_STATES: Final = {
    0: 'unknown',
    1: 'unconfigured',
    2: 'inactive',
    3: 'active',
    4: 'finalized',
    10: 'configuring',
    11: 'cleaningup',
    12: 'shuttingdown',
    13: 'activating',
    14: 'deactivating',
    15: 'errorprocessing',
}
_ENDS: Final = ('transition_success', 'transition_failure', 'transition_error')
_TRANSITIONS: Final = tuple(
    one
    for begins, first, state, goals in (
        ([(1, 'configure', 1, 10)], 10, 10, (2, 1, 15)),
        ([(2, 'cleanup', 2, 11)], 20, 11, (1, 2, 15)),
        ([(3, 'activate', 2, 13)], 30, 13, (3, 2, 15)),
        ([(4, 'deactivate', 3, 14)], 40, 14, (2, 3, 15)),
        ([(5, 'shutdown', 1, 12), (6, 'shutdown', 2, 12), (7, 'shutdown', 3, 12)], 50, 12, (4, 4, 15)),
        ([], 60, 15, (1, 4, 4)),
    )
    for one in (
        *begins,
        *((first + n, end, state, goal) for n, (end, goal) in enumerate(zip(_ENDS, goals, strict=True))),
    )
)
"""Transitions of a managed node: number, label, start and goal (lifecycle_msgs/msg/Transition)."""


class LifecycleStateMachine(Destroyable):
    """Stand-in for rcl's state machine of a managed node, with its services."""

    initialized = True
    service_change_state: Service
    service_get_state: Service
    service_get_available_states: Service
    service_get_available_transitions: Service
    service_get_transition_graph: Service

    def __init__(self, node: Node, has_interface: bool) -> None:
        from lifecycle_msgs.msg import TransitionEvent
        from lifecycle_msgs.srv import ChangeState, GetAvailableStates, GetAvailableTransitions, GetState

        super().__init__()
        self._state = 1
        self._events: Publisher | None = None
        self._ends: list[Entity] = []
        if not has_interface:
            return
        for name, kind in {
            'change_state': ChangeState,
            'get_state': GetState,
            'get_available_states': GetAvailableStates,
            'get_available_transitions': GetAvailableTransitions,
            'get_transition_graph': GetAvailableTransitions,
        }.items():
            self._ends.append(Service(node, kind, f'~/{name}'))
            setattr(self, f'service_{name}', self._ends[-1])
        self._events = Publisher(node, TransitionEvent, '~/transition_event', _default('qos_profile_default'))
        self._ends.append(self._events)

    def __del__(self) -> None:
        for one in getattr(self, '_ends', ()):
            if not one.is_ended:
                one.destroy_when_not_in_use()

    @property
    def current_state(self) -> tuple[int, str]:
        return self._state, _STATES[self._state]

    @property
    def available_states(self) -> list[tuple[int, str]]:
        return sorted(_STATES.items())

    @property
    def available_transitions(self) -> list[tuple[int, str, int, str, int, str]]:
        return [one for one in self.transition_graph if one[2] == self._state]

    @property
    def transition_graph(self) -> list[tuple[int, str, int, str, int, str]]:
        return [(n, label, start, _STATES[start], goal, _STATES[goal]) for n, label, start, goal in _TRANSITIONS]

    def get_transition_by_label(self, label: str) -> int:
        for number, one, *_ in self.available_transitions:
            if one == label:
                return number
        raise RCLError('Failed to get transition from label: error not set')

    def trigger_transition_by_id(self, number: int, is_published: bool) -> None:
        self._go(lambda one: one[0] == number, is_published)

    def trigger_transition_by_label(self, label: str, is_published: bool) -> None:
        self._go(lambda one: one[1] == label, is_published)

    def _go(self, is_meant: Callable[[Any], bool], is_published: bool) -> None:
        found = next((one for one in self.available_transitions if is_meant(one)), None)
        if found is None:
            raise RCLError('Failed to trigger lifecycle state machine transition: Transition is not registered.')
        *_, start, start_label, self._state, goal_label = found
        if self._events is not None and is_published:
            from lifecycle_msgs.msg import State, TransitionEvent

            self._events.publish(  # as rcl, which fills in no time and no transition
                TransitionEvent(
                    start_state=State(id=start, label=start_label), goal_state=State(id=self._state, label=goal_label)
                )
            )
