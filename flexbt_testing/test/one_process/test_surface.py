# SPDX-License-Identifier: BSD-3-Clause
"""What stands in for rclpy's compiled module has its classes, methods and functions."""

from __future__ import annotations

import inspect
import re
import sys
from typing import Any

import pytest

from flexbt_testing.one_process.graph import MODULE, REAL

STAND_IN = sys.modules[MODULE]
LEFT_OUT = {'EventsExecutor'}  # an executor in C++, for which one in Python stands in
CLASSES = sorted(
    name
    for name, real in vars(REAL).items()
    if isinstance(real, type) and getattr(STAND_IN, name) is not real and name not in LEFT_OUT
)


def public(kind: Any) -> set[str]:
    return {name for name in dir(kind) if not name.startswith('_')}


def test_every_name_is_there() -> None:
    assert {name for name in vars(REAL) if not name.startswith('__')} <= set(vars(STAND_IN))


@pytest.mark.parametrize('name', CLASSES)
def test_every_member_is_there(name: str) -> None:
    stand_in = getattr(STAND_IN, name)
    members = [member for base in stand_in.__mro__ for member in vars(base).values()]
    made = {word for member in members for word in getattr(getattr(member, '__code__', None), 'co_names', ())}
    declared = {*stand_in.__annotations__, *getattr(stand_in, '__slots__', ())}
    assert public(getattr(REAL, name)) - public(stand_in) - declared - made == set()


@pytest.mark.parametrize('name', CLASSES)
def test_it_is_made_of_as_many_arguments(name: str) -> None:
    made = re.match(r'__init__\(self: [\w.]+(.*)\) -> None', getattr(REAL, name).__init__.__doc__)
    if made is not None:  # by rclpy
        inspect.signature(getattr(STAND_IN, name)).bind(*re.findall(r', (\w+): ', made[1]))


def test_what_makes_or_uses_endpoints_is_replaced() -> None:
    """Functions of the real module that get a stand-in would fail in C++."""
    kept = {name for name, real in vars(REAL).items() if callable(real) and vars(STAND_IN)[name] is real}
    assert not [name for name in kept if 'rclpy::Node' in (getattr(REAL, name).__doc__ or '')]
