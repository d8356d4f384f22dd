# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's modules, ``flexbe_core``, ``flexbe_states`` and ``flexbe_testing``, for code that imports them.

They are real packages in a directory of their own, which is on Python's path only when somebody asks for that, so that
an installed FlexBE is never shadowed by accident. In a program::

    from flexbt_flexbe import shim
    shim.install()

or for a whole process: ``PYTHONPATH=$(python3 -m flexbt_flexbe.shim):$PYTHONPATH``. The executive does it by itself
when it finds FlexBE behaviors.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from typing import Final

from .errors import ShimError

DIRECTORY: Final = Path(__file__).resolve().parent / 'compat'
"""Where the packages are."""

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
    """The directory that a package is, or would be, imported from."""
    try:
        spec = importlib.util.find_spec(package)
    except ValueError:  # in sys.modules, and nobody knows from where
        return Path(package)
    return Path(spec.origin).resolve().parent if spec is not None and spec.origin else None


if __name__ == '__main__':
    print(DIRECTORY)
