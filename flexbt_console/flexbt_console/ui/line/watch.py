# SPDX-License-Identifier: BSD-3-Clause
"""Following an executive: a line for each event, for people or for programs."""

from __future__ import annotations

import sys
import time

from flexbt_console.errors import ExitCode, NoLinkError
from flexbt_console.link import OperatorLink
from flexbt_console.mirror import LinkState, Mirror, View
from flexbt_console.present import SETTLE_SECONDS, Event, Follower, coloured, encode_json, has_colours


def watch(mirror: Mirror, link: OperatorLink, *, as_json: bool, seconds: float | None) -> ExitCode:
    """Print every change, until interrupted or for so many seconds.

    Raises:
        NoLinkError: the time is over, and no executive was heard.
    """
    follower, colours = Follower(mirror), has_colours(sys.stdout)
    end = None if seconds is None else time.monotonic() + seconds
    is_settled = as_json  # people are told in its order what is latched beside the first status

    def further_events(view: View) -> list[Event] | None:
        return [] if view.snapshot is not None and not is_settled else follower.events(view) or None

    while True:
        left = None if end is None else max(0.0, end - time.monotonic())
        events = link.wait_for(further_events, left)
        if events is None:
            break
        if not events:
            link.wait_for(lambda view: None, SETTLE_SECONDS)
            is_settled = True
        for name, value, text in events:
            if as_json:
                print(encode_json({'event': name, 'time': time.time(), **value}), flush=True)
            elif text:
                stamp = time.strftime('%H:%M:%S')
                print('\n'.join(f'{stamp} {coloured(line, colours)}' for line in text), flush=True)
    view = mirror.view()
    if view.snapshot is None:
        raise NoLinkError(f'no executive was heard in {seconds:g} s')
    return ExitCode.OK if view.link is not LinkState.LOST else ExitCode.NO_LINK
