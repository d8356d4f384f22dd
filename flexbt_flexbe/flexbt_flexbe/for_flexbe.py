# SPDX-License-Identifier: BSD-3-Clause
"""FlexBT's states in FlexBE's own engine.

With FlexBE installed (and not the shim), a package of states for FlexBE has modules such as::

    from flexbe_core import EventState, Logger
    import flexbt_states
    from flexbt_flexbe.for_flexbe import hosted

    BtExecuteState = hosted(flexbt_states.BtExecuteState, EventState, Logger)

The result is a FlexBT state in a FlexBE wrapper. The wrapper adds what FlexBE lacks: a stop of the behavior leaves the
state properly, cancels its goal, and waits for the end of the goal. An exception in the state means its outcome
``failed``, instead of being raised again at every tick.
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
"""Time that a stopped behavior waits for the end of a goal, s."""

_FAILED: Final = 'failed'


def hosted(state_class: type[EventState], flexbe_event_state: type[Any], flexbe_logger: Any) -> type[Any]:
    """Return a class derived from FlexBE's EventState that behaves like ``state_class``, with the same parameters,
    keys and outcomes."""

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
    """One state in its wrapper, which is also the state's host in a run."""

    def __init__(self, shell: Any, state: EventState, logger: Any) -> None:
        self.state = state
        self._shell = shell
        self._logger = logger
        self._services: StateServices | None = None
        self.outcome: str | None = None
        self._has_asked = False
        self._userdata: Any = None  # while the state is active
        self._wake_event = threading.Event()

    # -- called by FlexBE --------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Call on_start, before the run."""
        self._services = _services_of(self._shell._node)
        self.state.bind(self)
        self.state.on_start()

    def enter(self, userdata: Any) -> None:
        """Enter the state."""
        self.outcome, self._has_asked = None, False
        self._userdata = userdata
        self.state.exit_reason = None
        self._guarded('on_enter', self.state.on_enter)

    def execute(self, userdata: Any) -> str | None:
        """Return the outcome. The first outcome, or the suggestion, is kept while FlexBE calls this again and the
        operator has not decided yet."""
        self._userdata = userdata
        if self.outcome is None and not self._has_asked:
            self.outcome = self._guarded('execute', self.state.execute) or self.outcome
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
        """Leave the state, wait until it has halted, and call on_stop. FlexBE's only call after a stopped run."""
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
        except Exception as error:  # else FlexBE would call it again at every tick
            self.log(Severity.ERROR, f'{what} raised {type(error).__name__}: {error}')
            if _FAILED not in self.state.outcomes:
                raise
            outcome = self.outcome = _FAILED
        return outcome

    # -- called by the state -----------------------------------------------------------------------------------------

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
        """Services of ROS."""
        assert self._services is not None  # made before the first callback
        return self._services

    def wake(self) -> None:
        """Wake a waiting :meth:`stop`. FlexBE executes the state at its next tick anyway."""
        self._wake_event.set()

    def wake_at(self, time: float) -> None:
        """Do nothing: FlexBE executes the state at its rate anyway."""

    def execute_again(self) -> None:
        """Do nothing: FlexBE executes the state at its rate anyway."""

    def ask(self, prompt: str, suggestion: str | None) -> None:
        """Log the prompt and use the suggestion as outcome: in FlexBE the operator can always force any outcome."""
        if prompt:
            self.log(Severity.HINT, prompt)
        self.outcome, self._has_asked = suggestion, True

    def log(self, severity: Severity, text: str) -> None:
        """Log a line for FlexBE's operator."""
        self._logger.log(f'{self.path}: {text}', getattr(self._logger, f'REPORT_{severity.name}'))


@cache
def _services_of(node: Any) -> StateServices:
    """Return the services for all hosted states of FlexBE's node: a separate node, with a thread that never blocks."""
    is_simulated = bool(node.get_parameter('use_sim_time').value) if node.has_parameter('use_sim_time') else False
    runtime = NodeRuntime(
        f'{node.get_name()}_bt', args=(), parameters={'use_sim_time': is_simulated}, namespace=node.get_namespace()
    )
    atexit.register(runtime.close)
    return StateServices.of(runtime)
