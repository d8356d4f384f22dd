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


@pytest.fixture(scope='module')
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Yield a browser for the tests of a module."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service
    from web_browser import CHROMIUM, DRIVER, FLAGS

    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in FLAGS.split():
        options.add_argument(f'--{flag}')
    options.add_argument(f'--user-data-dir={tmp_path_factory.mktemp("chromium")}')
    options.set_capability('goog:loggingPrefs', {'browser': 'ALL'})
    started = webdriver.Chrome(options=options, service=Service(str(DRIVER)))
    try:
        yield started
    finally:
        started.quit()


@pytest.fixture
def browser(driver: Any) -> Iterator[Any]:
    """Yield the browser at a page; nothing but a lost server may be in its console."""
    from web_browser import Browser

    yield Browser(driver)
    complaints = [one['message'] for one in driver.get_log('browser') if one['level'] == 'SEVERE']
    driver.get('about:blank')
    # What is expected: a server that is lost, and nothing that the policy has held up.
    assert [text for text in complaints if 'ERR_CONNECTION' not in text and 'WebSocket' not in text] == []
