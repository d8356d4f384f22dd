# SPDX-License-Identifier: BSD-3-Clause
"""The owners of goals: nodes on whose behalf trees run. The trees of an owner stop when it is gone, and are held while
it is late.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import Final

from rclpy.action.server import RCLError

from flexbt_common.lifecycle.liveliness import LivelinessWatch, ProcessIdentity
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

_Watched = tuple[OnOwnerGone, OnOwnerLate | None, ProcessIdentity | None]
"""With the process of the owner, if the goal names it: a later one of the same name knows nothing of the goal."""

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

    def watch(
        self, owner: str, goal: Hashable, stop: OnOwnerGone, hold: OnOwnerLate | None = None, process: str = ''
    ) -> None:
        """Call ``stop`` when the owner is gone or is not seen in time, and ``hold`` when it becomes late or returns,
        until :meth:`release`. ``goal`` may be any other object that ends with the owner. ``process`` is the
        :class:`ProcessIdentity` of the owner as text; '' for any process of its name.

        Raises:
            FlexbtError: the name is not valid for a node, or the text is not an identity.
        """
        identity = _identity_of(owner, process) if process else None
        timer = self._idle.pop(owner, None)
        if timer is not None:
            timer.cancel()
        if owner not in self._watches:
            self._check(owner)
            self._watches[owner] = LivelinessWatch(
                self._runtime,
                owner,
                lambda alive: self._changed(owner, alive),
                on_late=lambda _late: self._runtime.post(lambda: self._hold(owner)),
                timeout=self._peer_timeout,
            )
        watched = self._goals.setdefault(owner, {})[goal] = stop, hold, identity
        if not self.sees(owner, identity):
            # The owner may be too new to be known, but a run must not continue for an owner that is not alive.
            if self._is_gone(owner, identity):
                self._runtime.post(lambda: self._end(owner, [(goal, watched)]))
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

    def sees(self, owner: str, process: ProcessIdentity | None = None) -> bool:
        """Return whether the owner is watched and alive, as this process if one is given."""
        watch = self._watches.get(owner)
        return watch is not None and (watch.alive is True if process is None else watch.is_held_by(process))

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
        stop, _, process = watched
        if self._goals.get(owner, {}).get(goal) is watched and not self.sees(owner, process):
            stop(
                f'{owner}, on whose behalf the tree ran, was not seen alive within {OWNER_SECONDS:g} s: '
                'it has died, or it holds no liveliness token (leave owner empty if nobody needs to be alive)'
            )

    def _changed(self, owner: str, alive: bool) -> None:
        # Now, since the owner may be there again before what is posted.
        goals = self._goals.get(owner, {}).items()
        ended = [(goal, watched) for goal, watched in goals if self._is_gone(owner, watched[2], alive)]
        self._runtime.post(lambda: self._end(owner, ended))

    def _is_gone(self, owner: str, process: ProcessIdentity | None, alive: bool = True) -> bool:
        """Return whether the owner of a goal is gone; ``alive`` tells whether a process has the owner's name."""
        return not alive if process is None else self._watches[owner].is_gone_process(process)

    def _end(self, owner: str, ended: Sequence[tuple[Hashable, _Watched]]) -> None:
        """Stop the goals whose owner is gone, and review whether others are held."""
        self._hold(owner)
        for goal, watched in ended:
            if self._goals.get(owner, {}).get(goal) is watched:
                successor = '; another process has its name now' if self.sees(owner) else ''
                what = 'is gone: it has ended or died, or was late for too long'
                watched[0](f'{owner}, on whose behalf the tree ran, {what}{successor}')

    def _hold(self, owner: str) -> None:
        problem = self.problem(owner)
        holds = [hold for _, hold, _ in self._goals.get(owner, {}).values() if hold is not None]
        if problem and holds:
            self._runtime.node.get_logger().warning(f'trees are held: {problem}')
        for hold in holds:
            hold()


def _identity_of(owner: str, process: str) -> ProcessIdentity:
    try:
        return ProcessIdentity.parse(process)
    except ValueError as error:
        raise FlexbtError(
            f'owner_process of {owner}, {process!r}, is not HOST PID BEGAN; give what the token of the owner says '
            '(hardware_id, pid, began), or leave it empty'
        ) from error
