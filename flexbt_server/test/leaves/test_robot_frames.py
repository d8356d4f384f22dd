# SPDX-License-Identifier: BSD-3-Clause
"""Frames of the robot, for trees that ask for them at the same time."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Header

from flexbt_common.errors import TransformError
from flexbt_common.transform_listener import TransformListener
from flexbt_server.leaves.leaf_services import RobotFrames


def test_trees_wait_for_different_frames_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(
        _pose: Any, _frame: str, _known: object, tell: Callable[[TransformError], object], _time: float
    ) -> None:
        tell(TransformError('nothing is known'))

    monkeypatch.setattr(TransformListener, 'of', lambda _runtime: SimpleNamespace(transform_pose=unknown))
    runtime: Any = SimpleNamespace(steady=SimpleNamespace(now=time.monotonic), post=lambda fn: fn())
    frames = RobotFrames(runtime, SimpleNamespace(), 'map', 'base_link')  # type: ignore[arg-type]

    def ask(tree: int) -> None:
        for number in range(2000):
            with suppress(TransformError):
                frames.pose_in(PoseStamped(header=Header(frame_id=f'{tree} {number}')), 'map')

    before = sys.getswitchinterval()
    try:
        sys.setswitchinterval(1e-6)
        with ThreadPoolExecutor(4) as trees:
            list(trees.map(ask, range(4)))
    finally:
        sys.setswitchinterval(before)
