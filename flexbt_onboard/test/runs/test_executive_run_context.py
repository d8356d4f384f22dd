# SPDX-License-Identifier: BSD-3-Clause
"""What code finds out about the run on whose thread it is."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import pytest

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_onboard.behaviors.run_context import RunContext, StateServices, current_run
from flexbt_onboard.errors import OnboardError


def context() -> RunContext:
    return RunContext(lambda: None, lambda *_: None)  # type: ignore[arg-type,return-value]


def on_another_thread(function: Callable[[], Any]) -> Any:
    with ThreadPoolExecutor(1) as threads:
        return threads.submit(function).result()


def test_a_run_is_known_on_its_thread_and_only_while_it_lasts() -> None:
    def elsewhere() -> RunContext:
        with context().entered():
            return current_run()

    run = context()
    with run.entered():
        assert on_another_thread(elsewhere) is not run
        assert current_run() is run
    with pytest.raises(OnboardError, match='it has none'):
        current_run()


def test_a_thread_of_users_code_is_of_the_run_if_there_is_one_only() -> None:
    run = context()
    with run.entered():
        assert on_another_thread(current_run) is run
        with context().entered(), pytest.raises(OnboardError, match='it has 2'):
            on_another_thread(current_run)


def test_callbacks_of_the_node_belong_to_the_run_whose_services_it_has_given() -> None:
    with NodeRuntime.open('first') as first, NodeRuntime.open('second') as second:
        runs = [RunContext(partial(StateServices.of, runtime), lambda *_: None) for runtime in (first, second)]
        with runs[0].entered(), runs[1].entered():
            for run, runtime in zip(runs, (first, second), strict=True):
                assert run.services.runtime is runtime
                assert runtime.call(current_run) is run
        for runtime in (first, second):
            with pytest.raises(OnboardError):
                runtime.call(current_run)


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
