# SPDX-License-Identifier: BSD-3-Clause
"""The picture of a demonstration: what was planned and driven, when, and where the robot is."""

from pathlib import Path

import numpy as np
from PIL import Image

from flexbt_demo_behaviors.demonstration.report import RobotTrack, draw_tracks, write_picture
from flexbt_demo_behaviors.demonstration.scripted_operator import SimulatedBox
from flexbt_sim.world import OccupancyMap, Pose, RobotModel, World


def world() -> World:
    """Return a room of 8 by 4 m with a robot, and a box where the robot will be, once it has been taken away."""
    made = World(OccupancyMap(np.zeros((40, 80), np.int8), 0.1, Pose(-4.0, -2.0, 0.0)))
    made.add('robot', RobotModel(), Pose(-3.0, 0.0, 0.0))
    made.add('crate', SimulatedBox(3.0, 0.0, 0.5, 0.5).model)
    return made


def track(metres: float) -> RobotTrack:
    made = RobotTrack()
    for step in range(round(metres * 10.0) + 1):
        made.add_pose(Pose(-3.0 + 0.1 * step, 0.0, 0.0), 100.0 + step)
    return made


def changed(one: Image.Image, other: Image.Image, columns: slice) -> int:
    """Return how many pixels of some columns are of another colour."""
    return int((np.asarray(one)[80:, columns] != np.asarray(other)[80:, columns]).any(axis=2).sum())


def test_the_way_and_the_robot_are_where_they_were() -> None:
    at_rest, driven = draw_tracks(world(), {'robot': track(0.0)}), draw_tracks(world(), {'robot': track(6.0)})
    assert at_rest.size == driven.size == (900, 450)
    assert changed(at_rest, driven, slice(300, 600)) > 300  # the way through the middle
    assert changed(at_rest, driven, slice(760, 820)) > 300  # the robot, where the box was
    assert draw_tracks(world(), {'robot': track(3.0)}).tobytes() != driven.tobytes()


def test_plans_are_drawn_and_the_time_is_that_since_the_track_began() -> None:
    planned, late = track(1.0), RobotTrack()
    planned.add_plan([(-2.0, 1.0), (3.0, 1.0)])
    for time, pose in track(1.0).way:
        late.add_pose(pose, time + 500.0)
    plain = draw_tracks(world(), {'robot': track(1.0)})
    assert changed(plain, draw_tracks(world(), {'robot': planned}), slice(400, 700)) > 300
    assert draw_tracks(world(), {'robot': late}).tobytes() == plain.tobytes()
    corner = np.asarray(plain)[:30, :90]
    assert (corner != np.asarray(draw_tracks(world(), {'robot': track(2.0)}))[:30, :90]).any()  # another time


def test_it_is_written_as_a_small_png(tmp_path: Path) -> None:
    file = tmp_path / 'new' / 'demo.png'
    write_picture(world(), {'robot': track(6.0)}, file)
    with Image.open(file) as image:
        assert image.format == 'PNG'
    assert file.stat().st_size < 60_000
