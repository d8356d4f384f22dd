# SPDX-License-Identifier: BSD-3-Clause
"""Listing the robots of the domain, the most urgent first."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Final, TypeVar

from flexbt_console.errors import ExitCode, NoLinkError
from flexbt_console.mirror import Fleet
from flexbt_console.present import coloured, encode_json, has_colours, left_out_text, robot_line, robots_json
from flexbt_core.clock import Clock

from .waiting import tell_progress, told_wait

T = TypeVar('T')

QUIET_SECONDS: Final = 1.0
"""Robots are found one after the other: they are all there when none comes, and none becomes live, for so long."""

HEAR_SECONDS: Final = 5.0
"""For so long a robot that was found, and not heard yet, is waited for."""

NAME_SECONDS: Final = 1.2
"""The names of robots are all there when none has come for so long, which is longer than from look to look."""


def found_robots(fleet: Fleet, clock: Clock, timeout: float) -> tuple[str, ...]:
    """The names of the robots that are found: of all as soon as no further one comes, within ``timeout`` seconds."""
    return _settled(fleet, clock, timeout, lambda: tuple(fleet.names), lambda _: NAME_SECONDS)


def list_robots(fleet: Fleet, clock: Clock, timeout: float, *, as_json: bool) -> ExitCode:
    """Print the robots that are found within ``timeout`` seconds; who is not heard within HEAR_SECONDS is unreachable.

    Raises:
        NoLinkError: there is none.
    """

    def heard() -> tuple[tuple[str, bool, bool], ...]:
        return tuple(sorted((one.name, one.view.snapshot is not None, one.view.live) for one in fleet.overview()))

    def quiet(robots: tuple[tuple[str, bool, bool], ...]) -> float:
        return QUIET_SECONDS if all(one[1] for one in robots) else HEAR_SECONDS

    def wanted() -> str:
        unheard = [name for name, is_heard, _ in heard() if not is_heard]
        return f'the status of {", ".join(unheard)}' if unheard else '' if heard() else 'robots'

    with told_wait(clock, wanted, timeout):
        _settled(fleet, clock, timeout, heard, quiet)
    robots = fleet.overview()
    if not any(one.view.snapshot for one in robots):
        raise NoLinkError(f'no robot was heard within {timeout:g} s in this ROS_DOMAIN_ID')
    colours = has_colours(sys.stdout)
    lines = [coloured(robot_line(one), colours) for one in robots]
    print(encode_json(robots_json(robots)) if as_json else '\n'.join(lines), flush=True)
    for text in left_out_text(fleet.left_out):
        tell_progress(text)
    return ExitCode.OK


def _settled(
    fleet: Fleet,
    clock: Clock,
    timeout: float,
    look: Callable[[], tuple[T, ...]],
    quiet: Callable[[tuple[T, ...]], float],
) -> tuple[T, ...]:
    """What is known of the robots when nothing of it has changed for so long, and all that are found are joined that
    may be, or after ``timeout`` seconds."""
    changed = threading.Event()
    fleet.add_listener(changed.set)
    until = end = clock.now() + timeout
    known: tuple[tuple[T, ...], bool] = (), False
    while True:
        changed.clear()
        found, is_growing, now = look(), fleet.is_growing, clock.now()
        if (found, is_growing) != known:
            known, until = (found, is_growing), end if is_growing else min(end, now + quiet(found))
        if now >= until:
            return found
        changed.wait(until - now)
