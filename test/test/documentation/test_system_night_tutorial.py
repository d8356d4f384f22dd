# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the tutorial "A night of missions", taken from its text: what it tells happens."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[3] / 'docs' / 'tools'


def test_the_night_goes_as_the_page_tells(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(TOOLS)
    spec = importlib.util.spec_from_file_location('make_night_of_missions', TOOLS / 'make_night_of_missions.py')
    assert spec is not None and spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, tool)
    spec.loader.exec_module(tool)
    night = tool.Night(tmp_path)
    try:
        said = dict(night.steps())
    finally:
        night.close()
    assert len(said) >= 25, 'each command of the page'
    asked = said['tail -f calls.log']
    assert '1 again  2 skip' in asked and f'http://127.0.0.1:{night.port}/?robot=/&decision=' in asked
    evening = said['console queue']
    assert all(f'room={room}' in evening for room in ('kitchen', 'archive', 'office')) and 'HELD' in evening
    facts = [json.loads((one / 'incident.json').read_text()) for one in night.incidents()]
    assert 'fault' in {found['kind'] for one in facts for found in one['occurrences']}, facts
    (latest,) = [text for line, text in said.items() if line.startswith('console incidents latest')]
    assert any(str(one) in latest for one in night.incidents()), 'a busy robot may have had another one since'
    (runs,) = [text for line, text in said.items() if line.startswith('run_report --list')]
    assert runs.count('Check Room') == 3 and runs.count('finished') == 2 and runs.count('failed') == 1, runs
