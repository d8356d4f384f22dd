# SPDX-License-Identifier: BSD-3-Clause
"""Declaring the parameters of a node, with description and bounds, so that what cannot work is refused clearly."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from flexbt_sim.errors import SimulationError


class ParameterDeclarer:
    """Declares parameters on a node, each with its default, and gives their values.

    Every method raises SimulationError for a value of another type or out of bounds. Parameters are read-only, unless
    said otherwise.
    """

    def __init__(self, node: Node) -> None:
        self._node = node

    def real(
        self, name: str, default: float, least: float, most: float, description: str, read_only: bool = True
    ) -> float:
        """A number within bounds, both included."""
        bounds = [FloatingPointRange(from_value=least, to_value=most)]
        return float(self._declare(name, default, description, read_only, floating_point_range=bounds))

    def whole(self, name: str, default: int, least: int, most: int, description: str) -> int:
        """A whole number within bounds, both included."""
        bounds = [IntegerRange(from_value=least, to_value=most)]
        return int(self._declare(name, default, description, integer_range=bounds))

    def reals(self, name: str, default: list[float], description: str) -> list[float]:
        """Any number of numbers."""
        return [float(value) for value in self._declare(name, default, description)]

    def text(self, name: str, default: str, description: str) -> str:
        """A string."""
        return str(self._declare(name, default, description))

    def texts(self, name: str, default: list[str], description: str) -> tuple[str, ...]:
        """Strings; empty ones are left out, since a list in YAML cannot be empty."""
        return tuple(text for text in self._declare(name, default, description) if text)

    def flag(self, name: str, default: bool, description: str) -> bool:
        """True or false."""
        return bool(self._declare(name, default, description))

    def _declare(self, name: str, default: Any, description: str, read_only: bool = True, **bounds: Any) -> Any:
        descriptor = ParameterDescriptor(description=description, read_only=read_only, **bounds)
        try:
            return self._node.declare_parameter(name, default, descriptor).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            # The text ends with the name once more.
            reason = str(error).removesuffix(f': {name}')
            raise SimulationError(f'parameter {name!r}: {reason}; the default is {default!r}') from error
