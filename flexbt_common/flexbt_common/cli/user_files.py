# SPDX-License-Identifier: BSD-3-Clause
"""Where programs keep files of the user who runs them."""

from __future__ import annotations

from pathlib import Path
from typing import Final

USER_DIRECTORY: Final = '~/.ros/flexbt'
"""The directory of records and recordings, unless another one is given."""


def home_path(path: str) -> Path:
    """A path that may begin with ``~`` or ``~user``.

    Where there is no such home directory, as in a container whose user has no account, that of temporary files stands
    for it.
    """
    try:
        return Path(path).expanduser()
    except RuntimeError:
        import tempfile  # which every program would else take some time for at its start

        return Path(tempfile.gettempdir(), *Path(path).parts[1:])


def node_file(directory: str, node_name: str, suffix: str) -> Path | None:
    """The file of a node (fully qualified name) in a directory, which may begin with ``~``; None for no directory.

    It is called by the names around the node and its own, joined by dots.
    """
    return home_path(directory) / f'{node_name.strip("/").replace("/", ".")}{suffix}' if directory else None
