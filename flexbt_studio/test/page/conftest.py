# SPDX-License-Identifier: BSD-3-Clause
"""The browser and the text editors of the tests of the page."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from studio_page import StudioPage

from flexbt_studio.server.web_server import editor_folder
from flexbt_testing.browser import started_browser


@pytest.fixture(scope='session')
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with started_browser(tmp_path_factory.mktemp('chromium')) as started:
        yield started


@pytest.fixture(scope='session')
def other_driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with started_browser(tmp_path_factory.mktemp('chromium')) as started:
        yield started


@pytest.fixture
def page(driver: Any) -> Iterator[StudioPage]:
    with _at_studio(driver) as studio:
        yield studio


@pytest.fixture
def other(other_driver: Any) -> Iterator[StudioPage]:
    """Provide a page in another browser."""
    with _at_studio(other_driver) as studio:
        yield studio


@contextlib.contextmanager
def _at_studio(driver: Any) -> Iterator[StudioPage]:
    studio = StudioPage(driver)
    yield studio
    complaints = studio.complaints()
    driver.get('about:blank')
    assert complaints == []


@pytest.fixture(params=['CodeMirror', 'textarea'])
def editor(request: pytest.FixtureRequest) -> Path | None:
    """Folder of CodeMirror, or None for the page's own text field."""
    if request.param == 'textarea':
        return None
    found = editor_folder()
    if found is None:
        pytest.skip('CodeMirror is not installed: studio --get-editor')
    return found
