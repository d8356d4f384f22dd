# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of Nav2's trees that read topics: to select plugins by name, and to watch the battery and the odometry."""

from __future__ import annotations

from abc import ABCMeta
from collections.abc import Sequence
from typing import Any, ClassVar, Final, cast

from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.message_fields import seconds_of
from flexbt_core.behavior_tree.engine.leaf import Condition, StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.outcomes import Example, WithDefault
from flexbt_core.behavior_tree.model.ports import BOOL, DOUBLE, STRING, UNSIGNED, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.skills.literals import ConditionSensor, Predicate
from flexbt_core.skills.skill import Skill
from flexbt_server.leaves.leaf_services import ServerNode
from flexbt_server.leaves.topic_cache import SubscribedTopic, TopicCache
from flexbt_server.leaves.topic_leaf import TopicCondition

_BATTERY_LOW: Final = Predicate(
    'battery_low', {'min_battery': 'limit'}, ConditionSensor('IsBatteryLow', {'min_battery': '$min_battery'})
)


class _BatteryCondition(TopicCondition):
    __slots__ = ()

    message_type = BatteryState
    default_topic = '/battery_status'
    topic_port = 'battery_topic'
    qos = names.best_effort_qos(1)
    ports = {'battery_topic': input_port(STRING, default=default_topic, description='topic, sensor_msgs/BatteryState')}


class IsBatteryLow(_BatteryCondition):
    """SUCCESS when the battery is at ``min_battery`` or below. FAILURE also while its state is unknown."""

    __slots__ = ()

    skill = Skill.measuring(_BATTERY_LOW)
    ports = {
        'min_battery': input_port(DOUBLE, description='share of the capacity, 0 to 1, or voltage, V'),
        **_BatteryCondition.ports,
        'is_voltage': input_port(BOOL, default='false', description='whether min_battery is a voltage'),
    }
    example = Example('<IsBatteryLow min_battery="0.2"/>')

    def holds(self, message: Any | None) -> bool:
        if message is None:
            return False
        measured = message.voltage if self.get_input('is_voltage') else message.percentage
        return bool(measured <= self.get_input('min_battery'))


class IsBatteryCharging(_BatteryCondition):
    """SUCCESS while the battery is charging. FAILURE also while its state is unknown."""

    __slots__ = ()

    skill = Skill.measuring(Predicate('charging', sensor=ConditionSensor('IsBatteryCharging')))
    example = Example('<IsBatteryCharging/>')

    def holds(self, message: Any | None) -> bool:
        return message is not None and message.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_CHARGING


class CheckStopStatus(ServerNode, StatefulAction):
    """SUCCESS when the robot has stood still for ``duration_stopped``; FAILURE when it moves.

    RUNNING in between. The time counts from the stamp of the first odometry message without motion, or without a stamp
    from when the leaf reads it. FAILURE also while the motion is unknown.
    """

    __slots__ = ('_cache', '_since')

    nav2_branch = 'main'
    goes_on = ''
    skill = Skill.measuring(Predicate('stopped', sensor=ConditionSensor('CheckStopStatus')))
    ports = {
        'velocity_threshold': input_port(DOUBLE, default='0.01', description='m/s and rad/s below which it stands'),
        'duration_stopped': input_port(UNSIGNED, default='1000', description='how long, ms'),
    }
    odometry = SubscribedTopic(Odometry, names.ODOM)
    example = Example('<CheckStopStatus velocity_threshold="0.05" duration_stopped="500"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._cache: TopicCache | None = None
        self._since: float | None = None

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        return [cls.odometry]

    def on_start(self) -> NodeStatus:
        if self._cache is None:
            self._cache = self.subscribe(self.odometry)
        self._since = None
        return self.on_running()

    def on_running(self) -> NodeStatus:
        assert self._cache is not None  # made by on_start
        odometry = self._cache.latest
        if odometry is None:
            return self.fail(
                self._cache.without_message('nothing is known of the motion of the robot: no odometry yet')
            )
        twist = odometry.twist.twist
        threshold = self.get_input('velocity_threshold')
        for speed in (twist.linear.x, twist.linear.y, twist.angular.z):
            if not abs(speed) < threshold:  # or it is NaN
                return self.fail(f'the robot moves, by {abs(speed):.3f} m/s or rad/s')
        now = self.clock.now()
        if self._since is None:
            # By the age of the message: the stamps jump with simulated time, and this clock does not.
            stamp = seconds_of(odometry.header.stamp)
            age = seconds_of(self.host.runtime.clock.stamp()) - stamp if stamp else 0.0
            self._since = now - max(0.0, age)  # the sender's clock may be ahead
        end = self._since + self.get_input('duration_stopped') / 1000.0
        if now >= end:
            return NodeStatus.SUCCESS
        self.wake_at(end)
        return NodeStatus.RUNNING

    def on_halted(self) -> None:
        self.cancel_wake()


class IsStopped(CheckStopStatus):
    """CheckStopStatus under its name in Nav2's branch kilted, where it is a condition although it may be RUNNING."""

    __slots__ = ()

    example = Example('<IsStopped duration_stopped="500"/>')


BRAKE_LIMIT: Final = -10.0
"""Acceleration below which the robot has hit an obstacle, m/s^2."""


class _Acceleration:
    """The acceleration between the last two messages of the odometry, m/s^2. On the executor thread."""

    def __init__(self, runtime: Runtime) -> None:
        self.value = 0.0
        self._before: tuple[float, float] | None = None
        runtime.node.create_subscription(Odometry, names.ODOM, self._on_odometry, 10)

    def _on_odometry(self, odometry: Any) -> None:
        stamp = odometry.header.stamp
        now, speed = seconds_of(stamp), odometry.twist.twist.linear.x
        if self._before is not None and now > self._before[0]:
            self.value = (speed - self._before[1]) / (now - self._before[0])
        self._before = now, speed


class IsStuck(ServerNode, Condition):
    """SUCCESS when the robot has hit an obstacle: its odometry shows a deceleration of more than 10 m/s^2."""

    __slots__ = ('_acceleration',)

    skill = Skill.measuring(Predicate('stuck', sensor=ConditionSensor('IsStuck')))
    example = Example('<IsStuck/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._acceleration: _Acceleration | None = None

    def tick(self) -> NodeStatus:
        if self._acceleration is None:
            runtime = self.host.runtime
            self._acceleration = runtime.call(lambda: runtime.once('acceleration of the robot', _Acceleration))
        value = self._acceleration.value
        return NodeStatus.SUCCESS if value < BRAKE_LIMIT else self.fail(f'the robot is free ({value:.1f} m/s^2)')


class _Selector(ServerNode, SyncAction):
    """Writes the name that was last published on a latched topic, or the default."""

    __slots__ = ('_cache',)

    selected: ClassVar[str]
    default: ClassVar[str]

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._cache: TopicCache | None = None

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        return [
            SubscribedTopic(String, str(cls.ports['topic_name'].default), 'topic_name', names.transient_local_qos())
        ]

    def tick(self) -> NodeStatus:
        if self._cache is None:
            (topic,) = self.subscribes_to()
            self._cache = self.subscribe(topic)
        message = self._cache.latest
        name = (message.data if message is not None else '') or str(self.get_input_or(self.default, ''))
        if not name:
            why = f'nothing was published on {self.get_input("topic_name")}, and {self.default} is not given'
            return self.fail(why if message is not None else self._cache.without_message(why))
        self.set_output(self.selected, name)
        return NodeStatus.SUCCESS


def _selector(kind: str, example: str, key: str, what_for: str = '', nav2_branch: str = '') -> type[_Selector]:
    """Return the leaf that selects plugins of a kind, such as 'goal_checker'."""
    what = kind.replace('_', ' ')
    id = f'{what.title().replace(" ", "")}Selector'
    default, selected = f'default_{kind}', f'selected_{kind}'
    attributes = {
        '__doc__': f'Selects the {what}{what_for}.',
        '__module__': __name__,
        '__slots__': (),
        'nav2_branch': nav2_branch,
        'selected': selected,
        'default': default,
        'ports': {
            'topic_name': input_port(STRING, default=f'{kind}_selector', description='latched topic, std_msgs/String'),
            default: input_port(STRING, optional=True, description=f'{what} while nothing was published'),
            selected: output_port(STRING, description=f'name of the {what}'),
        },
        'outcomes': WithDefault(default),
        'example': Example(f'<{id} {default}="{example}" {selected}="{{{key}}}"/>'),
    }
    return cast('type[_Selector]', ABCMeta(id, (_Selector,), attributes))


NODES: Final = (
    _selector('controller', 'FollowPath', 'controller', ' for FollowPath'),
    _selector('planner', 'GridBased', 'planner', ' for ComputePath nodes'),
    _selector('smoother', 'simple_smoother', 'smoother'),
    _selector('goal_checker', 'goal_checker', 'checker', ' for FollowPath'),
    _selector('progress_checker', 'progress_checker', 'checker', ' for FollowPath'),
    _selector('path_handler', 'PathHandler', 'handler', ' for FollowPath', 'main'),
    IsBatteryLow,
    IsBatteryCharging,
    CheckStopStatus,
    IsStopped,
    IsStuck,
)
