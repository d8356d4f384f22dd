# SPDX-License-Identifier: BSD-3-Clause
"""Files by name: ``package/relative/path`` in the share directory of an installed package, or an absolute path.

A name may come from another process. So it leads to nothing outside of the share directories and the
directories that were allowed explicitly, not through ``..`` and not through a symbolic link. (A link inside of a
share directory that leads out of it is followed only when it was put there by the installation of the package
itself: colcon's ``--symlink-install`` links single files to their sources.)
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_share_directory,
    get_packages_with_prefixes,
)

from flexbt_common.errors import ResourceError


def resolve_file(name: str, allowed: Sequence[Path] = ()) -> Path:
    """Find the file called ``name``.

    ``allowed`` are the directories in which an absolute path may lie.

    Raises:
        ResourceError: unknown package, no such file, or a place that is not allowed.
    """
    if not name or '\0' in name:
        raise ResourceError(repr(name), 'not a file name; expected package/relative/path or an absolute path')
    if name.startswith('/'):
        return _existing(name, _inside_allowed(name, allowed))
    package, _, relative = name.partition('/')
    if not relative:
        raise ResourceError(name, 'not a file name; expected package/relative/path or an absolute path')
    if '..' in PurePosixPath(relative).parts:
        raise ResourceError(name, "a path inside a package must not contain '..'")
    try:
        share = Path(get_package_share_directory(package))
    except (PackageNotFoundError, ValueError):
        near = difflib.get_close_matches(package, get_packages_with_prefixes(), n=1)
        hint = f'; did you mean {near[0]!r}?' if near else ''
        raise ResourceError(
            name, f'no installed package {package!r}; install it, or source the workspace that has it{hint}'
        ) from None
    path = share / relative
    _refuse_linked_directories(name, share, path)
    return _existing(name, path)


def _inside_allowed(name: str, allowed: Sequence[Path]) -> Path:
    path = Path(os.path.realpath(name))  # Path.resolve would raise where links go round in circles
    if any(path.is_relative_to(directory.resolve()) for directory in allowed):
        return path
    places = ', '.join(str(directory) for directory in allowed) or 'none'
    raise ResourceError(
        name,
        f'lies outside the allowed directories ({places}); '
        "use package/relative/path, or add its directory to the parameter 'allowed_directories'",
    )


def _refuse_linked_directories(name: str, share: Path, path: Path) -> None:
    parent = path.parent
    while parent != share:
        if parent.is_symlink():
            raise ResourceError(name, f'{parent} is a symbolic link to a directory; such paths are not followed')
        parent = parent.parent
    if path.is_symlink() and Path(os.path.realpath(path)).name != path.name:
        raise ResourceError(name, f'is a symbolic link to {os.path.realpath(path)}; such links are not followed')


def _existing(name: str, path: Path) -> Path:
    if path.is_file():
        return path
    near = difflib.get_close_matches(path.name, _names_in(path.parent), n=1)
    hint = f'; did you mean {near[0]!r}?' if near else ''
    what = 'is not a file' if path.exists() else 'no such file'
    raise ResourceError(name, f'{what} ({path}){hint}')


def _names_in(directory: Path) -> list[str]:
    try:
        return [entry.name for entry in directory.iterdir() if entry.is_file()]
    except OSError:
        return []
