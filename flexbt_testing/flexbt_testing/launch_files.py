# SPDX-License-Identifier: BSD-3-Clause
"""Launch files without the packages of launch, which the wheels do not have."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest


class _LaunchConfiguration:
    """An argument of the launch, which a dictionary has."""

    def __init__(self, name: str) -> None:
        self._name = name

    def perform(self, context: dict[str, str]) -> str:
        return context[self._name]


def nodes_of(file: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[dict[str, str]], list[dict[str, Any]]]:
    """Return the function ``nodes`` of a launch file: from the arguments of the launch to those of each node."""
    stand_ins: Any = SimpleNamespace(
        LaunchConfiguration=_LaunchConfiguration,
        LaunchContext=dict,
        LaunchDescription=list,
        DeclareLaunchArgument=dict,
        OpaqueFunction=dict,
        Node=dict,
    )
    for module in ('launch', 'launch.actions', 'launch.substitutions', 'launch_ros', 'launch_ros.actions'):
        monkeypatch.setitem(sys.modules, module, stand_ins)
    nodes: Callable[[dict[str, str]], list[dict[str, Any]]] = runpy.run_path(str(file))['nodes']
    return nodes
