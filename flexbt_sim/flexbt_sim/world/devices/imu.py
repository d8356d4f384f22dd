# SPDX-License-Identifier: BSD-3-Clause
"""The inertial measurement unit: how fast the robot turns, and its acceleration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from numpy.typing import NDArray

from flexbt_sim.world.devices.device import Sensor
from flexbt_sim.world.plane.geometry import ORIGIN, Pose
from flexbt_sim.world.specification import ModelSpecification, key

GRAVITY: Final = 9.80665
"""Acceleration upwards that an IMU at rest measures, m/s² (REP 145)."""


@dataclass(frozen=True)
class ImuModel(ModelSpecification):
    """An inertial measurement unit: a gyroscope and an accelerometer, without an estimate of the orientation. It
    measures the motion over ground, which slipping or stuck wheels do not."""

    title: ClassVar[str] = 'imu'

    angular_noise: float = key('standard deviation of the angular velocity', 0.01, unit='rad/s', low=0.0, high=10.0)
    angular_bias: float = key('constant error of the angular velocity', 0.0, unit='rad/s', low=-1.0, high=1.0)
    linear_noise: float = key('standard deviation of each acceleration', 0.02, unit='m/s²', low=0.0, high=100.0)
    rate: float = key('readings per second', 50.0, unit='Hz', low=0.01, high=1000.0)
    pose: Pose = key('where it is on the robot', ORIGIN)


class Imu(Sensor):
    """The IMU of a robot. Its last reading: ``angular_velocity``, rad/s, ``acceleration``, m/s² along its x and y."""

    name = 'imu'
    topics = ('imu',)
    message = 'sensor_msgs/Imu'
    frame = 'imu_link'
    fields = (('d', 'angular_velocity.z'), ('d', 'linear_acceleration.x'), ('d', 'linear_acceleration.y'))
    samples = 3
    model: ImuModel

    def reset(self) -> None:
        super().reset()
        self.angular_velocity, self.acceleration = 0.0, (0.0, 0.0)
        self._twist = self._change = (0.0, 0.0)
        self._since = -math.inf

    @property
    def pose(self) -> Pose:
        return self.model.pose

    def comes_due(self, now: float) -> bool:
        """See how fast the speeds have changed since the last reading was due, whether anybody reads it or not."""
        if now + 1e-9 >= self.due:
            duration, (linear, angular), (was_linear, was_angular) = now - self._since, self.robot.twist, self._twist
            if duration > 0.0:
                self._change = (linear - was_linear) / duration, (angular - was_angular) / duration
            self._since, self._twist = now, (linear, angular)
        return super().comes_due(now)

    def measure(self, drawn: NDArray[Any], ranges: object) -> None:
        model, pose = self.model, self.model.pose
        (linear, angular), (change, angular_change) = self.robot.twist, self._change
        ahead = change - angular_change * pose.y - angular**2 * pose.x
        left = linear * angular + angular_change * pose.x - angular**2 * pose.y
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        turn, x, y = (self.noise_factor * drawn).tolist()
        self.angular_velocity = angular + model.angular_bias + model.angular_noise * turn
        self.acceleration = (
            ahead * cos + left * sin + model.linear_noise * x,
            left * cos - ahead * sin + model.linear_noise * y,
        )

    def constants(self) -> Mapping[str, Any]:
        return {
            'orientation_covariance': [-1.0] + [0.0] * 8,  # it has no orientation
            'linear_acceleration.z': GRAVITY,
            'angular_velocity_covariance': _diagonal(self.model.angular_noise**2),
            'linear_acceleration_covariance': _diagonal(self.model.linear_noise**2),
        }

    def values(self) -> tuple[float, float, float]:
        return self.angular_velocity, *self.acceleration


def _diagonal(variance: float) -> list[float]:
    return [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance]
