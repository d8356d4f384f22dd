# SPDX-License-Identifier: BSD-3-Clause
"""States that use any action, service or topic, configured without code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from flexbt_common.calls.action_call import GoalOutcome, GoalStatus
from flexbt_common.calls.service_call import ServiceCall
from flexbt_common.errors import UnknownTypeError
from flexbt_common.values.fields import Field, constants_of
from flexbt_common.values.templates import Expression, MessageTemplate, Source, embedded, is_expression
from flexbt_common.values.value_types import FieldError, interface_class, slot_value
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, ScriptError
from flexbt_core.behavior_tree.model.ports import pointer_key
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_core.values.text import short_repr
from flexbt_onboard.behaviors.run_context import state_services

from .errors import StateParameterError
from .goal_call import GoalState
from .parameter_checks import checked_mapping, checked_message_type, checked_text, checked_timeout, checked_topic
from .topic_states import MessagePublisher, WaitForMessage

ALWAYS: Final = ''
"""Condition of an outcome that applies if no earlier condition is true."""


class _Exchange:
    """The messages of a state: fields to set in the sent one, fields to keep of the received one, and the conditions
    of its outcomes. ``keys`` are the userdata keys that it reads, ``outputs`` those that it writes."""

    def __init__(
        self,
        state: EventState,
        *,
        sent: tuple[str, type[Any], Mapping[str, Any] | None] | None = None,
        received: tuple[str, type[Any], Mapping[str, str] | None] | None = None,
        outcomes: Mapping[str, str] | None = None,
    ) -> None:
        """``sent`` and ``received`` hold a parameter name of the state, the message class, and the value."""
        self._scripts = ScriptLibrary()
        self._template: MessageTemplate | None = None
        self._root = ''
        self._kept: list[tuple[Field, str]] = []
        self.conditions: dict[str, Expression | None] = {}
        keys: list[str] = []
        if sent is not None:
            parameter, message, values = sent
            self._template = _template(state, parameter, message, checked_mapping(state, parameter, values))
            for _, source in self._template.fields.values():
                keys += [source.name] if source.name else sorted(_names_of(source.value))
        if received is not None:
            self._root, message, fields = received
            self._kept = _kept(state, self._root, message, checked_mapping(state, self._root, fields))
            for outcome, text in checked_mapping(state, 'outcomes', outcomes).items():
                condition = _condition(state, outcome, text, {self._root: message})
                self.conditions[outcome] = condition
                keys += sorted(_names_of(condition) - {self._root})
        self.keys = list(dict.fromkeys(keys))
        self.outputs = [key for _, key in self._kept]

    def message(self, userdata: UserData) -> Any:
        """Return the message that the state sends.

        Raises:
            FlexbtError: a value does not fit its field; the error names the field.
        """
        assert self._template is not None  # of a state that sends
        values = {key: userdata[key] for key in self.keys}

        def evaluate(field: Field, expression: Expression) -> Any:
            value = expression.value(self._scripts, Blackboard(), values)
            whole = isinstance(value, float) and value.is_integer() and 'int' in field.type_name
            return int(value) if whole else value

        try:
            return self._template.make(values.__getitem__, evaluate)
        except (BehaviorTreeError, ValueError) as error:
            raise FlexbtError(str(error)) from error

    def take(self, message: Any, userdata: UserData, *, keeps_any: bool = True) -> str:
        """Return the outcome for a message, '' if no condition is true, and write its kept fields to the userdata.

        The conditions read the userdata as they were before. Without ``keeps_any``, a message for which no condition
        is true writes nothing.

        Raises:
            FlexbtError: the message lacks an element, or a condition cannot be evaluated; nothing is written.
        """
        try:
            outcome = self._outcome(message, userdata)
            values = {key: field.get(message) for field, key in self._kept} if outcome or keeps_any else {}
        except (BehaviorTreeError, ValueError) as error:
            raise FlexbtError(str(error)) from error
        for key, value in values.items():
            userdata[key] = value
        return outcome

    def _outcome(self, message: Any, userdata: UserData) -> str:
        for outcome, condition in self.conditions.items():
            if condition is None:
                return outcome
            values = {key: userdata[key] for key in self.keys if key in condition.names}
            if condition.holds(self._scripts, Blackboard(), {self._root: message}, values):
                return outcome
        return ''

    def described(self, message: Any, values: Mapping[str, Any]) -> str:
        """Return what the conditions have read as text; ``values`` are those of the userdata."""
        lines = (one.described(Blackboard(), {self._root: message}, values) for one in self.conditions.values() if one)
        return f'no condition of {self._root} is true: {"; ".join(lines)}'


def _template(state: EventState, parameter: str, message: type[Any], values: Mapping[str, Any]) -> MessageTemplate:
    fields: dict[str, tuple[Field, Source]] = {}
    for path, value in values.items():
        place = f'{parameter}[{path!r}]'
        try:
            field = Field(message, checked_text(state, parameter, path))
            if field.is_length:
                raise FieldError(path, 'the length of a list cannot be set; write its elements')
            fields[path] = field, _source(field, value)
        except (FieldError, ScriptError) as error:
            reason = error.reason if isinstance(error, ScriptError) else str(error)
            raise StateParameterError(state, place, reason) from None
    return MessageTemplate(message, fields)


def _source(field: Field, value: Any) -> Source:
    key = pointer_key(value, '') if isinstance(value, str) else None
    if key:
        return Source(key)
    if is_expression(value):
        return Source('', embedded(value))
    if isinstance(value, str) and field.type_name != 'string':
        value = constants_of(field.owner).get(value, value)
    return Source('', value if field.slot is None else slot_value(value, field.slot, field.path))


def _names_of(value: Any) -> frozenset[str]:
    return value.names if isinstance(value, Expression) else frozenset()


def _kept(state: EventState, parameter: str, message: type[Any], fields: Mapping[str, str]) -> list[tuple[Field, str]]:
    kept = []
    for path, key in fields.items():
        if not isinstance(key, str) or not key:
            raise StateParameterError(state, f'{parameter}[{path!r}]', f'{short_repr(key)} is not a userdata key')
        try:
            kept.append((Field(message, checked_text(state, parameter, path)), key))
        except FieldError as error:
            raise StateParameterError(state, f'{parameter}[{path!r}]', str(error)) from None
    return kept


def _condition(state: EventState, outcome: str, text: str, roots: Mapping[str, type[Any]]) -> Expression | None:
    parameter = f'outcomes[{outcome!r}]'
    if checked_text(state, parameter, text) == ALWAYS:
        return None
    try:
        return Expression(text, roots)
    except (FieldError, ScriptError) as error:
        reason = error.reason if isinstance(error, ScriptError) else str(error)
        raise StateParameterError(state, parameter, reason) from None


def _interface(state: EventState, parameter: str, name: str | type[Any], kind: str) -> type[Any]:
    if isinstance(name, type):
        return name
    try:
        return interface_class(checked_text(state, parameter, name), kind)
    except UnknownTypeError as error:
        raise StateParameterError(state, parameter, str(error)) from None


def _outcomes(exchange: _Exchange, *others: str) -> list[str]:
    return list(dict.fromkeys([*exchange.conditions, *others]))


class CallActionState(GoalState):
    """
    Send a goal to any action server, and wait until it ends.

    -- action_type  string      Type of the action, e.g. nav2_msgs/action/Spin, or the class
    -- topic        string      Name of the action
    -- goal         dict        Fields of the goal by path: a value, {key} of the userdata, or ${expression}
    -- result       dict        Fields of the result to keep: their paths, with the userdata keys to write
    -- outcomes     dict        Conditions on the result by outcome, e.g. result.error_code == 0; first true wins
    -- timeout      float       Seconds on the node's clock after which the goal is canceled; None for no limit

    ># KEY                      Each key in goal and outcomes.
    #> KEY                      Each key in result.

    <= OUTCOME                  The goal succeeded, and the condition of this outcome is true; without outcomes, done.
    <= canceled                 The goal was canceled by another client.
    <= failed                   The goal failed, no condition is true, or it took too long; the reason is logged.
    """

    def __init__(
        self,
        action_type: str | type[Any],
        topic: str,
        goal: Mapping[str, Any] | None = None,
        result: Mapping[str, str] | None = None,
        outcomes: Mapping[str, str] | None = None,
        timeout: float | None = None,
    ) -> None:
        action = _interface(self, 'action_type', action_type, 'action')
        self._exchange = exchange = _Exchange(
            self,
            sent=('goal', action.Goal, goal),
            received=('result', action.Result, result),
            outcomes=outcomes or {'done': ALWAYS},
        )
        super().__init__(
            action,
            topic,
            timeout,
            outcomes=_outcomes(exchange, 'canceled', 'failed'),
            input_keys=exchange.keys,
            output_keys=exchange.outputs,
        )

    def _make_goal(self, userdata: UserData) -> Any:
        return self._exchange.message(userdata)

    def _send(self, goal: Any) -> None:
        self._goal.send(goal, timeout=self._timeout, clock=self.clock)

    def _what(self) -> str:
        return f'goal of {self._topic}'

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        if ended.status is GoalStatus.CANCELED:
            self.log_warn(f'{self._what()}: canceled by another client')
            return 'canceled'
        if ended.status is not GoalStatus.SUCCEEDED:
            reason = getattr(ended.result, 'error_msg', '') or getattr(ended.result, 'message', '')
            self.log_error(f'{self._what()}: {reason or ended.reason}')
            return 'failed'
        return _taken(self, self._what(), self._exchange, ended.result, userdata)


def _taken(state: EventState, what: str, exchange: _Exchange, message: Any, userdata: UserData) -> str:
    """Return the outcome for a message. If no condition is true or one raises, log the reason and return failed."""
    values = {key: userdata[key] for key in exchange.keys if key in userdata}  # before the message changes them
    try:
        outcome = exchange.take(message, userdata)
    except FlexbtError as error:
        state.log_error(f'{what}: {error}')
        return 'failed'
    if not outcome:
        state.log_warn(f'{what}: {exchange.described(message, values)}')
    return outcome or 'failed'


class CallServiceState(EventState):
    """
    Call any service, and wait for its response.

    -- service_type string      Type of the service, e.g. std_srvs/srv/SetBool, or the class
    -- topic        string      Name of the service
    -- request      dict        Fields of the request by path: a value, {key} of the userdata, or ${expression}
    -- response     dict        Fields of the response to keep: their paths, with the userdata keys to write
    -- outcomes     dict        Conditions on the response by outcome, e.g. response.success; first true wins
    -- timeout      float       Seconds (wall time) for the service to appear, and again for its response

    ># KEY                      Each key in request and outcomes.
    #> KEY                      Each key in response.

    <= OUTCOME                  A response arrived, and the condition of this outcome is true; without outcomes, done.
    <= failed                   No response arrived, or no condition is true; the reason is logged.
    """

    def __init__(
        self,
        service_type: str | type[Any],
        topic: str,
        request: Mapping[str, Any] | None = None,
        response: Mapping[str, str] | None = None,
        outcomes: Mapping[str, str] | None = None,
        timeout: float = 5.0,
    ) -> None:
        self._service = service = _interface(self, 'service_type', service_type, 'srv')
        self._exchange = exchange = _Exchange(
            self,
            sent=('request', service.Request, request),
            received=('response', service.Response, response),
            outcomes=outcomes or {'done': ALWAYS},
        )
        super().__init__(
            outcomes=_outcomes(exchange, 'failed'),
            input_keys=exchange.keys,
            output_keys=exchange.outputs,
            desired_rate=None,
        )
        self._topic = checked_topic(self, 'topic', topic)
        self._timeout = checked_timeout(self, 'timeout', timeout) or 5.0
        self._call: ServiceCall | None = None
        self._refusal = ''

    def on_start(self) -> None:
        state_services(self).services.link(self._service, self._topic)

    def on_enter(self, userdata: UserData) -> None:
        self._call, self._refusal = None, ''
        try:
            request = self._exchange.message(userdata)
        except FlexbtError as error:
            self._refusal = str(error)
            return
        self._call = ServiceCall(
            state_services(self).services.link(self._service, self._topic),
            request,
            on_done=lambda _: self.wake(),
            server_timeout=self._timeout,
            response_timeout=self._timeout,
        )

    def execute(self, userdata: UserData) -> str | None:
        outcome = None if self._call is None else self._call.outcome
        if self._call is not None and outcome is None:
            return None
        if outcome is None or outcome.response is None:
            self.log_error(f'service {self._topic}: {self._refusal if outcome is None else outcome.reason}')
            return 'failed'
        return _taken(self, f'service {self._topic}', self._exchange, outcome.response, userdata)

    def not_paused(self) -> Sequence[str]:
        return ['its request was sent'] if self._call is not None and not self._call.done else []

    def on_exit(self, userdata: UserData) -> None:
        if self._call is not None:
            self._call.cancel()


class PublishState(MessagePublisher):
    """
    Publish a message with the given fields. The publisher is created at the start of the run.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. geometry_msgs/msg/PoseStamped, or the class
    -- message      dict        Fields of the message by path: a value, {key} of the userdata, or ${expression}
    -- latched      bool        Whether later subscribers get the message too, until the run ends

    ># KEY                      Each key in message.

    <= done                     The message was passed to the middleware.
    <= failed                   A value does not fit its field; the reason is logged.
    """

    def __init__(
        self, topic: str, msg_type: str | type[Any], message: Mapping[str, Any] | None = None, latched: bool = False
    ) -> None:
        type = checked_message_type(self, 'msg_type', msg_type)
        self._exchange = _Exchange(self, sent=('message', type, message))
        super().__init__(topic, type, latched, outcomes=['done', 'failed'], input_keys=self._exchange.keys)

    def execute(self, userdata: UserData) -> str:
        try:
            self._publish(self._exchange.message(userdata))
        except FlexbtError as error:
            self.log_error(f'topic {self._topic}: {error}')
            return 'failed'
        return 'done'


class ReadTopicState(WaitForMessage):
    """
    Wait for a message for which a condition is true, and keep some of its fields. Each message counts, the last 10 of
    those that arrive at once or in a pause.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. sensor_msgs/msg/BatteryState, or the class
    -- message      dict        Fields of the message to keep: their paths, with the userdata keys to write
    -- outcomes     dict        Conditions on the message by outcome, e.g. message.percentage < 0.2; first true wins
    -- timeout      float       Seconds (wall time) to wait; None for no limit
    -- latched      bool        Whether to accept an earlier message that its publisher keeps (transient local)
    -- best_effort  bool        Whether to subscribe with best effort, as best-effort publishers (sensors) require

    ># KEY                      Each key in outcomes.
    #> KEY                      Each key in message.

    <= OUTCOME                  The condition of this outcome is true for a message; without outcomes, received.
    <= timeout                  No such message arrived in time.
    """

    depth = 10

    def __init__(
        self,
        topic: str,
        msg_type: str | type[Any],
        message: Mapping[str, str] | None = None,
        outcomes: Mapping[str, str] | None = None,
        timeout: float | None = None,
        latched: bool = False,
        best_effort: bool = False,
    ) -> None:
        message_type = checked_message_type(self, 'msg_type', msg_type)
        outcomes = outcomes or {'received': ALWAYS}
        self._exchange = exchange = _Exchange(self, received=('message', message_type, message), outcomes=outcomes)
        super().__init__(
            topic,
            message_type,
            timeout,
            latched,
            best_effort,
            outcomes=list(outcomes),
            input_keys=exchange.keys,
            output_keys=exchange.outputs,
        )
        self._told = ''

    def on_enter(self, userdata: UserData) -> None:
        super().on_enter(userdata)
        self._told = ''

    def _received(self, message: Any, userdata: UserData) -> str | None:
        try:
            return self._exchange.take(message, userdata, keeps_any=False) or None
        except FlexbtError as error:
            if str(error) != self._told:  # the next messages may be like this one
                self._told = str(error)
                self.log_warn(f'topic {self._topic}: {error}')
            return None


class CheckTopicState(ReadTopicState):
    """
    Check conditions on the newest message of a topic until one is true. It subscribes at the start of the run.

    -- topic        string      Name of the topic
    -- msg_type     string      Type of its messages, e.g. sensor_msgs/msg/BatteryState, or the class
    -- outcomes     dict        Conditions on the message by outcome, e.g. message.percentage < 0.2; '' is always true
    -- timeout      float       Seconds (wall time) to wait; None for no limit
    -- latched      bool        Whether to accept an earlier message that its publisher keeps (transient local)
    -- best_effort  bool        Whether to subscribe with best effort, as best-effort publishers (sensors) require

    ># KEY                      Each key in outcomes.

    <= OUTCOME                  The condition of this outcome is true for the newest message.
    <= timeout                  No condition was true in time.
    """

    depth = 1

    def __init__(
        self,
        topic: str,
        msg_type: str | type[Any],
        outcomes: Mapping[str, str],
        timeout: float | None = None,
        latched: bool = False,
        best_effort: bool = False,
    ) -> None:
        super().__init__(topic, msg_type, None, outcomes, timeout, latched, best_effort)
        self._newest: Any = None

    def on_start(self) -> None:
        self._subscription.open()

    def on_enter(self, userdata: UserData) -> None:
        super().on_enter(userdata)
        self._has_heard = self._newest is not None

    def execute(self, userdata: UserData) -> str | None:
        outcome = super().execute(userdata)
        if outcome == 'timeout' or outcome is None:
            return self._received(self._newest, userdata) or outcome if self._newest is not None else outcome
        return outcome

    def _received(self, message: Any, userdata: UserData) -> str | None:
        self._newest = message
        return super()._received(message, userdata)

    def on_exit(self, userdata: UserData) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def on_stop(self) -> None:
        self._subscription.close()
        self._newest = None
