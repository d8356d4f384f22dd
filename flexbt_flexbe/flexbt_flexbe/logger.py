# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's Logger: lines for the operator, from anywhere in a behavior."""

from __future__ import annotations

from typing import Any, Final

from flexbt_onboard.run_context import RunContext, current_run
from flexbt_onboard.state_machine import Severity, called_state


class _Throttle:
    """When each line of a run was said last."""

    def __init__(self, run: RunContext) -> None:
        self._steady = run.services.runtime.steady
        self._said: dict[object, float] = {}

    def is_due(self, key: object, period: float) -> bool:
        now = self._steady.now()
        is_due = now - self._said.get(key, -period) >= period
        if is_due:
            self._said[key] = now
        return is_due


class Logger:
    """Lines for the operator (``log...``), or for the log of the node only (``local...``).

    A text is formatted with ``%`` only when there are arguments, so that it may contain percent signs.
    """

    REPORT_INFO: Final = 0
    REPORT_WARN: Final = 1
    REPORT_HINT: Final = 2
    REPORT_ERROR: Final = 3
    REPORT_DEBUG: Final = 10

    @staticmethod
    def initialize(node: Any) -> None:
        """Does nothing: lines go to the run on whose thread they are written."""

    @staticmethod
    def log(text: object, severity: int) -> None:
        """Tell the operator something, in the name of the state that is being called."""
        state = called_state()
        current_run().log(severity_of(severity), state.path if state is not None else '', str(text))

    @staticmethod
    def local(text: object, severity: int) -> None:
        """Write to the log of the node."""
        logger = current_run().services.runtime.node.get_logger()
        level = severity_of(severity)
        # Each has a call of its own: rclpy does not let the severity at one place of the code change.
        if level is Severity.DEBUG:
            logger.debug(str(text))
        elif level is Severity.WARN:
            logger.warning(str(text))
        elif level is Severity.ERROR:
            logger.error(str(text))
        else:
            logger.info(str(text))

    @staticmethod
    def log_throttle(period: float, text: object, severity: int) -> None:
        """Tell the operator something, at most once in ``period`` seconds."""
        if current_run().shared(_Throttle).is_due((called_state(), text, severity), period):
            Logger.log(text, severity)

    @staticmethod
    def logdebug(text: object, *args: Any) -> None:
        Logger.log(_formatted(text, args), Logger.REPORT_DEBUG)

    @staticmethod
    def loginfo(text: object, *args: Any) -> None:
        Logger.log(_formatted(text, args), Logger.REPORT_INFO)

    @staticmethod
    def logwarn(text: object, *args: Any) -> None:
        Logger.log(_formatted(text, args), Logger.REPORT_WARN)

    @staticmethod
    def loghint(text: object, *args: Any) -> None:
        Logger.log(_formatted(text, args), Logger.REPORT_HINT)

    @staticmethod
    def logerr(text: object, *args: Any) -> None:
        Logger.log(_formatted(text, args), Logger.REPORT_ERROR)

    @staticmethod
    def loginfo_throttle(period: float, text: object, *args: Any) -> None:
        Logger.log_throttle(period, _formatted(text, args), Logger.REPORT_INFO)

    @staticmethod
    def logwarn_throttle(period: float, text: object, *args: Any) -> None:
        Logger.log_throttle(period, _formatted(text, args), Logger.REPORT_WARN)

    @staticmethod
    def logerr_throttle(period: float, text: object, *args: Any) -> None:
        Logger.log_throttle(period, _formatted(text, args), Logger.REPORT_ERROR)

    @staticmethod
    def localdebug(text: object, *args: Any) -> None:
        Logger.local(_formatted(text, args), Logger.REPORT_DEBUG)

    @staticmethod
    def localinfo(text: object, *args: Any) -> None:
        Logger.local(_formatted(text, args), Logger.REPORT_INFO)

    @staticmethod
    def localwarn(text: object, *args: Any) -> None:
        Logger.local(_formatted(text, args), Logger.REPORT_WARN)

    @staticmethod
    def localerr(text: object, *args: Any) -> None:
        Logger.local(_formatted(text, args), Logger.REPORT_ERROR)

    debug = logdebug
    info = loginfo
    warning = logwarn
    hint = loghint
    error = logerr


_SEVERITIES: Final = {
    Logger.REPORT_INFO: Severity.INFO,
    Logger.REPORT_WARN: Severity.WARN,
    Logger.REPORT_HINT: Severity.HINT,
    Logger.REPORT_ERROR: Severity.ERROR,
    Logger.REPORT_DEBUG: Severity.DEBUG,
}


def severity_of(constant: int) -> Severity:
    """The severity that one of Logger's constants means; an unknown one is a debug line, as in FlexBE."""
    return _SEVERITIES.get(constant, Severity.DEBUG)


def _formatted(text: object, args: tuple[Any, ...]) -> str:
    return str(text) % args if args else str(text)
