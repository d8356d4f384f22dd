# SPDX-License-Identifier: BSD-3-Clause
"""Poses in any frame, brought to the map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from flexbt_common.runtime import NodeRuntime
from flexbt_common.transforms import TRANSFORM_TIMEOUT, TransformListener
from flexbt_sim.errors import NavigationError
from flexbt_sim.world import Pose

from .request_checks import finite_pose


def poses_in_map(
    runtime: NodeRuntime,
    stamped: Sequence[Any],
    map_frame: str,
    code: str,
    on_poses: Callable[[list[Pose]], None],
    on_error: Callable[[Exception], None],
    timeout: float = TRANSFORM_TIMEOUT,
) -> None:
    """Give geometry_msgs/PoseStamped in the frame of the map: at once, or when their transforms are known, which
    ``timeout`` seconds of wall time are waited for.

    ``on_error`` instead, with NavigationError: TF_ERROR when no transform is known, ``code`` for what is no place. An
    empty frame counts as that of the map.
    """
    known: dict[int, Pose] = {}
    failed: list[Exception] = []

    def fail(error: Exception) -> None:
        if not failed:
            failed.append(error)
            on_error(error)

    def take(index: int, message: Any) -> None:
        try:
            known[index] = finite_pose(message.pose, 'the pose', code)
        except NavigationError as error:
            fail(error)
        if len(known) == len(stamped) and not failed:
            on_poses([known[index] for index in range(len(stamped))])

    for index, message in enumerate(stamped):
        if message.header.frame_id in ('', map_frame):
            take(index, message)
        else:
            TransformListener.of(runtime).transform_pose(
                message,
                map_frame,
                lambda there, index=index: take(index, there),  # type: ignore[misc]
                lambda error: fail(NavigationError('TF_ERROR', str(error))),
                timeout,
            )
    if not stamped:
        on_poses([])
