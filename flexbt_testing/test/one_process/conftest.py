# SPDX-License-Identifier: BSD-3-Clause
"""These tests run in one process, which the plugin has to prepare before anything is imported (``make test`` does)."""

from __future__ import annotations

import sys

IN_A_WORLD = ['test_world.py', 'test_scheduler.py', 'test_surface.py', 'test_nemesis.py', 'test_what_if.py']
collect_ignore_glob = [] if 'flexbt_testing.one_process.plugin' in sys.modules else IN_A_WORLD
