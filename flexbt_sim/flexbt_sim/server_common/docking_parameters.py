# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the docking server, with Nav2's names."""

from __future__ import annotations

from dataclasses import dataclass, replace

from flexbt_common.errors import UnfitParameterError
from flexbt_common.runtime import ParameterDeclarer
from flexbt_sim.docking import FARTHEST_STAGING, DockingLimits


@dataclass(frozen=True)
class DockingParameters:
    """Values of the parameters; see :func:`declare_docking_parameters` for meaning and unit."""

    database: str
    charging_types: tuple[str, ...]
    other_types: tuple[str, ...]
    uses_detection: bool
    detection_seconds: float
    limits: DockingLimits


def declare_docking_parameters(declare: ParameterDeclarer, turning_radius: float) -> DockingParameters:
    """Declare the parameters and read them. ``turning_radius`` is that of the robot, m, 0 for none.

    Raises:
        UnfitParameterError: a value that cannot work.
    """
    limits = DockingLimits.of(turning_radius)
    docking = DockingParameters(
        database=declare.text(
            'dock_database',
            '',
            'YAML file with docks:, or a world file, whose stations are docks; none if empty',
        ),
        charging_types=declare.texts(
            'charging_docks', ['simple_charging_dock'], 'types of docks that charge; the first one is that of stations'
        ),
        other_types=declare.texts(
            'non_charging_docks', ['simple_non_charging_dock'], 'types of docks without a charge'
        ),
        uses_detection=declare.flag(
            'use_external_detection_pose', False, 'whether docks are where detected_dock_pose says, not the database'
        ),
        detection_seconds=declare.real(
            'external_detection_timeout', 1.0, 0.01, 60.0, 'for how long a detected pose counts, s'
        ),
        limits=replace(
            limits,
            staging_offset=declare.real(
                'staging_x_offset', limits.staging_offset, FARTHEST_STAGING, 0.0, 'from a dock to its staging pose, m'
            ),
            staging_yaw_offset=declare.real('staging_yaw_offset', 0.0, -3.2, 3.2, 'the same for the heading, rad'),
            docked_within=declare.real(
                'docking_threshold', limits.docked_within, 0.005, 1.0, 'how near to its dock the robot is docked, m'
            ),
            prestaging_tolerance=declare.real(
                'dock_prestaging_tolerance',
                limits.prestaging_tolerance,
                0.0,
                10.0,
                'so near to the staging pose nothing is driven to get there, m and rad',
            ),
            perception_seconds=declare.real(
                'initial_perception_timeout', limits.perception_seconds, 0.1, 100.0, 'how long a dock is looked for, s'
            ),
            approach_seconds=declare.real(
                'dock_approach_timeout', limits.approach_seconds, 0.1, 1000.0, 'how long an approach may take, s'
            ),
            charge_seconds=declare.real(
                'wait_charge_timeout', limits.charge_seconds, 0.1, 1000.0, 'how long a charge is waited for, s'
            ),
            retries=declare.integer('max_retries', limits.retries, 0, 100, 'how often docking is tried again'),
            linear_tolerance=declare.real(
                'undock_linear_tolerance',
                limits.linear_tolerance,
                0.01,
                1.0,
                'how near to it a staging pose is reached, m',
            ),
            angular_tolerance=declare.real(
                'undock_angular_tolerance', limits.angular_tolerance, 0.01, 3.2, 'the same for the heading, rad'
            ),
            projection_seconds=declare.real(
                'dock_projection_time',
                limits.projection_seconds,
                0.0,
                30.0,
                'how far ahead obstacles count, s',
            ),
            collision_threshold=declare.real(
                'dock_collision_threshold',
                limits.collision_threshold,
                0.0,
                10.0,
                'so near to a dock nothing counts as an obstacle, m',
            ),
        ),
    )
    if turning_radius and docking.limits.staging_yaw_offset:
        raise UnfitParameterError(
            'staging_yaw_offset',
            f'{docking.limits.staging_yaw_offset:g} rad: a robot with a minimum_turning_radius ({turning_radius:g} m) '
            'cannot turn on the spot at the staging pose; give 0',
        )
    return docking
