# SPDX-License-Identifier: BSD-3-Clause
"""The default context and the global executor of rclpy, one for each process of a world.

``rclpy.init()``, ``rclpy.spin(node)`` and the like use them. They are variables of rclpy's modules, which all processes
of a world share.
"""

from __future__ import annotations

from types import FunctionType, ModuleType
from typing import Any, Final
from weakref import WeakKeyDictionary

from .scheduler import SCHEDULER, Process

_FUNCTIONS: Final = {
    'rclpy.utilities': ('get_default_context', 'try_shutdown'),
    'rclpy': ('get_global_executor',),
}
"""The functions that use these variables."""


def install() -> None:
    """Let each process run these functions with variables of its own."""
    import rclpy
    import rclpy.utilities

    for module in (rclpy, rclpy.utilities):
        if not hasattr(module, '_in_world'):
            _install(module, _FUNCTIONS[module.__name__])


def _install(module: ModuleType, names: tuple[str, ...]) -> None:
    functions = {name: vars(module)[name] for name in names}
    codes = {name: function.__code__ for name, function in functions.items()}
    before = dict(vars(module))
    variables: WeakKeyDictionary[Process, dict[str, Any]] = WeakKeyDictionary()

    def in_world(name: str) -> FunctionType:
        own = variables.setdefault(SCHEDULER.current.process, before.copy())
        made = FunctionType(codes[name], own, name)
        made.__kwdefaults__ = functions[name].__kwdefaults__
        return made

    vars(module)['_in_world'] = in_world
    for name, function in functions.items():
        made: dict[str, Any] = {}
        exec(f'def {name}(*a, **k): return _in_world({name!r})(*a, **k)', made)  # noqa: S102 - of names from above
        function.__code__ = made[name].__code__  # other modules have imported the function itself
