# SPDX-License-Identifier: BSD-3-Clause
"""The parameters that a behavior's code declares, so that the operator is offered those that its manifest lacks.

The code is read and not run: a behavior's constructor needs a node, and may do anything.
"""

from __future__ import annotations

import ast
import inspect
import operator
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from types import ModuleType
from typing import Any, Final

from flexbt_flexbe.api import Behavior
from flexbt_onboard.behaviors import BehaviorParameter
from flexbt_onboard.errors import ManifestError


def code_parameters(behavior_class: type[Behavior]) -> list[BehaviorParameter]:
    """The parameters of ``self.add_parameter('name', default)`` in a class and its bases.

    What has another form than this is not found, and can be set all the same. A default is found where it is written
    as a value, as arithmetic on such, or as the name of one in the class or its module; otherwise it counts as text,
    which the code converts.
    """
    found: dict[str, BehaviorParameter] = {}
    for one in behavior_class.__mro__[: behavior_class.__mro__.index(Behavior)]:
        for name, default in _declared(one, behavior_class):
            for offered in (default, ''):
                try:
                    found.setdefault(name, BehaviorParameter(name, offered))
                    break
                except ManifestError:  # no default that an operator could write, or no name
                    continue
    return list(found.values())


def _declared(one: type[Any], behavior_class: type[Any]) -> Iterator[tuple[str, Any]]:
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(one)))
    except (OSError, TypeError, SyntaxError, ValueError):  # made by code, or the file has gone
        return
    defaults = _Defaults(sys.modules.get(one.__module__), behavior_class, tree)
    for node in ast.walk(tree):
        match node:
            case ast.Call(
                func=ast.Attribute(value=ast.Name(id='self'), attr='add_parameter'),
                args=[ast.Constant(value=str(name)), default],
            ):
                yield name, defaults.value(default)


_PLAIN: Final = (bool, int, float, str, list, dict)
_MAKERS: Final[Mapping[str, type[Any]]] = {kind.__name__: kind for kind in _PLAIN}
_ARITHMETIC: Final[Mapping[type[ast.operator], Callable[[Any, Any], Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
}


class _Defaults:
    """Evaluates what is written as the default of a parameter, without calling code of others."""

    def __init__(self, module: ModuleType | None, behavior_class: type[Any], tree: ast.Module) -> None:
        self._module = module
        self._class = behavior_class
        self._assigned = set()  # the code knows what these are when it runs
        for node in ast.walk(tree):
            match node:
                case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                    self._assigned.add(name)
                case ast.Attribute(value=ast.Name(id='self'), attr=name, ctx=ast.Store()):
                    self._assigned.add(f'self.{name}')

    def value(self, default: ast.expr) -> Any:
        """Return the value; None if it is not known."""
        try:
            return ast.literal_eval(default)
        except (ValueError, TypeError, MemoryError, RecursionError):
            pass
        match default:
            case ast.List(elts=parts):
                return _result(lambda *values: [*values], [self.value(part) for part in parts], _PLAIN)
            case ast.Dict(keys=[*keys], values=parts) if None not in keys:
                made = [self.value(part) for part in (*filter(None, keys), *parts)]
                return _result(lambda *both: dict(zip(both, both[len(parts) :], strict=False)), made, _PLAIN)
            case ast.Name(id=name) if name not in self._assigned:
                return inspect.getattr_static(self._module, name, None)
            case ast.Attribute(value=ast.Name(id='self'), attr=name) if f'self.{name}' not in self._assigned:
                return inspect.getattr_static(self._class, name, None)
            case ast.Attribute(value=ast.Name() as owner, attr=name):
                known = self.value(owner)
                return inspect.getattr_static(known, name, None) if isinstance(known, ModuleType | type) else None
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _MAKERS:
                return _result(_MAKERS[name], [self.value(arg) for arg in args], _PLAIN)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _result(operator.neg, [self.value(operand)], (int, float))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return _result(_ARITHMETIC[type(op)], [self.value(left), self.value(right)], (int, float))
        return None


def _result(function: Callable[..., Any], values: list[Any], kinds: tuple[type[Any], ...]) -> Any:
    if not all(type(value) in kinds for value in values):
        return None
    try:
        return function(*values)
    except (TypeError, ValueError, ArithmeticError):
        return None
