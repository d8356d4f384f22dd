# SPDX-License-Identifier: BSD-3-Clause
"""Fields of dataclasses that are parameters of nodes, declared where their values are used, also without ROS."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Any


@dataclasses.dataclass(frozen=True)
class ParameterField:
    """A parameter: its name, its meaning with the unit, its bounds, both included, and the texts that it may have.

    One that ``is_fixed`` keeps its value for the life of the node, also if the node is managed.
    """

    name: str
    description: str
    least: Any = None
    most: Any = None
    choices: Collection[str] = ()
    is_fixed: bool = False


def parameter(
    name: str,
    default: Any,
    description: str,
    least: Any = None,
    most: Any = None,
    *,
    choices: Collection[str] = (),
    is_fixed: bool = False,
) -> Any:
    """Return a field of a dataclass that is a parameter of a node, whose type is that of the default."""
    meant = ParameterField(name, description, least, most, choices, is_fixed)
    return dataclasses.field(default=default, metadata={'parameter': meant})


def parameters_of(dataclass: Any) -> dict[str, ParameterField]:
    """Return the fields of a dataclass that are parameters, by their names in the dataclass."""
    return {one.name: one.metadata['parameter'] for one in dataclasses.fields(dataclass) if 'parameter' in one.metadata}
