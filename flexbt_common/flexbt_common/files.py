# SPDX-License-Identifier: BSD-3-Clause
"""Files by name: ``package/relative/path`` in the share directory of an installed package, absolute paths, and files
of the user.

An absolute path in the share directory of a package is equivalent to its name there.

A name may come from another process. So it must not lead outside the share directories and the explicitly allowed
directories, neither through ``..`` nor through a symbolic link. (A link that leads out of a share directory is followed
only if the installation of the package created it: colcon's ``--symlink-install`` links single files to their
sources.)
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Final

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_share_directory,
    get_packages_with_prefixes,
)

from flexbt_core.values.text import did_you_mean, truncate_middle

from .errors import ResourceError

MAX_NAME: Final = 4096
"""Maximum length of a file name, characters: PATH_MAX of Linux."""

MAX_PARTS: Final = 100
"""Maximum number of directories in a name, since each one is checked."""

_FIND_SHARE: Final = re.compile(r'\$\(find-pkg-share\s+([^\s()]+)\s*\)')

_EXPECTED: Final = 'not a file name; expected package/relative/path or an absolute path'


def resolve_file(name: str, allowed: Sequence[Path] = (), parameter: str = 'allowed_directories') -> Path:
    """Return the path of the file ``name``.

    ``allowed`` are the directories for absolute paths; ``parameter`` is the name of the parameter that lists them.

    Raises:
        ResourceError: unknown package, no such file, or a place that is not allowed.
    """
    if len(name) > MAX_NAME:
        raise ResourceError(truncate_middle(name), f'a name of {len(name)} characters; at most {MAX_NAME} are allowed')
    if name.count('/') > MAX_PARTS:
        raise ResourceError(truncate_middle(name), f'a name of more than {MAX_PARTS} directories')
    try:
        return _found(name, allowed, parameter)
    except OSError as error:  # for example a component that is too long for the file system
        raise ResourceError(name, f'cannot be looked for: {error.strerror}') from error


def _found(name: str, allowed: Sequence[Path], parameter: str) -> Path:
    if not name or '\0' in name or name != name.encode(errors='replace').decode():
        raise ResourceError(repr(name), _EXPECTED)
    name = _in_package(name) or name
    if name.startswith('/'):
        return _existing(name, _inside_allowed(name, allowed, parameter))
    package, _, rest = name.partition('/')
    relative = PurePosixPath(rest)
    if not rest or relative.is_absolute() or package in ('.', '..'):
        raise ResourceError(name, _EXPECTED)
    if '..' in relative.parts:
        raise ResourceError(name, "a path inside a package must not contain '..'")
    share = _known_share(name, package)
    _refuse_links(name, share, relative)
    return _existing(name, share / relative)


def with_package_shares(text: str) -> str:
    """Replace each ``$(find-pkg-share PACKAGE)`` by the share directory of the package, as a launch file does.

    Raises:
        ResourceError: the package is not installed.
    """
    return _FIND_SHARE.sub(lambda found: str(_known_share(text, found[1])), text)


def _known_share(name: str, package: str) -> Path:
    share = _share_of(package)
    if share is None:
        raise ResourceError(
            name,
            f'no installed package {package!r}; install it, or source the workspace that has it'
            + did_you_mean(package, get_packages_with_prefixes(), ''),
        )
    return share


def _in_package(name: str) -> str:
    """Return ``package/relative/path`` for an absolute path in the share directory of a package, otherwise ''."""
    path = PurePosixPath(name)
    for share in path.parents:
        if share.parent.name == 'share' and _share_of(share.name) == Path(share):
            return f'{share.name}/{path.relative_to(share)}'
    return ''


def _share_of(package: str) -> Path | None:
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, ValueError):
        return None


def _inside_allowed(name: str, allowed: Sequence[Path], parameter: str) -> Path:
    path = Path(os.path.realpath(name))  # Path.resolve would raise on circular links
    if any(path.is_relative_to(directory.resolve()) for directory in allowed):
        return path
    places = ', '.join(str(directory) for directory in allowed) or 'none'
    raise ResourceError(
        name,
        f'lies outside the allowed directories ({places}); '
        f'use package/relative/path, or add its directory to the parameter {parameter!r}',
    )


def _refuse_links(name: str, share: Path, relative: PurePosixPath) -> None:
    for inside in relative.parents[:-1]:  # the last is the share directory itself
        if (share / inside).is_symlink():
            raise ResourceError(
                name, f'{share / inside} is a symbolic link to a directory; such paths are not followed'
            )
    target = os.path.realpath(share / relative)
    if (share / relative).is_symlink() and Path(target).name != relative.name:
        raise ResourceError(name, f'is a symbolic link to {target}; such links are not followed')


def _existing(name: str, path: Path) -> Path:
    if path.is_file():
        return path
    what = 'is not a file' if path.exists() else 'no such file'
    raise ResourceError(name, f'{what} ({path}){did_you_mean(path.name, _names_in(path.parent), "")}')


def _names_in(directory: Path) -> list[str]:
    try:
        return [entry.name for entry in directory.iterdir() if entry.is_file()]
    except OSError:
        return []


# The directory for files of the user that runs a program.

USER_DIRECTORY: Final = '~/.ros/flexbt'
"""Default directory of records and recordings."""

INCIDENTS: Final = f'{USER_DIRECTORY}/incidents'
"""Default directory of incidents."""

ALERTS: Final = f'{USER_DIRECTORY}/alerts.db'
"""Default file in which the alerts remember."""


def home_directory() -> Path | None:
    """Return the home directory of the user; None if there is none, as in a container whose user has no account."""
    try:
        return Path.home()
    except RuntimeError:
        return None


def home_path(path: str) -> Path:
    """Return a path that may begin with ``~`` or ``~user``.

    If there is no such home directory, that of temporary files, where other users write too, replaces it.
    """
    try:
        return Path(path).expanduser()
    except RuntimeError:
        import tempfile  # imported here, since it would slow down the start of every program

        return Path(tempfile.gettempdir(), *Path(path).parts[1:])


@contextlib.contextmanager
def alone_in(directory: Path) -> Iterator[None]:
    """Wait until no other process is in such a ``with`` block for this directory, whose files several may change.

    Raises OSError if the directory cannot be opened.
    """
    opened = os.open(directory, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(opened, fcntl.LOCK_EX)
        yield
    finally:
        os.close(opened)


def node_file(directory: str, node_name: str, suffix: str) -> Path | None:
    """Return the file of a node (fully qualified name) in a directory, which may begin with ``~``; None if
    ``directory`` is ''.

    The file name is the namespaces and the name of the node, joined by dots.
    """
    return home_path(directory) / f'{node_name.strip("/").replace("/", ".")}{suffix}' if directory else None
