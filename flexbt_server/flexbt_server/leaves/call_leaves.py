# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that use any action, service, topic or parameter from XML, without a separate class."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar, Final

from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.exceptions import InvalidTopicNameException
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from flexbt_common.errors import TopicTypeError, ValueConversionError
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.runtime.weak_lru_cache import WeakLruCache
from flexbt_common.values.entries import check_value
from flexbt_common.values.templates import Expression
from flexbt_common.values.value_types import exact
from flexbt_core.behavior_tree.engine.leaf import StatefulAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, ElementError, PortError
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import BOOL, STRING, UNSIGNED, Port, input_port, pointer_key, separated
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.clock import Timer
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.yaml_data import YamlError, load_yaml

from .action_leaf import ACTION_PORTS, BASE, ActionLeaf
from .leaf_services import ServerNode
from .message_ports import MessageLeaf, Part, expression_type
from .service_leaf import SERVICE_PORTS, ServiceCondition, ServiceLeaf
from .topic_cache import SubscribedTopic, TopicCache
from .topic_leaf import TopicCondition

QOS: Final = {
    'default': QoSProfile(depth=10),
    'latched': QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    'sensor': QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT),
}
"""Qualities of service by their names in the port ``qos``."""
ON_PAUSE: Final = {'cancel': True, 'continue': False}
"""Values of the port ``on_pause``: whether the goal is canceled while the tree is paused."""
MOST_PUBLISHERS: Final = 100
"""Maximum number of unused publishers that a server keeps."""
_LOOK_SECONDS: Final = 0.02
"""Period of the check whether a new publisher has a subscriber, s of wall time."""


def _type_port(what: str) -> Port:
    return input_port(STRING, description=f'type of the {what}, such as {_EXAMPLES[what]}')


_EXAMPLES: Final = {
    'action': 'nav2_msgs/action/Spin', 'service': 'std_srvs/srv/SetBool', 'messages': 'std_msgs/msg/String',
}  # fmt: skip
_QOS_PORT: Final = input_port(STRING, default='default', description=f'quality of service: {", ".join(QOS)}')
_TOPIC_PORT: Final = input_port(STRING, description='topic')


def _choice(attributes: Mapping[str, str], name: str, choices: Mapping[str, Any], default: str) -> Any:
    """Return the meaning of an attribute that must be a literal in the XML. Raises ElementError."""
    text = attributes.get(name, default)
    if text not in choices:
        raise ElementError(
            [(name, f'{short_repr(text)} is none of {", ".join(choices)}{did_you_mean(text, choices, "")}')]
        )
    return choices[text]


class CallAction(MessageLeaf, ActionLeaf):
    """Sends a goal to any action server.

    ``goal.FIELD`` sets a field of the goal, to any depth: ``goal.pose.header.frame_id``, ``goal.poses.0.pose``. Its
    value is a text, ``{key}``, or ``${expression}``: ``${station.pose.position.x + 1}`` reads a field of the message
    in the entry ``station``. ``goal`` is the whole goal. ``result.FIELD`` and ``feedback.FIELD`` write fields to the
    blackboard. SUCCESS requires that the goal succeeds and that ``success``, if set, is true of the result.
    """

    __slots__ = ('_heard',)

    interface_kind = 'action'
    type_attribute = 'action_type'
    parts = {'goal': Part('Goal', True), 'result': Part('Result', False), 'feedback': Part('Feedback', False)}
    condition = 'success'
    ports = ACTION_PORTS | {
        'type': _type_port('action'),
        'server_name': input_port(STRING, description='name of the action'),
        'success': input_port(
            STRING, optional=True, description='condition on the result, such as result.error_code == 0'
        ),
        'resources': input_port(
            STRING,
            default='',
            description=f'what it needs alone, separated by ;, such as {BASE} if it drives the robot',
        ),
        'on_pause': input_port(
            STRING, default='cancel', description='cancel: the goal is sent again after a pause; or continue'
        ),
    }
    example = Example(
        '<CallAction type="nav2_msgs/action/Spin" server_name="spin" goal.target_yaw="1.57" resources="base" '
        'result.error_code="{code}" success="result.error_code == result.NONE"/>'
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._heard: Any = None

    @classmethod
    def options(cls, attributes: Mapping[str, str]) -> dict[str, Any]:
        cancels = _choice(attributes, 'on_pause', ON_PAUSE, 'cancel')
        resources = separated(attributes.get('resources', ''))
        for one in resources:
            if pointer_key(one, 'resources') is not None:
                raise ElementError([('resources', f'{one} has to be written here, not on the blackboard')])
        return {
            'skill': replace(cls.skill, resources=(*cls.skill.resources, *resources)),
            'cancels_on_pause': cancels,
            'goes_on': '' if cancels else 'its goal continues, as on_pause="continue" says',
        }

    def make_goal(self) -> Any:
        self._heard = None
        return self.message('goal')

    def on_feedback(self, feedback: Any) -> None:
        if feedback is not self._heard:
            self._heard = feedback
            self.take('feedback', feedback)

    def on_success(self, result: Any) -> NodeStatus:
        try:
            self.take('result', result)
        except (PortError, ValueError) as error:
            return self.fail(str(error))
        return self.judge({'result': result, 'feedback': self._heard or self.action_type.Feedback()})


class CallService(MessageLeaf, ServiceLeaf):
    """Calls any service.

    ``request.FIELD`` sets a field of the request, as ``goal.FIELD`` of CallAction does. ``response.FIELD`` writes a
    field of the response to the blackboard. SUCCESS when the service has responded and ``success``, if set, is true.
    """

    __slots__ = ()

    interface_kind = 'srv'
    type_attribute = 'service_type'
    parts = {'request': Part('Request', True), 'response': Part('Response', False)}
    condition = 'success'
    ports = SERVICE_PORTS | {
        'type': _type_port('service'),
        'service_name': input_port(STRING, description='name of the service'),
        'success': input_port(STRING, optional=True, description='condition on the response, such as response.success'),
    }
    example = Example(
        '<CallService type="std_srvs/srv/SetBool" service_name="lamp" request.data="true" success="response.success"/>'
    )

    def make_request(self) -> Any:
        return self.message('request')

    def on_response(self, response: Any) -> NodeStatus:
        try:
            self.take('response', response)
        except (PortError, ValueError) as error:
            return self.fail(str(error))
        return self.judge({'response': response})


class _SharedPublisher:
    """A publisher of a server, shared by the leaves of all trees. It ends when nothing needs it any more."""

    def __init__(self, runtime: Runtime, message_type: type[Any], topic: str, qos: QoSProfile) -> None:
        self.publisher = runtime.node.create_publisher(message_type, topic, qos)
        self.made_at = runtime.steady.now()
        weakref.finalize(self, runtime.post, partial(runtime.node.destroy_publisher, self.publisher)).atexit = False

    @classmethod
    def of(cls, runtime: Runtime, message_type: type[Any], topic: str, qos: str) -> _SharedPublisher:
        """Return the publisher of a topic, created on first use. From any thread.

        Raises:
            ValueError: no topic can have that name, or the topic has another type.
        """

        def find() -> _SharedPublisher:
            kept = runtime.shared(cls.__qualname__, lambda: WeakLruCache[Any, _SharedPublisher](MOST_PUBLISHERS))
            return kept.get((topic, message_type, qos), lambda: cls(runtime, message_type, topic, QOS[qos]))

        try:
            return runtime.call(find)
        except TopicTypeError as error:
            raise ValueError(str(error)) from error
        except InvalidTopicNameException as error:
            raise ValueError(f'no topic can be called {topic!r}: {error}') from error


class _TimedLeaf(ServerNode, StatefulAction):
    """An action that may wait, in s of wall time. The wait continues while the tree is paused."""

    __slots__ = ('_timer', '_until')

    goes_on = ''

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._timer: Timer | None = None
        self._until = 0.0

    def seconds(self, port: str, default: float) -> float:
        """Return the value of a port that is in ms, converted to s."""
        milliseconds = self.get_input_or(port, None)
        return default if milliseconds is None else float(milliseconds) / 1000.0

    def wait(self, seconds: float) -> NodeStatus:
        """Have the node ticked again after this time, or earlier; RUNNING."""
        self.stop_waiting()
        steady = self.host.runtime.steady
        self._timer = steady.call_at(steady.now() + seconds, self.wake)
        return NodeStatus.RUNNING

    def stop_waiting(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def on_halted(self) -> None:
        self.stop_waiting()


class Publish(MessageLeaf, _TimedLeaf):
    """Publishes a message of any type.

    ``message.FIELD`` sets a field, as ``goal.FIELD`` of CallAction does.
    """

    __slots__ = ('_message', '_shared')

    interface_kind = 'msg'
    type_attribute = 'message_type'
    message_type: ClassVar[type[Any]]
    parts = {'message': Part('', True)}
    ports = {
        'type': _type_port('messages'),
        'topic_name': _TOPIC_PORT,
        'qos': _QOS_PORT,
        'subscriber_timeout': input_port(
            UNSIGNED, default='1000', description='wait for a subscriber to a new publisher, ms; 0 for none'
        ),
    }
    example = Example('<Publish type="std_msgs/msg/String" topic_name="say" message.data="hello"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._shared: _SharedPublisher | None = None
        self._message: Any = None

    @classmethod
    def options(cls, attributes: Mapping[str, str]) -> dict[str, Any]:
        _choice(attributes, 'qos', QOS, 'default')
        return {}

    def on_start(self) -> NodeStatus:
        try:
            self._message = exact(self.message('message'))
            topic = str(self.get_input('topic_name'))
            self._shared = _SharedPublisher.of(self.host.runtime, self.message_type, topic, str(self.get_input('qos')))
        except (PortError, ValueError) as error:
            return self.fail(str(error))
        self._until = self._shared.made_at + self.seconds('subscriber_timeout', 0.0)
        return self.on_running()

    def on_running(self) -> NodeStatus:
        assert self._shared is not None  # made by on_start
        publisher = self._shared.publisher
        if publisher.get_subscription_count() == 0 and self.host.runtime.steady.now() < self._until:
            return self.wait(_LOOK_SECONDS)
        self.stop_waiting()
        self.acts()
        publisher.publish(self._message)
        return NodeStatus.SUCCESS


class ReadTopic(MessageLeaf, _TimedLeaf):
    """Waits for a message of any type.

    ``message.FIELD`` writes a field to the blackboard, ``message`` the whole message. SUCCESS requires that
    ``success``, if set, is true of the message. FAILURE when no message arrives in time.
    """

    __slots__ = ('_before', '_cache')

    interface_kind = 'msg'
    type_attribute = 'message_type'
    message_type: ClassVar[type[Any]]
    parts = {'message': Part('', False)}
    condition = 'success'
    ports = {
        'type': _type_port('messages'),
        'topic_name': _TOPIC_PORT,
        'qos': _QOS_PORT,
        'timeout': input_port(UNSIGNED, default='1000', description='time for a message to come, ms of wall time'),
        'new': input_port(BOOL, default='false', description='whether to ignore earlier messages'),
        'success': input_port(STRING, optional=True, description='condition, such as message.percentage > 0.2'),
    }
    example = Example('<ReadTopic type="std_msgs/msg/String" topic_name="said" message.data="{text}"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._cache: TopicCache | None = None
        self._before: Any = None

    @classmethod
    def options(cls, attributes: Mapping[str, str]) -> dict[str, Any]:
        return {'qos': _choice(attributes, 'qos', QOS, 'default')}

    qos: ClassVar[QoSProfile] = QOS['default']

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        """Its topic, to which the server subscribes when it loads a tree with this node."""
        return [SubscribedTopic(cls.message_type, '', 'topic_name', cls.qos)]

    def on_start(self) -> NodeStatus:
        try:
            (topic,) = self.subscribes_to()
            self._cache = self.subscribe(topic)
        except (PortError, ValueError) as error:
            return self.fail(str(error))
        self._before = self._cache.latest if self.get_input('new') else None
        self._until = self.host.runtime.steady.now() + self.seconds('timeout', 1.0)
        return self.on_running()

    def on_running(self) -> NodeStatus:
        assert self._cache is not None  # made by on_start
        message = self._cache.latest
        if message is None or message is self._before:
            left = self._until - self.host.runtime.steady.now()
            if left > 0.0:
                return self.wait(left)
            self.stop_waiting()
            text = f'no message on {self.get_input("topic_name")} within {self.seconds("timeout", 1.0):g} s'
            return self.fail(self._cache.without_message(text))
        self.stop_waiting()
        try:
            self.take('message', message)
        except (PortError, ValueError) as error:
            return self.fail(str(error))
        return self.judge({'message': message})


class CheckTopic(MessageLeaf, TopicCondition):
    """SUCCESS when ``check`` is true of the last message of a topic. FAILURE also before the first message."""

    __slots__ = ()

    interface_kind = 'msg'
    type_attribute = 'message_type'
    parts = {'message': Part('', False)}
    condition = 'check'
    ports = {
        'type': _type_port('messages'),
        'topic_name': _TOPIC_PORT,
        'qos': _QOS_PORT,
        'check': input_port(STRING, description='condition, such as message.percentage > 0.2'),
    }
    example = Example(
        '<CheckTopic type="sensor_msgs/msg/BatteryState" topic_name="battery" check="message.percentage > 0.2"/>'
    )

    @classmethod
    def options(cls, attributes: Mapping[str, str]) -> dict[str, Any]:
        written = [name for name in attributes if name.partition('.')[0] == 'message']
        if written:
            raise ElementError([(written[0], 'a condition writes nothing; use ReadTopic')])
        return {'qos': _choice(attributes, 'qos', QOS, 'default')}

    def holds(self, message: Any | None) -> bool:
        return message is not None and self.judge({'message': message}) is NodeStatus.SUCCESS


# Parameters of nodes.

_PARAMETER_PORTS: Final = {
    'node_name': input_port(STRING, description='node that has the parameter'),
    'parameter': input_port(STRING, description='name of the parameter'),
    'server_timeout': SERVICE_PORTS['server_timeout'],
}
_INTEGERS_END: Final = 2**63
_VALUE: Final = 'value'
"""Name of the parameter's value in a condition."""


class SetParameter(ServiceLeaf):
    """Sets a parameter of a node. A number or text is converted to the type that the parameter has."""

    __slots__ = ('_forms', '_refusal')

    service_type = SetParameters
    ports = _PARAMETER_PORTS | {'value': input_port(description='value, as YAML, or {key}')}
    example = Example('<SetParameter node_name="controller_server" parameter="max_speed" value="0.2"/>')

    @property
    def service_name(self) -> str:
        return f'{self.get_input("node_name")}/set_parameters'

    def make_request(self) -> Any:
        value = self.get_input('value')
        text = self.port_key('value') is None
        try:
            plain = load_yaml(value) if text else value
        except YamlError as error:
            raise ValueError(f'port [value]: {short_repr(value)} is not YAML: {error.reason}') from error
        self._refusal = ''
        self._forms = _forms(plain)
        if text and isinstance(value, str) and value not in self._forms:
            self._forms.append(value)
        return self._request()

    def _request(self) -> Any:
        name, value = str(self.get_input('parameter')), self._forms.pop(0)
        try:
            message = check_value(Parameter(name, value=value).to_parameter_msg(), 'rcl_interfaces/msg/Parameter')
        except (TypeError, ValueError, AssertionError, OverflowError, ValueConversionError) as error:
            raise ValueError(f'port [value]: no parameter can have the value {short_repr(value)}') from error
        return SetParameters.Request(parameters=[message])

    def on_response(self, response: Any) -> NodeStatus:
        (result,) = response.results
        if result.successful:
            return NodeStatus.SUCCESS
        self._refusal = self._refusal or result.reason
        if 'type' in result.reason.lower() and self._forms:  # rclcpp and rclpy report another type with this word
            return self.ask(self._request())
        node, parameter = self.get_input('node_name'), self.get_input('parameter')
        return self.fail(f'{node} refused to set {parameter!r}: {self._refusal or "without a reason"}')


def _forms(value: Any) -> list[Any]:
    """Return the forms that a value has as parameters of different types: a whole number is an integer and a double."""
    items = value if isinstance(value, list) else [value]
    if not items or any(type(one) not in (int, float) or abs(one) >= _INTEGERS_END for one in items):
        return [value]
    is_integer = all(type(one) is int for one in items)
    is_whole = all(float(one).is_integer() for one in items)
    kinds: tuple[type, ...] = (int, float) if is_integer else (float, int) if is_whole else (float,)
    forms = [[kind(one) for one in items] for kind in kinds]
    return forms if isinstance(value, list) else [form[0] for form in forms]


class CheckParameter(ServiceCondition):
    """SUCCESS when ``check`` is true of the ``value`` of a node's parameter. FAILURE also if the parameter is unset."""

    __slots__ = ()

    service_type = GetParameters
    ports = _PARAMETER_PORTS | {
        'check': input_port(
            STRING, literal=expression_type('condition', {}), description='condition, such as value > 0.2'
        )
    }
    example = Example('<CheckParameter node_name="controller_server" parameter="max_speed" check="value &lt;= 0.2"/>')

    @property
    def service_name(self) -> str:
        return f'{self.get_input("node_name")}/get_parameters'

    def make_request(self) -> Any:
        return GetParameters.Request(names=[str(self.get_input('parameter'))])

    def on_response(self, response: Any) -> NodeStatus:
        found = [parameter_value_to_python(value) for value in response.values]
        if not found or found[0] is None:
            return self.fail(f'{self.get_input("node_name")} has no parameter {self.get_input("parameter")!r}')
        condition: Expression = self.get_input('check')
        values = {_VALUE: found[0]}
        try:
            if condition.holds(self.context.scripts, self.blackboard, {}, values):
                return NodeStatus.SUCCESS
        except (BehaviorTreeError, ValueError) as error:
            return self.fail(f'check: {error}')
        return self.fail(f'not true: {condition.described(self.blackboard, {}, values)}')


NODES: Final = (CallAction, CallService, Publish, ReadTopic, CheckTopic, SetParameter, CheckParameter)
"""The leaves of this module."""
