# SPDX-License-Identifier: BSD-3-Clause
"""States that wait for a time, or until servers are ready."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from flexbt_common import names
from flexbt_common.calls.action_call import ActionServerLink
from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_core.values.text import short_repr
from flexbt_onboard.behaviors.run_context import state_services

from .errors import StateParameterError
from .parameter_checks import (
    checked_action_type,
    checked_list,
    checked_mapping,
    checked_timeout,
    checked_topic,
    is_number,
)


class WaitState(EventState):
    """
    Wait for a time on the node's clock.

    -- wait_time    float       Seconds to wait

    <= done                     The time has passed.
    """

    def __init__(self, wait_time: float) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        if not is_number(wait_time) or wait_time < 0.0:
            raise StateParameterError(self, 'wait_time', f'{short_repr(wait_time)} is not a number of seconds')
        self._wait_time = float(wait_time)
        self.skill = self.skill.lasting(self._wait_time, self._wait_time)
        self._end = 0.0

    def on_enter(self, userdata: UserData) -> None:
        self._end = self.clock.now() + self._wait_time
        self.wake_at(self._end)

    def execute(self, userdata: UserData) -> str | None:
        if self.clock.now() >= self._end:
            return 'done'
        self.wake_at(self._end)
        return None


# State that waits until servers are ready.

_PERIOD: Final = 0.2
"""Period of the check for action servers, s of wall time: the graph does not notify when they appear."""


class WaitForServersState(EventState):
    """
    Wait until servers are ready, for example while one restarts after a crash.

    -- nodes        string[]    Nodes that report their readiness: BT server, executive, simulator, navigation
    -- actions      dict        Action servers of other nodes, with their types, e.g. nav2_msgs/action/FollowPath
    -- timeout      float       Seconds (wall time) to wait; None for no limit

    <= ready                    All servers are ready.
    <= timeout                  Some servers were not ready in time; their names are logged.
    """

    def __init__(
        self,
        nodes: Iterable[str] = (names.BT_SERVER,),
        actions: Mapping[str, str] | None = None,
        timeout: float | None = None,
    ) -> None:
        super().__init__(outcomes=['ready', 'timeout'], desired_rate=None)
        self._nodes = [checked_topic(self, 'nodes', name) for name in checked_list(self, 'nodes', nodes, 'names')]
        self._actions = {
            checked_topic(self, 'actions', name): checked_action_type(self, f'actions[{name!r}]', type)
            for name, type in checked_mapping(self, 'actions', actions).items()
        }
        if not self._nodes and not self._actions:
            raise StateParameterError(self, 'nodes', 'there is nothing to wait for; give nodes or actions')
        self._timeout = checked_timeout(self, 'timeout', timeout)
        self.skill = self.skill.within(self._timeout)
        self._watches: list[_NodeWatch] = []
        self._links: list[ActionServerLink] = []
        self._missing: list[str] = []
        self._deadline: float | None = None
        self._timer: Timer | None = None

    def on_start(self) -> None:
        services = state_services(self)
        self._watches = [_node_watch(services.runtime, name) for name in self._nodes]
        self._links = [services.actions.link(type, name) for name, type in self._actions.items()]

    def on_enter(self, userdata: UserData) -> None:
        for watch in self._watches:
            watch.waiting.add(self)
        self._missing = []
        self._deadline = None if self._timeout is None else state_services(self).runtime.steady.now() + self._timeout

    def execute(self, userdata: UserData) -> str | None:
        self._cancel_timer()
        services = state_services(self)
        nodes = [f'{one.watch.node_name} ({one.state})' for one in self._watches if not one.watch.ready]
        missing = [*nodes, *(link.name for link in self._links if not link.is_ready())]
        if not missing:
            return 'ready'
        now = services.runtime.steady.now()
        if self._deadline is not None and now >= self._deadline:
            self.log_warn(f'not ready within {self._timeout:g} s: {", ".join(missing)}')
            return 'timeout'
        if missing != self._missing:
            self._missing = missing
            services.changed()
        times = [time for time in (self._deadline, now + _PERIOD if self._links else None) if time is not None]
        if times:
            self._timer = services.runtime.steady.call_at(min(times), self.wake)
        return None

    def on_exit(self, userdata: UserData) -> None:
        self._cancel_timer()
        for watch in self._watches:
            watch.waiting.discard(self)

    def activity(self) -> Sequence[str]:
        return [f'waits for {", ".join(self._missing)}'] if self._missing else []

    def not_paused(self) -> Sequence[str]:
        return ['time-out: it counts wall time'] if self._deadline is not None else []

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class _NodeWatch:
    """The watch of one node for all states on this node that wait for it; it exists as long as this node."""

    def __init__(self, runtime: Runtime, name: str) -> None:
        self.waiting: set[EventState] = set()
        self.watch = LivelinessWatch(runtime, name, self._tell, self._tell, self._tell)

    @property
    def state(self) -> str:
        """Reason why the node is not ready."""
        seen = {None: 'not seen yet', False: 'gone'}.get(self.watch.alive)
        return seen or self.watch.problem

    def _tell(self, _value: Any) -> None:
        for state in tuple(self.waiting):
            state.wake()


def _node_watch(runtime: Runtime, name: str) -> _NodeWatch:
    return runtime.call(lambda: runtime.once(('wait for', name), lambda host: _NodeWatch(host, name)))
