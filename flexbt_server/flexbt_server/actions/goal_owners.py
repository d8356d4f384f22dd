# SPDX-License-Identifier: BSD-3-Clause
"""The owners of goals: nodes on whose behalf trees run. The trees of an owner stop when it is gone, and are held while
it is late.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Final

from rclpy.action.server import RCLError

from flexbt_common.lifecycle.liveliness import LivelinessWatch
from flexbt_common.names import alive_topic
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.clock import Timer
from flexbt_core.errors import FlexbtError

OWNER_SECONDS: Final = 5.0
"""Time for which an owner may be unseen before its goals are stopped, s: it has died already, or holds no liveliness
token."""

OnOwnerGone = Callable[[str], None]
"""Called with the reason why a goal has to stop."""

OnOwnerLate = Callable[[], None]
"""Called when a goal must be held, or may continue: see :meth:`GoalOwners.problem`."""

_Watched = tuple[OnOwnerGone, OnOwnerLate | None, frozenset[bytes]]
"""With the tokens of an owner that was not alive yet: it is one of the processes that hold them."""

MOST_IDLE: Final = 50
"""Maximum number of owners without goals that stay watched for OWNER_SECONDS, since they may soon send the next
goal."""


class GoalOwners:
    """The owners of all active goals, and the watches on them. Executor thread only."""

    def __init__(self, runtime: Runtime, peer_timeout: float) -> None:
        """``peer_timeout``: time for which an owner may be late before it counts as gone, s of wall time."""
        self._runtime = runtime
        self._peer_timeout = peer_timeout
        self._watches: dict[str, LivelinessWatch] = {}
        self._goals: dict[str, dict[Hashable, _Watched]] = {}
        self._idle: dict[str, Timer] = {}  # the longest first

    def watch(self, owner: str, goal: Hashable, stop: OnOwnerGone, hold: OnOwnerLate | None = None) -> None:
        """Call ``stop`` when the owner is gone or is not seen in time, and ``hold`` when it becomes late or returns,
        until :meth:`release`. ``goal`` may be any other object that ends with the owner.

        Raises:
            FlexbtError: the name is not valid for a node.
        """
        timer = self._idle.pop(owner, None)
        if timer is not None:
            timer.cancel()
        if owner not in self._watches:
            self._check(owner)
            self._watches[owner] = LivelinessWatch(
                self._runtime,
                owner,
                lambda alive: self._runtime.post(lambda: self._changed(owner, alive)),
                on_late=lambda _late: self._runtime.post(lambda: self._hold(owner)),
                timeout=self._peer_timeout,
            )
        is_seen = self.sees(owner)
        tokens = frozenset[bytes]() if is_seen else self._watches[owner].tokens()
        watched = self._goals.setdefault(owner, {})[goal] = stop, hold, tokens
        if not is_seen:
            # The owner may be too new to be known, but a run must not continue for an owner that is not alive.
            self._runtime.post_in(OWNER_SECONDS, lambda: self._look_for(owner, goal, watched))

    def release(self, owner: str, goal: Hashable) -> None:
        """Stop watching the owner of a goal that has ended."""
        goals = self._goals.get(owner)
        if goals is None or goals.pop(goal, None) is None or goals:
            return
        self._idle[owner] = self._runtime.post_in(OWNER_SECONDS, lambda: self._forget(owner))
        if len(self._idle) > MOST_IDLE:
            self._forget(next(iter(self._idle)))

    def _forget(self, owner: str) -> None:
        timer = self._idle.pop(owner, None)
        if timer is not None:
            timer.cancel()
            self._watches.pop(owner).close()
            del self._goals[owner]

    def sees(self, owner: str) -> bool:
        """Return whether the owner is watched and alive."""
        return owner in self._watches and self._watches[owner].alive is True

    def problem(self, owner: str) -> str:
        """Return the reason to hold the goals of the owner, or ''."""
        watch = self._watches.get(owner)
        if watch is None or not (watch.late or watch.alive is False):
            return ''
        what = ': '.join(filter(None, ('late' if watch.late else 'gone', watch.problem)))
        return f'{owner}, on whose behalf the tree runs, is {what}'

    def _check(self, owner: str) -> None:
        try:
            self._runtime.node.resolve_topic_name(alive_topic(owner))
        except RCLError as error:
            raise FlexbtError(
                f'the owner {owner!r} is not a node name; give one, such as /robot1/executive, or leave owner empty'
            ) from error

    def _look_for(self, owner: str, goal: Hashable, watched: _Watched) -> None:
        if self._goals.get(owner, {}).get(goal) is watched and not self.sees(owner):
            stop, *_ = watched
            stop(
                f'{owner}, on whose behalf the tree ran, was not seen alive within {OWNER_SECONDS:g} s: '
                'it has died, or it holds no liveliness token (leave owner empty if nobody needs to be alive)'
            )

    def _changed(self, owner: str, alive: bool) -> None:
        self._hold(owner)
        for stop, _, tokens in list(self._goals.get(owner, {}).values()):
            if not alive:
                stop(f'{owner}, on whose behalf the tree ran, is gone: it has ended or died, or was late for too long')
            elif self._has_successor(owner, tokens):
                stop(f'{owner}, on whose behalf the tree ran, has died: another process has its name now')

    def _has_successor(self, owner: str, tokens: frozenset[bytes]) -> bool:
        """Return whether the owner that is alive is none of the processes that were there when its goal came."""
        watch = self._watches[owner]
        heard = {one for one in watch.tokens() if watch.knows(one)}
        return bool(tokens and heard) and tokens.isdisjoint(heard)

    def _hold(self, owner: str) -> None:
        problem = self.problem(owner)
        holds = [hold for _, hold, _ in self._goals.get(owner, {}).values() if hold is not None]
        if problem and holds:
            self._runtime.node.get_logger().warning(f'trees are held: {problem}')
        for hold in holds:
            hold()
