# SPDX-License-Identifier: BSD-3-Clause
"""Listing the robots of the domain, the most urgent first."""

from __future__ import annotations

import sys
import threading
from typing import Final

from flexbt_console.errors import ExitCode, NoLinkError
from flexbt_console.mirror import Fleet
from flexbt_console.present import coloured, encode_json, has_colours, robot_line, robots_json
from flexbt_core.clock import Clock

QUIET_SECONDS: Final = 1.0
"""Robots are found one after the other: they are all there when none comes, and none becomes live, for so long."""

HEAR_SECONDS: Final = 5.0
"""For so long a robot that was found, and not heard yet, is waited for."""

NAME_SECONDS: Final = 1.2
"""The names of robots are all there when none has come for so long, which is longer than from look to look."""


def found_robots(fleet: Fleet, clock: Clock, timeout: float) -> tuple[str, ...]:
    """The names of the robots that are found: of all as soon as no further one comes, within ``timeout`` seconds."""
    changed = threading.Event()
    fleet.add_listener(changed.set)
    known: tuple[str, ...] = ()
    until = end = clock.now() + timeout
    while (now := clock.now()) < until:
        changed.clear()
        if (found := tuple(fleet.names)) != known:
            known, until = found, min(end, now + NAME_SECONDS)
        changed.wait(until - now)
    return known


def list_robots(fleet: Fleet, clock: Clock, timeout: float, *, as_json: bool) -> ExitCode:
    """Print the robots that are found within ``timeout`` seconds; who is not heard within HEAR_SECONDS is silent.

    Raises:
        NoLinkError: there is none.
    """
    changed = threading.Event()
    fleet.add_listener(changed.set)
    until = end = clock.now() + timeout
    known: set[tuple[str, bool, bool]] = set()
    while True:
        changed.clear()
        found = {(one.name, one.view.snapshot is not None, one.view.live) for one in fleet.overview()}
        now = clock.now()
        if found != known:
            is_heard = all(heard for _, heard, _ in found)
            known, until = found, min(end, now + (QUIET_SECONDS if is_heard else HEAR_SECONDS))
        if now >= until:
            break
        changed.wait(until - now)
    robots = fleet.overview()
    if not any(one.view.snapshot for one in robots):
        raise NoLinkError(f'no robot was heard within {timeout:g} s in this ROS_DOMAIN_ID')
    colours = has_colours(sys.stdout)
    lines = [coloured(robot_line(one), colours) for one in robots]
    print(encode_json(robots_json(robots)) if as_json else '\n'.join(lines), flush=True)
    return ExitCode.OK
