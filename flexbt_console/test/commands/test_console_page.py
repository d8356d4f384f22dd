# SPDX-License-Identifier: BSD-3-Clause
"""The page of the commands is what the registry says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[3] / 'docs'


def test_the_page_is_up_to_date(tmp_path: Path) -> None:
    subprocess.run([sys.executable, DOCS / 'tools' / 'make_console.py', tmp_path / 'page.md'], check=True)
    page = (DOCS / 'reference' / 'console.md').read_text(encoding='utf-8')
    assert page == (tmp_path / 'page.md').read_text(encoding='utf-8'), 'run docs/tools/make_console.py'
