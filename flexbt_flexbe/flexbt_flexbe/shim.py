# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's modules, ``flexbe_core``, ``flexbe_states`` and ``flexbe_testing``, for code that imports them.

They are real packages in a separate directory, which is on Python's path only on request, so that an installed FlexBE
is never shadowed by accident. The modules in them come from a table (:data:`MODULES`): each package
calls :func:`fill` when it is imported, and from then on a finder makes them. In a program::

    from flexbt_flexbe import shim
    shim.install()

or for a whole process: ``PYTHONPATH=$(python3 -m flexbt_flexbe.shim):$PYTHONPATH``. The executive does it by itself
when it finds FlexBE behaviors.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Final

from . import states
from .errors import ShimError

DIRECTORY: Final = Path(__file__).resolve().parent / 'compat'
"""Directory of the packages."""

PACKAGES: Final = ('flexbe_core', 'flexbe_states', 'flexbe_testing')
"""FlexBE's own. Beside them is ``flex_bt_flexbe_states``, which yields to an installed package of that name."""


def install(*, replace: bool = False) -> None:
    """Make FlexBE's modules importable in this process. ``replace`` puts them before an installed FlexBE.

    Raises:
        ShimError: there is a FlexBE, and it is not to be replaced or was imported already.
    """
    for package in PACKAGES:
        there = _location(package)
        if there is None or there.is_relative_to(DIRECTORY):
            continue
        if package in sys.modules:
            raise ShimError(f'{package} of {there} is imported already; install the shim before that')
        if not replace:
            raise ShimError(
                f'{package} is installed in {there}, and its engine is not the one that runs here; '
                f'put {DIRECTORY} first on PYTHONPATH to run its behaviors here'
            )
    path = str(DIRECTORY)
    if replace or path not in sys.path:
        sys.path[:] = [path, *sys.path] if replace else [*sys.path, path]
        importlib.invalidate_caches()


def _location(package: str) -> Path | None:
    """Return the directory that a package is, or would be, imported from."""
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # in sys.modules, from an unknown place
        return Path(package)
    return Path(spec.origin).resolve().parent if spec is not None and spec.origin else None


# The modules

_CORE: Final = ('ConcurrencyContainer', 'EventState', 'OperatableStateMachine', 'PriorityContainer', 'UserData')
_ERRORS: Final = ('StateError', 'StateMachineError', 'UserDataError')
_PROXIES: Final = (
    'ProxyActionClient',
    'ProxyPublisher',
    'ProxyServiceCaller',
    'ProxySubscriberCached',
    'ProxyTransformListener',
)
_OTHERS: Final = ('UserdataState', 'WaitForServersState')
"""States that FlexBE has in a module with another name, or not at all."""

_STATES: Final = {
    'flexbe_states': [name for name in states.__all__ if not name.startswith('Bt') and name not in _OTHERS],
    'flex_bt_flexbe_states': [name for name in states.__all__ if name.startswith('Bt')],
}
TESTER: Final = 'flexbe_testing.py_tester'


def _snake(name: str) -> str:
    return ''.join(f'_{sign.lower()}' if sign.isupper() else sign for sign in name).removeprefix('_')


MODULES: Final[Mapping[str, Mapping[str, str]]] = {
    'flexbe_core': dict.fromkeys(
        ('Autonomy', 'Behavior', *_CORE, 'Logger', 'StateLogger', 'initialize_flexbe_core', 'set_node'), 'flexbt_flexbe'
    ),
    'flexbe_core.behavior': {'Behavior': 'flexbt_flexbe'},
    'flexbe_core.logger': {'Logger': 'flexbt_flexbe'},
    'flexbe_core.state_logger': {'StateLogger': 'flexbt_flexbe'},
    'flexbe_core.core': {
        **dict.fromkeys(_CORE, 'flexbt_flexbe'),
        **dict.fromkeys(_ERRORS, 'flexbt_core'),
        'RosState': 'flexbt_flexbe:EventState',
    },
    **{f'flexbe_core.core.{_snake(name)}': {name: 'flexbt_flexbe'} for name in _CORE},
    'flexbe_core.core.exceptions': dict.fromkeys(_ERRORS, 'flexbt_core'),
    'flexbe_core.core.ros_state': {'RosState': 'flexbt_flexbe:EventState'},
    'flexbe_core.proxy': dict.fromkeys((*_PROXIES, 'initialize_proxies', 'shutdown_proxies'), 'flexbt_flexbe'),
    **{f'flexbe_core.proxy.{_snake(name)}': {name: 'flexbt_flexbe'} for name in _PROXIES},
    'flexbe_core.proxy.qos': {
        **dict.fromkeys(('QOS_DEFAULT', 'QOS_LATCH', 'QOS_LOSSY'), 'flexbt_flexbe'),
        **dict.fromkeys(('QoSDurabilityPolicy', 'QoSProfile', 'QoSReliabilityPolicy'), 'rclpy.qos'),
    },
    'flexbe_states': {},
    'flex_bt_flexbe_states': {},
    'flexbe_testing': {},
    **{
        f'{package}.{_snake(name)}': {name: 'flexbt_flexbe.states'}
        for package, names in _STATES.items()
        for name in names
    },
    'flexbe_states.user_data_state': {'UserdataState': 'flexbt_flexbe.states'},
    TESTER: {'PyTester': 'flexbt_testing.flexbe'},
}
"""By module: its names, and the module that each is taken from, with ``:`` and the name there where that is another."""


def fill(package: str) -> None:
    """Give a package that is being imported its names, and have the modules below it found from now on."""
    if _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)
    _FINDER.packages.add(package)
    _give_names(sys.modules[package])


class _Finder(MetaPathFinder, Loader):
    """A finder of the modules below ``packages``, which are ours: installed packages of these names have their own."""

    def __init__(self) -> None:
        self.packages: set[str] = set()

    def find_spec(
        self, fullname: str, _path: Sequence[str] | None, _target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """See :class:`importlib.abc.MetaPathFinder`."""
        package, _, below = fullname.partition('.')
        if not below or package not in self.packages or fullname not in MODULES:
            return None
        is_package = any(name.startswith(f'{fullname}.') for name in MODULES)
        return ModuleSpec(fullname, self, origin=__file__, is_package=is_package)

    def exec_module(self, module: ModuleType) -> None:
        """See :class:`importlib.abc.Loader`."""
        module.__doc__ = f"FlexBE's ``{module.__name__}``."
        _give_names(module)


_FINDER: Final = _Finder()


def _give_names(module: ModuleType) -> None:
    names = MODULES[module.__name__]
    for name, source in names.items():
        where, _, other = source.partition(':')
        try:
            setattr(module, name, getattr(importlib.import_module(where), other or name))
        except ModuleNotFoundError as error:
            if module.__name__ != TESTER:
                raise
            # No other module of a package that a robot has imports flexbt_testing.
            raise ShimError(
                f'{TESTER} needs the package flexbt_testing, and there is no module {error.name!r}; '
                'install flexbt_testing where tests are run'
            ) from None
    module.__all__ = list(names)  # type: ignore[attr-defined]


if __name__ == '__main__':
    print(DIRECTORY)
