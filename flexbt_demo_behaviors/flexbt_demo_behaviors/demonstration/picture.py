# SPDX-License-Identifier: BSD-3-Clause
"""The picture of a demonstration: a world, and what its robots have planned and driven."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from PIL import Image

from flexbt_sim.world import Frame, Pose, Trace, World, draw_world

from .robot_track import RobotTrack


def write_picture(world: World, tracks: Mapping[str, RobotTrack], file: Path) -> None:
    """Draw what :func:`draw_tracks` draws and write it as PNG to `file`, whose directory is made when missing."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draw_tracks(world, tracks).quantize(64).save(file, optimize=True)


def draw_tracks(world: World, tracks: Mapping[str, RobotTrack]) -> Image.Image:
    """A world, whose robots are put where they are now, with their tracks by the names of the robots: the ways that
    they have driven, the plans dashed. The time is that since the tracks began.
    """
    trace = Trace(world)
    for name, track in tracks.items():
        shape = world.robots[name].shape
        trace.frames += [
            Frame(time - track.began, {name: (shape, Pose(pose.x, pose.y, pose.yaw))}, {}) for time, pose in track.way
        ]
        if track.pose is not None:
            world.robots[name].place(Pose(track.pose.x, track.pose.y, track.pose.yaw))
    plans = {f'{name}{number}': plan for name, track in tracks.items() for number, plan in enumerate(track.plans)}
    last = max((track.time - track.began for track in tracks.values()), default=0.0)
    return draw_world(world, trace, paths=plans, time=last)
