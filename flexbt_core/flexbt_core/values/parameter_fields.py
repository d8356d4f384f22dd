# SPDX-License-Identifier: BSD-3-Clause
"""Dataclass fields that declare node parameters. They are declared where they are used, and also work without ROS."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Any


@dataclasses.dataclass(frozen=True)
class ParameterField:
    """A parameter: its name, its meaning with the unit, its inclusive bounds, and the allowed texts.

    If it ``is_fixed``, its value cannot change during the life of the node, also if the node is managed.
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
    """Return a dataclass field that declares a node parameter with the type of ``default``."""
    meant = ParameterField(name, description, least, most, choices, is_fixed)
    return dataclasses.field(default=default, metadata={'parameter': meant})


def parameters_of(dataclass: Any) -> dict[str, ParameterField]:
    """Return the parameters that a dataclass declares, by field name."""
    return {one.name: one.metadata['parameter'] for one in dataclasses.fields(dataclass) if 'parameter' in one.metadata}
