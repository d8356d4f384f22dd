# SPDX-License-Identifier: BSD-3-Clause
"""What happens to a run when no operator has been there for some time: what its behavior wants then."""

from __future__ import annotations

from collections.abc import Callable

from flexbt_common.liveness import PresenceWatch
from flexbt_common.runtime import NodeRuntime
from flexbt_core.clock import Timer
from flexbt_core.state_machine import MachineRun
from flexbt_onboard.behaviors import OperatorGone

from .behavior_run import BehaviorRun


class OperatorWatch:
    """Watches whether any console is there. Used on the executor thread only.

    ``presence`` tells who is there. ``tell`` gets a line for the operator, and whether it is a warning. A run that
    goes on anyway tells nothing of it: programs that ask and go would fill the log.
    """

    def __init__(self, runtime: NodeRuntime, presence: PresenceWatch, tell: Callable[[str, bool], None]) -> None:
        self._runtime = runtime
        self._tell = tell
        self._run: BehaviorRun | None = None
        self._timer: Timer | None = None
        self._presence = presence
        self._was_there = False
        presence.add_listener(self._changed)

    def watch_over(self, run: BehaviorRun | None) -> None:
        """A run begins, or has ended (None). The time without an operator counts from its beginning on."""
        self._run = run
        self._set_timer()

    def _changed(self) -> None:
        is_there = bool(self._presence.present)
        if is_there is self._was_there:
            return
        self._was_there = is_there
        if self._run is not None and self._run.snapshot.operator_gone is not OperatorGone.CONTINUE:
            self._tell('an operator is there' if is_there else 'no operator is there any more', not is_there)
        self._set_timer()

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        run = self._run
        if run is None or self._presence.present or run.snapshot.operator_gone is OperatorGone.CONTINUE:
            return
        seconds = run.snapshot.operator_gone_after
        self._timer = self._runtime.post_in(seconds, lambda: self._time_is_over(run))

    def _time_is_over(self, run: BehaviorRun) -> None:
        if run is not self._run or self._presence.present:
            return
        self._timer = None
        shown = run.snapshot
        why = f'no operator was there for {shown.operator_gone_after:g} s'
        if shown.operator_gone is OperatorGone.STOP:
            self._tell(f'{why}: behavior {shown.behavior!r} is stopped', True)
            run.stop(why)
        else:
            self._tell(f'{why}: behavior {shown.behavior!r} is paused until an operator resumes it', True)
            run.command(MachineRun.pause, lambda _reason: None)  # when it is paused already, so much the better
