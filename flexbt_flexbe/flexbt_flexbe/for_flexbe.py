# SPDX-License-Identifier: BSD-3-Clause
"""The other way round: FlexBT's states in FlexBE's own engine.

With FlexBE installed (and not the shim), a package of states for FlexBE has modules such as::

    from flexbe_core import EventState, Logger
    import flexbt_states
    from flexbt_flexbe.for_flexbe import hosted

    BtExecuteState = hosted(flexbt_states.BtExecuteState, EventState, Logger)

The state is FlexBT's, in a shell that is FlexBE's. What FlexBE lacks the shell adds: a stop of the behavior leaves the
state in order, so that its goal is canceled, and waits for the end of it; and what the state raises is its outcome
``failed``, instead of being repeated at every tick.
"""

from __future__ import annotations

import atexit
import threading
from functools import cache
from typing import Any, Final

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.clock.clock import Clock
from flexbt_core.state_machine.model.event_state import EventState, ExitReason
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_onboard.behaviors.run_context import StateServices

REST_SECONDS: Final = 3.0
"""Time that a stopped behavior waits for a goal to end, s."""

_FAILED: Final = 'failed'


def hosted(state_class: type[EventState], flexbe_event_state: type[Any], flexbe_logger: Any) -> type[Any]:
    """Return a class that derives from FlexBE's EventState and behaves as ``state_class``: same parameters, keys,
    outcomes."""

    def construct(self: Any, *args: Any, **keywords: Any) -> None:
        inner = state_class(*args, **keywords)
        flexbe_event_state.__init__(
            self, outcomes=list(inner.outcomes), input_keys=list(inner.input_keys), output_keys=list(inner.output_keys)
        )
        self._hosted = _HostedState(self, inner, flexbe_logger)

    return type(
        state_class.__name__,
        (flexbe_event_state,),
        {
            '__init__': construct,
            '__doc__': state_class.__doc__,
            'on_start': lambda self: self._hosted.start(),
            'on_enter': lambda self, userdata: self._hosted.enter(userdata),
            'execute': lambda self, userdata: self._hosted.execute(userdata),
            'on_exit': lambda self, userdata: self._hosted.leave(ExitReason.OUTCOME),
            'on_pause': lambda self: self._hosted.state.on_pause(),
            'on_resume': lambda self, userdata: self._hosted.state.on_resume(userdata),
            'on_stop': lambda self: self._hosted.stop(),
        },
    )


class _HostedState:
    """One state in its shell. It is the state's place in a run, too: its host."""

    def __init__(self, shell: Any, state: EventState, logger: Any) -> None:
        self.state = state
        self._shell = shell
        self._logger = logger
        self._services: StateServices | None = None
        self.outcome: str | None = None
        self._userdata: Any = None  # while the state is active
        self._wake_event = threading.Event()

    # -- what FlexBE calls -------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Before the run."""
        self._services = _services_of(self._shell._node)
        self.state.bind(self)
        self.state.on_start()

    def enter(self, userdata: Any) -> None:
        """Enter the state."""
        self.outcome = None
        self._userdata = userdata
        self.state.exit_reason = None
        self._guarded('on_enter', self.state.on_enter)

    def execute(self, userdata: Any) -> str | None:
        """Return the outcome; once there is one it stays, however often FlexBE asks while the operator makes up their
        mind."""
        self._userdata = userdata
        if self.outcome is None:
            self.outcome = self._guarded('execute', self.state.execute)
        return self.outcome

    def leave(self, reason: ExitReason) -> None:
        """Leave the state, once for each time it was entered."""
        if self._userdata is not None:
            self.state.exit_reason = reason
            try:
                self.state.on_exit(self._userdata)
            finally:
                self._userdata = None

    def stop(self) -> None:
        """After the run; when that was stopped, FlexBE calls nothing else."""
        self.leave(ExitReason.PREEMPTED)
        steady = self.services.runtime.steady
        deadline = steady.now() + REST_SECONDS
        while (halting := self.state.halting()) is not None and steady.now() < deadline:
            self._wake_event.clear()
            self._wake_event.wait(max(0.0, min(0.1, deadline - steady.now())))
        if halting is not None:
            self.log(Severity.ERROR, f'not at rest {REST_SECONDS:g} s after the stop: {halting}')
        self.state.on_stop()
        self.state.bind(None)

    def _guarded(self, what: str, callback: Any) -> str | None:
        try:
            outcome: str | None = callback(self._userdata)
        except Exception as error:  # FlexBE would call it again at every tick
            self.log(Severity.ERROR, f'{what} raised {type(error).__name__}: {error}')
            if _FAILED not in self.state.outcomes:
                raise
            outcome = self.outcome = _FAILED
        return outcome

    # -- what the state asks -----------------------------------------------------------------------------------------

    @property
    def path(self) -> str:
        """FlexBE's path of the state."""
        return str(self._shell.path)

    @property
    def clock(self) -> Clock:
        """The node's clock."""
        return self.services.runtime.clock

    @property
    def services(self) -> StateServices:
        """ROS."""
        assert self._services is not None  # made before the first callback
        return self._services

    def wake(self) -> None:
        """FlexBE executes the state at its next tick, and :meth:`stop` at once."""
        self._wake_event.set()

    def wake_at(self, time: float) -> None:
        """FlexBE asks at its rate anyway."""

    def ask(self, prompt: str, suggestion: str | None) -> None:
        """FlexBE lets the operator choose any outcome at any time; the prompt is logged, the suggestion wanted."""
        if prompt:
            self.log(Severity.HINT, prompt)
        self.outcome = suggestion

    def log(self, severity: Severity, text: str) -> None:
        """Tell FlexBE's operator something."""
        self._logger.log(f'{self.path}: {text}', getattr(self._logger, f'REPORT_{severity.name}'))


@cache
def _services_of(node: Any) -> StateServices:
    """ROS for all hosted states of FlexBE's node: a node of their own beside it, with a thread that never blocks."""
    is_simulated = bool(node.get_parameter('use_sim_time').value) if node.has_parameter('use_sim_time') else False
    runtime = NodeRuntime(
        f'{node.get_name()}_bt', args=(), parameters={'use_sim_time': is_simulated}, namespace=node.get_namespace()
    )
    atexit.register(runtime.close)
    return StateServices.of(runtime)
