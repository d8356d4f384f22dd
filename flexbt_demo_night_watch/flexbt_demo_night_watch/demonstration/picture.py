# SPDX-License-Identifier: BSD-3-Clause
"""The picture of a watch: the building, and where the robots have driven."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from PIL import Image

from flexbt_demo_behaviors.demonstration import RobotTrack
from flexbt_sim.world import Frame, Pose, Trace, World, draw_world

from .watch_processes import config_file, place_poses


def write_picture(tracks: Mapping[str, RobotTrack], file: Path) -> None:
    """Draw the building with the ways of the robots and write it as PNG to `file`, whose directory is made."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draw_watch(tracks).quantize(64).save(file, optimize=True)


def draw_watch(tracks: Mapping[str, RobotTrack]) -> Image.Image:
    """The building with its places, and the robots where they are, with the ways that they have driven."""
    world = World.load(config_file('building.yaml'))
    world.places = {name: Pose(place.x, place.y, place.yaw) for name, place in place_poses().items()}
    trace = Trace(world)
    for name, track in tracks.items():
        shape = world.robots[name].shape
        trace.frames += [Frame(0.0, {name: (shape, Pose(x, y, 0.0))}, {}) for x, y in track.driven]
        if track.pose is not None:
            world.move(name, Pose(track.pose.x, track.pose.y, track.pose.yaw))
    return draw_world(world, trace)
