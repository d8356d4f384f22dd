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


def list_robots(fleet: Fleet, clock: Clock, timeout: float, *, as_json: bool) -> ExitCode:
    """Print the robots that are heard within ``timeout`` seconds.

    Raises:
        NoLinkError: there is none.
    """
    changed = threading.Event()
    fleet.add_listener(changed.set)
    end, known, quiet_from = clock.now() + timeout, -1, clock.now()
    while clock.now() < min(end, quiet_from + QUIET_SECONDS) or (known <= 0 and clock.now() < end):
        changed.wait(min(QUIET_SECONDS, max(0.0, end - clock.now())))
        changed.clear()
        live = sum(one.view.live for one in fleet.overview())
        if live != known:
            known, quiet_from = live, clock.now()
    heard = [one for one in fleet.overview() if one.view.snapshot is not None]
    if not heard:
        raise NoLinkError(f'no robot was heard within {timeout:g} s in this ROS_DOMAIN_ID')
    colours = has_colours(sys.stdout)
    lines = [coloured(robot_line(one), colours) for one in heard]
    print(encode_json(robots_json(heard)) if as_json else '\n'.join(lines), flush=True)
    return ExitCode.OK
