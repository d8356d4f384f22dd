# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's loggers: Logger writes lines for the operator, StateLogger records for the analysis of runs."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Final, TypeVar

from flexbt_core.state_machine.model.event_state import EventState, called_state
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_onboard.behaviors.run_context import RunContext, current_run
from flexbt_onboard.link.console_link import log_to_node

from .event_state import RosAccess

MOST_THROTTLED: Final = 1024
"""Number of throttled lines of a run whose times are kept: lines with a number in them are always new."""


class _Throttle:
    """The times at which the lines of a run were last logged."""

    def __init__(self, run: RunContext) -> None:
        self._steady = run.services.runtime.steady
        self._said: OrderedDict[object, float] = OrderedDict()

    def is_due(self, key: object, period: float) -> bool:
        now = self._steady.now()
        is_due = now - self._said.get(key, -period) >= period
        if is_due:
            self._said[key] = now
            self._said.move_to_end(key)
            if len(self._said) > MOST_THROTTLED:
                self._said.popitem(last=False)
        return is_due


def log(text: object, severity: int) -> None:
    """Log a line for the operator, in the name of the calling state."""
    state = called_state()
    current_run().log(severity_of(severity), state.path if state is not None else '', str(text))


def local(text: object, severity: int) -> None:
    """Write to the log of the node."""
    log_to_node(current_run().services.runtime.node, severity_of(severity).value, str(text))


def log_throttle(period: float, text: object, severity: int) -> None:
    """Log a line for the operator, at most once in ``period`` seconds."""
    if current_run().shared(_Throttle).is_due((log, text, severity), period):
        log(text, severity)


def local_throttle(period: float, text: object, severity: int, *args: Any) -> None:
    """Write to the log of the node, at most once in ``period`` seconds."""
    shown = _formatted(text, args) if args else str(text)
    if current_run().shared(_Throttle).is_due((local, shown, severity), period):
        local(shown, severity)


def severity_of(constant: int) -> Severity:
    """Return the severity for one of Logger's constants; as in FlexBE, an unknown one means debug."""
    return _SEVERITIES.get(constant, Severity.DEBUG)


def _line(tell: Callable[[object, int], None], severity: int) -> Callable[..., None]:
    def line(text: object, *args: Any) -> None:
        tell(_formatted(text, args), severity)

    return staticmethod(line)


def _throttled(tell: Callable[[float, object, int], None], severity: int) -> Callable[..., None]:
    def line(period: float, text: object, *args: Any) -> None:
        tell(period, _formatted(text, args), severity)

    return staticmethod(line)


def _formatted(text: object, args: tuple[Any, ...]) -> str:
    """Return the text with its arguments inserted. Without arguments, ``%%`` becomes a percent sign, and other percent
    signs stay unchanged."""
    try:
        return str(text) % args
    except (TypeError, ValueError):
        if args:
            raise
        return str(text)


class Logger:
    """A logger for the operator (``log...``), or for the node's log only (``local...``).

    ``..._throttle`` has a period in seconds as its first argument and writes the same line once per period.
    """

    REPORT_INFO: Final = 0
    REPORT_WARN: Final = 1
    REPORT_HINT: Final = 2
    REPORT_ERROR: Final = 3
    REPORT_DEBUG: Final = 10

    log = staticmethod(log)
    local = staticmethod(local)
    log_throttle = staticmethod(log_throttle)
    local_throttle = staticmethod(local_throttle)

    logdebug = debug = _line(log, REPORT_DEBUG)
    loginfo = info = _line(log, REPORT_INFO)
    logwarn = warning = _line(log, REPORT_WARN)
    loghint = hint = _line(log, REPORT_HINT)
    logerr = error = _line(log, REPORT_ERROR)

    localdebug = _line(local, REPORT_DEBUG)
    localinfo = _line(local, REPORT_INFO)
    localwarn = _line(local, REPORT_WARN)
    localhint = _line(local, REPORT_HINT)
    localerr = _line(local, REPORT_ERROR)

    logdebug_throttle = _throttled(log_throttle, REPORT_DEBUG)
    loginfo_throttle = _throttled(log_throttle, REPORT_INFO)
    logwarn_throttle = _throttled(log_throttle, REPORT_WARN)
    loghint_throttle = _throttled(log_throttle, REPORT_HINT)
    logerr_throttle = _throttled(log_throttle, REPORT_ERROR)

    localdebug_throttle = _throttled(local_throttle, REPORT_DEBUG)
    localinfo_throttle = _throttled(local_throttle, REPORT_INFO)
    localwarn_throttle = _throttled(local_throttle, REPORT_WARN)
    localhint_throttle = _throttled(local_throttle, REPORT_HINT)
    localerr_throttle = _throttled(local_throttle, REPORT_ERROR)

    @staticmethod
    def initialize(node: Any) -> None:
        """Do nothing: lines go to the run on the current thread."""


_SEVERITIES: Final = {getattr(Logger, f'REPORT_{severity.name}'): severity for severity in Severity}


# FlexBE's StateLogger: records for the analysis of runs.

Class = TypeVar('Class', bound=type[Any])


class StateLogger(RosAccess):
    """A logger whose records become debug lines of the run.

    The executive records entry, exit, outcomes and decisions of every state. So the decorators that add this to single
    classes return them unchanged.
    """

    @staticmethod
    def initialize(be_name: str | None = None) -> None:
        """Do nothing: a run always records."""

    @staticmethod
    def shutdown() -> None:
        """Do nothing."""

    @staticmethod
    def log(name: str, state: EventState, **kwargs: Any) -> None:
        """Record data of a state, under the name of a logger."""
        fields = ' '.join(f'{key}={value!r}' for key, value in kwargs.items())
        current_run().log(Severity.DEBUG, state.path, f'{name}: {fields}')

    @staticmethod
    def log_events(name: str, **events: str) -> Callable[[Class], Class]:
        """Decorate a class."""
        return _unchanged

    @staticmethod
    def log_outcomes(name: str) -> Callable[[Class], Class]:
        """Decorate a class."""
        return _unchanged

    @staticmethod
    def log_userdata(name: str, keys: list[str] | None = None) -> Callable[[Class], Class]:
        """Decorate a class."""
        return _unchanged


def _unchanged(decorated: Class) -> Class:
    return decorated
