# SPDX-License-Identifier: BSD-3-Clause
"""The parameters that a behavior's code declares, so that the operator is offered those that its manifest lacks.

The code is read and not run: a behavior's constructor needs a node, and may do anything.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Iterator
from typing import Any

from flexbt_flexbe.api import Behavior
from flexbt_onboard.behaviors import BehaviorParameter
from flexbt_onboard.errors import ManifestError


def code_parameters(behavior_class: type[Behavior]) -> list[BehaviorParameter]:
    """The parameters of ``self.add_parameter('name', default)`` in a class and its bases.

    What has another form than this is not found, and can be set all the same. A default that is no bool, number or
    text counts as text, which the code converts.
    """
    found: dict[str, BehaviorParameter] = {}
    for one in behavior_class.__mro__[: behavior_class.__mro__.index(Behavior)]:
        for name, default in _declared(one):
            try:
                found.setdefault(name, BehaviorParameter(name, default))
            except ManifestError:  # no name that could be written
                continue
    return list(found.values())


def _declared(one: type[Any]) -> Iterator[tuple[str, Any]]:
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(one)))
    except (OSError, TypeError, SyntaxError, ValueError):  # made by code, or the file has gone
        return
    for node in ast.walk(tree):
        match node:
            case ast.Call(
                func=ast.Attribute(value=ast.Name(id='self'), attr='add_parameter'),
                args=[ast.Constant(value=str(name)), default],
            ):
                yield name, _value(default)


def _value(default: ast.expr) -> Any:
    try:
        value = ast.literal_eval(default)
    except ValueError:
        return ''
    return value if isinstance(value, bool | int | float | str) else ''
