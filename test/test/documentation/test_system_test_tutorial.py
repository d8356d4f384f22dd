# SPDX-License-Identifier: BSD-3-Clause
"""The tests of the tutorial "Test your mission", taken from its text, pass."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[3] / 'docs' / 'tutorials' / 'test_your_mission.md'


def test_the_tests_of_the_page_pass(tmp_path: Path) -> None:
    text = PAGE.read_text(encoding='utf-8')
    blocks = re.findall(r'^```python\n(.*?)^```$', text, re.MULTILINE | re.DOTALL)
    assert len(blocks[0].splitlines()) <= 11
    [command] = re.findall(r'^(python3 -m pytest .*)$', text, re.MULTILINE)
    *words, name = command.split()
    (tmp_path / name).write_text('\n\n'.join(blocks), encoding='utf-8')
    (tmp_path / 'pytest.ini').write_text('[pytest]\n')
    ran = subprocess.run(
        [sys.executable, *words[1:], '--mission-coverage', name],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=1200,
    )
    assert ran.returncode == 0, ran.stdout + ran.stderr
    count = (
        sum(int(n) for n in re.findall(r'seeds\((\d+)\)', text)) + text.count('\ndef test_') - text.count('mark.seeds(')
    )
    assert f'{count} passed' in ran.stdout
    assert 'behavior Navigate: transitions ' in ran.stdout
