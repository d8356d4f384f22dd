# SPDX-License-Identifier: BSD-3-Clause
"""The battery of a robot, which its motors drain and a charging station fills."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from flexbt_sim.world.devices.device import DeviceFault, Sensor
from flexbt_sim.world.specification import ModelSpecification, key


@dataclass(frozen=True)
class BatteryModel(ModelSpecification):
    """A battery. The robot stops, and its lidar is silent, when it is empty."""

    title: ClassVar[str] = 'battery'

    capacity: float = key('energy when it is full', 20.0, unit='Wh', low=0.001, high=1e6)
    level: float = key('what it has at the start, of 1', 1.0, low=0.0, high=1.0)
    voltage: float = key('nominal voltage', 11.1, unit='V', low=1.0, high=1000.0)
    idle: float = key('power at rest', 5.0, unit='W', low=0.0, high=1e6)
    driving: float = key('power that is added at the greatest speed, and in proportion', 10.0, unit='W', low=0.0,
                         high=1e6)  # fmt: skip
    charging: float = key('power from a charging station', 60.0, unit='W', low=0.0, high=1e6)


@dataclass(frozen=True)
class BatteryLow(DeviceFault):
    """The battery falls to a level at once. It does not come back at the end of the fault."""

    name: ClassVar[str] = 'battery_low'
    needs: ClassVar[str] = 'battery'
    level: float = key('what is left, of 1', 0.1, low=0.0, high=1.0)


class Battery(Sensor):
    """A battery: ``level`` from 0 to 1, whether it is being charged, and the power that it takes in, W."""

    name = 'battery'
    topics = ('battery_state', 'battery_status')
    message = 'sensor_msgs/BatteryState'
    fields = (('', 'current'), ('', 'charge'), ('', 'percentage'), ('', 'power_supply_status'))
    is_prompt = False
    samples = 0
    needs_power = False
    rate = 1.0
    model: BatteryModel

    DISCHARGING: ClassVar[int] = 2
    CHARGING: ClassVar[int] = 1
    FULL: ClassVar[int] = 4
    """Values of ``power_supply_status``."""

    def reset(self) -> None:
        super().reset()
        self.level = self.model.level
        self.is_charging = False
        self.power = 0.0
        self._values = (0.0, 0.0, 0.0, self.DISCHARGING)

    def begin(self, slot: str, fault: DeviceFault) -> None:
        super().begin(slot, fault)
        if isinstance(fault, BatteryLow):
            self.level = fault.level

    def run(self, power: float, duration: float) -> None:
        """Take power, W, for a time, s; charge meanwhile, if it is being charged."""
        gained = (self.model.charging if self.is_charging else 0.0) - power
        level = self.level + gained * duration / (3600.0 * self.model.capacity)
        self.level = min(1.0, max(0.0, level))
        self.power = gained if self.level == level else 0.0  # it is full, or empty

    @property
    def state(self) -> float:
        return self.level

    @property
    def _charge(self) -> float:
        """Charge of a full battery, Ah."""
        return self.model.capacity / self.model.voltage

    def constants(self) -> Mapping[str, Any]:
        return {
            'voltage': self.model.voltage,
            'temperature': math.nan,
            'capacity': self._charge,
            'design_capacity': self._charge,
            'power_supply_health': 1,  # good
            'power_supply_technology': 2,  # lithium ions
            'present': True,
        }

    def measure(self, drawn: object, ranges: object) -> None:
        charging = self.FULL if self.level >= 1.0 else self.CHARGING
        status = charging if self.is_charging else self.DISCHARGING
        self._values = self.power / self.model.voltage, self._charge * self.level, self.level, status

    def values(self) -> tuple[float, float, float, int]:
        return self._values
