# SPDX-License-Identifier: BSD-3-Clause
"""Loops as they are where numba is not installed."""

from __future__ import annotations

from types import ModuleType

import pytest

from flexbt_sim.world.plane.loops import Loop


def interpret(monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> None:
    """Have the loops of a module interpreted."""
    for one in vars(module).values():
        if isinstance(one, Loop):
            monkeypatch.setattr(one, 'compiled', None)
