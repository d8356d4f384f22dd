# SPDX-License-Identifier: BSD-3-Clause
"""These tests run in one process, which the plugin has to prepare before anything is imported (``make test`` does)."""

from __future__ import annotations

import sys
from pathlib import Path

IN_A_WORLD = [file.name for file in Path(__file__).parent.glob('test_*.py') if file.name != 'test_conformance.py']
collect_ignore_glob = [] if 'flexbt_testing.one_process.plugin' in sys.modules else IN_A_WORLD
