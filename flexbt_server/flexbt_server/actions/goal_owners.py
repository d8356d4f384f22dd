# SPDX-License-Identifier: BSD-3-Clause
"""Nodes on whose behalf trees run (the ``owner`` of a goal): when one is not there any more, its trees are to stop."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Final

from rclpy.action.server import RCLError

from flexbt_common.liveness import LivelinessWatch
from flexbt_common.names import alive_topic
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import Timer
from flexbt_core.errors import FlexbtError

OWNER_SECONDS: Final = 5.0
"""How long an owner may stay unseen before its goals are stopped: it has died already, or holds no liveliness token."""

Stop = Callable[[str], None]
"""Told the reason why a goal has to stop."""


MOST_IDLE: Final = 50
"""Owners without goals that are watched for OWNER_SECONDS more, since they may give the next goal soon."""


class GoalOwners:
    """Used on the executor thread only."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._watches: dict[str, LivelinessWatch] = {}
        self._stops: dict[str, dict[Hashable, Stop]] = {}
        self._idle: dict[str, Timer] = {}  # the longest first

    def watch(self, owner: str, goal: Hashable, stop: Stop) -> None:
        """Call ``stop`` when the owner has died, or is not seen in time, until the goal is released.

        Raises:
            FlexbtError: no node can have this name.
        """
        timer = self._idle.pop(owner, None)
        if timer is not None:
            timer.cancel()
        if owner not in self._watches:
            self._check(owner)
            self._watches[owner] = LivelinessWatch(
                self._runtime, owner, lambda alive: self._runtime.post(lambda: self._changed(owner, alive))
            )
        self._stops.setdefault(owner, {})[goal] = stop
        if not self.sees(owner):
            # It may be younger than our knowledge of it; but a run must not go on for somebody who is not there.
            steady = self._runtime.steady
            steady.call_at(
                steady.now() + OWNER_SECONDS, lambda: self._runtime.post(lambda: self._look_for(owner, goal))
            )

    def release(self, owner: str, goal: Hashable) -> None:
        """The goal has ended."""
        stops = self._stops.get(owner)
        if stops is None or stops.pop(goal, None) is None or stops:
            return
        steady = self._runtime.steady
        self._idle[owner] = steady.call_at(
            steady.now() + OWNER_SECONDS, lambda: self._runtime.post(lambda: self._forget(owner))
        )
        if len(self._idle) > MOST_IDLE:
            self._forget(next(iter(self._idle)))

    def _forget(self, owner: str) -> None:
        timer = self._idle.pop(owner, None)
        if timer is not None:
            timer.cancel()
            self._watches.pop(owner).close()
            del self._stops[owner]

    def sees(self, owner: str) -> bool:
        """Whether the owner is watched, and alive."""
        return owner in self._watches and self._watches[owner].alive is True

    def _check(self, owner: str) -> None:
        try:
            self._runtime.node.resolve_topic_name(alive_topic(owner))
        except RCLError as error:
            raise FlexbtError(
                f'the owner {owner!r} is no name of a node; give one, such as /robot1/executive, or leave owner empty'
            ) from error

    def _look_for(self, owner: str, goal: Hashable) -> None:
        stop = self._stops.get(owner, {}).get(goal)
        if stop is not None and not self.sees(owner):
            stop(
                f'{owner}, on whose behalf the tree ran, was not seen alive within {OWNER_SECONDS:g} s: '
                'it has died, or it holds no liveliness token (leave owner empty if nobody needs to be alive)'
            )

    def _changed(self, owner: str, alive: bool) -> None:
        if not alive:
            for stop in list(self._stops.get(owner, {}).values()):
                stop(f'{owner}, on whose behalf the tree ran, has died')
