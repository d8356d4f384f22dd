# SPDX-License-Identifier: BSD-3-Clause
"""The run on whose thread some code is, for code of behaviors that is handed neither a state nor services.

A behavior is built and run on one thread, so that what is set there holds for its constructors and callbacks, and for
no other run. The thread that spins the node belongs to the same run, for callbacks of topics and timers. FlexBE's
interfaces need it: they find their node by themselves.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property
from typing import Any, Final, TypeVar

from flexbt_core.state_machine import Severity
from flexbt_onboard.errors import OnboardError

from .run_services import StateServices

T = TypeVar('T')


class RunContext:
    """One run, as seen by what its behavior is made of.

    ``log`` takes severity, path of a state ('' for none) and text.
    """

    def __init__(self, services: Callable[[], StateServices], log: Callable[[Severity, str, str], None]) -> None:
        """``services`` is called when the services of the states are asked for first."""
        self.log = log
        self._make_services = services
        self._shared: dict[Any, Any] = {}
        self._at_end: list[Callable[[], object]] = []

    @cached_property
    def services(self) -> StateServices:
        """The services of the states."""
        services = self._make_services()
        runtime = services.runtime
        runtime.post(lambda: _current.set(self))
        self._at_end.append(lambda: runtime.post(self._leave_thread))
        return services

    def shared(self, make: Callable[[RunContext], T]) -> T:
        """What ``make`` gave when it was asked for first: one for the whole run."""
        if make not in self._shared:
            self._shared[make] = make(self)
        made: T = self._shared[make]
        return made

    def at_end(self, close: Callable[[], object]) -> None:
        """Have something closed when the run is over, in reverse order."""
        self._at_end.append(close)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """For the length of the block, :func:`current_run` gives this run on this thread; then it is over."""
        token = _current.set(self)
        _entered.append(self)
        try:
            yield
        finally:
            try:
                while self._at_end:
                    self._close(self._at_end.pop())
            finally:
                _entered.remove(self)
                _current.reset(token)

    def _leave_thread(self) -> None:
        if _current.get() is self:
            _current.set(None)

    def _close(self, close: Callable[[], object]) -> None:
        """What one raises is told, and keeps no other from being closed."""
        try:
            close()
        except BaseException:  # code of the behavior; the run has ended
            self.log(Severity.ERROR, '', f'closing what the run had raised:\n{traceback.format_exc()}')


_current: ContextVar[RunContext | None] = ContextVar('run', default=None)


_entered: Final[list[RunContext]] = []
"""Those whose block goes on, for threads that users' code has started."""


def current_run() -> RunContext:
    """The run on whose thread this is; on a thread of nobody's, the only run of the process.

    Raises:
        OnboardError: the thread belongs to no run, and there is none or there are several.
    """
    run = _current.get()
    if run is not None:
        return run
    if len(_entered) == 1:
        return _entered[0]
    raise OnboardError(
        'this works only where a behavior is built or run: in its create(), in constructors and callbacks of states, '
        f'and on threads of a process with one run; it has {len(_entered) or "none"}'
    )
