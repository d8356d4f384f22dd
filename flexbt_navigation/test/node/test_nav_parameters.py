# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of navigation: those of the robot of a world file; and wrong ones, told with their name."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexbt_common.errors import UnfitParameterError
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_navigation.parameters import declare_navigation_parameters


@pytest.mark.parametrize(
    'footprint',
    [
        '[[0.2, 0.2], [NaN, 0.1], [-0.2, 0.0]]',
        '[[0.2, 0.2], [Infinity, 0.1], [-0.2, 0.0]]',
        f'[[0.2, 0.2], [1{"0" * 400}, 0.1], [-0.2, 0.0]]',
        '[' * 100_000,
        '[[1, 2, 3]]',
        '{"a": 1}',
        'x' * 100_000,
    ],
    ids=['nan', 'infinity', 'huge', 'nested', 'shape', 'object', 'long'],
)
def test_a_footprint_that_is_none_is_refused_by_its_name(footprint: str) -> None:
    with NodeRuntime.open('navigation', parameters={'footprint': footprint}) as runtime:
        with pytest.raises(UnfitParameterError, match="parameter 'footprint'") as refused:
            runtime.call(lambda: declare_navigation_parameters(runtime.node))
        assert len(str(refused.value)) < 500


def test_what_is_known_of_the_robot_of_a_world_file_is_the_default(tmp_path: Path) -> None:
    """Its lidar is noisier than others: walls would be seen before those of the map, and hold it up."""
    world = tmp_path / 'yard.yaml'
    world.write_text('{plan: {rooms: [{from: [0, 0], to: [30, 20]}]}, robots: {robot: {model: car, pose: [9, 9, 0]}}}')
    with NodeRuntime.open('navigation', parameters={'world': str(world)}) as runtime:
        given = runtime.call(lambda: declare_navigation_parameters(runtime.node))
    assert given.costmaps.tolerance == pytest.approx(0.15)
    assert given.controller.follower.turning_radius == 5.0
    assert len(given.costmaps.inflation.corners) == 4
