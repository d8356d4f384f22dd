# SPDX-License-Identifier: BSD-3-Clause
"""What code finds out about the run on whose thread it is."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from flexbt_core.state_machine import Severity
from flexbt_onboard.behaviors import RunContext, current_run
from flexbt_onboard.errors import OnboardError


def context() -> RunContext:
    return RunContext(lambda: None, lambda *_: None)  # type: ignore[arg-type,return-value]


def test_a_run_is_known_on_its_thread_only_and_only_while_it_lasts() -> None:
    seen: list[Any] = []

    def elsewhere() -> None:
        with pytest.raises(OnboardError):
            current_run()
        with context().entered():
            seen.append(current_run())

    run = context()
    with run.entered():
        thread = threading.Thread(target=elsewhere)
        thread.start()
        thread.join()
        assert current_run() is run
        assert seen and seen[0] is not run
    with pytest.raises(OnboardError):
        current_run()


def test_what_is_shared_is_made_once_for_each_run_and_closed_in_reverse_order() -> None:
    closed: list[str] = []

    def make(run: RunContext) -> list[int]:
        run.at_end(lambda: closed.append('made'))
        return []

    first, second = context(), context()
    with first.entered():
        first.at_end(lambda: closed.append('before'))
        assert first.shared(make) is first.shared(make)
        assert first.shared(make) is not second.shared(make)
        assert closed == []
    assert closed == ['made', 'before']


def test_what_one_raises_on_closing_is_told_and_keeps_no_other_from_being_closed() -> None:
    closed: list[str] = []
    lines: list[tuple[Severity, str]] = []

    def boom() -> None:
        raise SystemExit('boom')

    run = context()
    run.log = lambda severity, _path, text: lines.append((severity, text))
    with run.entered():
        run.at_end(lambda: closed.append('first'))
        run.at_end(boom)
        run.at_end(lambda: closed.append('last'))
    assert closed == ['last', 'first']
    ((severity, text),) = lines
    assert severity is Severity.ERROR
    assert 'boom' in text
    with pytest.raises(OnboardError):
        current_run()
