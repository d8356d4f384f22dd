# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's modules ``flexbe_core``, ``flexbe_states`` and ``flexbe_testing``, for code that imports them.

They are real packages in a separate directory. It is on Python's path only on request, so that it never shadows an
installed FlexBE by accident. Their modules come from a table (:data:`MODULES`): on import each package calls
:func:`fill`, which adds a finder that makes them. In a program::

    from flexbt_flexbe import shim
    shim.install()

or for a whole process: ``PYTHONPATH=$(python3 -m flexbt_flexbe.shim):$PYTHONPATH``. The executive installs it
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
"""FlexBE's own packages. ``flex_bt_flexbe_states`` is provided too, unless a package of that name is installed."""


def install(*, replace: bool = False) -> None:
    """Make FlexBE's modules importable in this process. ``replace`` puts them before an installed FlexBE.

    Raises:
        ShimError: a FlexBE is installed and ``replace`` is false, or it was imported already.
    """
    for package in PACKAGES:
        found = _location(package)
        if found is None or found.is_relative_to(DIRECTORY):
            continue
        if package in sys.modules:
            raise ShimError(f'{package} of {found} is imported already; install the shim before that')
        if not replace:
            raise ShimError(
                f'{package} is installed in {found}, and its engine is not the one that runs here; '
                f'put {DIRECTORY} first on PYTHONPATH to run its behaviors here'
            )
    path = str(Path(__file__).absolute().parent / DIRECTORY.name)  # as packages are found, also through a link
    if replace or path not in sys.path:
        sys.path[:] = [path, *sys.path] if replace else [*sys.path, path]
        importlib.invalidate_caches()


def _location(package: str) -> Path | None:
    """Return the directory from which a package is, or would be, imported."""
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # in sys.modules, without a known location
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
"""States that FlexBE lacks, or has in a module with another name."""

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
"""The names in each module, with their source modules; ``:NAME`` follows the module if the name there differs."""


def fill(package: str) -> None:
    """Add its names to a package that is being imported, and make the modules below it importable."""
    if _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)
    _FINDER.packages.add(package)
    _give_names(sys.modules[package])


class _Finder(MetaPathFinder, Loader):
    """A finder of the modules below our ``packages``; installed packages of these names have their own modules."""

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
            # A robot may lack flexbt_testing, which only this module imports.
            raise ShimError(
                f'{TESTER} needs the package flexbt_testing, and there is no module {error.name!r}; '
                'install flexbt_testing where tests are run'
            ) from None
    module.__all__ = list(names)  # type: ignore[attr-defined]


if __name__ == '__main__':
    print(DIRECTORY)
