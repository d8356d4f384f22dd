# SPDX-License-Identifier: BSD-3-Clause
"""The nodes that the executive depends on: what is told of one that is late."""

from __future__ import annotations

import functools
import threading
from contextlib import ExitStack
from types import SimpleNamespace
from typing import Any

from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_onboard.link.peers import PeersWatch
from flexbt_testing.waiting import wait_until


def test_a_node_that_is_late_is_told_once_in_a_spell_and_its_return_is_no_news() -> None:
    told: list[str] = []

    def has_told(count: int) -> bool:
        return len(told) == count

    with ExitStack() as stack:
        runtime, other = (stack.enter_context(NodeRuntime.open(name)) for name in ('watching', 'watched'))
        report: Any = SimpleNamespace(run_id='', log=lambda severity, text, run_id: told.append(text))
        watch = PeersWatch(runtime, ['watched'], report, 60.0)
        token = other.call(lambda: LivelinessToken(other))
        wait_until(lambda: watch.unready() == watch.starting() == ['/watched'], 'its start')
        token.set_ready(True)
        wait_until(lambda: told == ['/watched is alive', '/watched is ready'], lambda: told)
        for spell in (1, 2):
            goes_on = threading.Event()
            other.post(goes_on.wait)
            try:
                wait_until(functools.partial(has_told, 2 + spell), lambda: told)
                assert runtime.call(watch.statuses)[0].late
                assert (watch.unready(), watch.starting()) == (['/watched'], [])
            finally:
                goes_on.set()
            wait_until(lambda: runtime.call(watch.statuses)[0].ready, 'ready again')
    assert all(text.startswith('/watched is late: ') for text in told[2:4]), told
    assert not [text for text in told[4:] if 'ready' in text], told
