# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the console's tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest


@pytest.fixture
def executives() -> Iterator[Any]:
    """Start executives in a namespace of their own: ``executives('name', heartbeat=0.25, faults=...)``."""
    from flexbt_common.runtime.node_runtime import NodeRuntime
    from flexbt_testing.nodes.scripted_executive import ScriptedExecutive

    with ExitStack() as stack:

        def start(namespace: str, **options: Any) -> ScriptedExecutive:
            runtime = stack.enter_context(NodeRuntime.open('onboard_executive', namespace=namespace))
            return ScriptedExecutive(runtime, **options)

        yield start


@pytest.fixture(scope='session')
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Yield a browser for all tests: it takes as long to start as a test."""
    from flexbt_testing.browser import started_browser

    with started_browser(tmp_path_factory.mktemp('chromium')) as started:
        yield started


@pytest.fixture
def browser(driver: Any) -> Iterator[Any]:
    """Yield the browser at a page; nothing but a lost server may be in its console."""
    from flexbt_testing.browser import Browser

    page = Browser(driver)
    yield page
    complaints = page.complaints()
    driver.get('about:blank')
    assert complaints == []  # of what the policy has held up, too
