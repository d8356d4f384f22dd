# SPDX-License-Identifier: BSD-3-Clause
"""``flexbt init``: a package with a behavior, a tree, leaves, tests, launch and deployment files."""

from __future__ import annotations

import importlib.util
import keyword
import re
import sys
from pathlib import Path
from typing import Final

from ament_index_python.packages import get_package_share_directory, get_packages_with_prefixes

from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import short_repr

_NAME: Final = re.compile(r'[a-z][a-z0-9]*(_[a-z0-9]+)*')
_SUFFIX: Final = '.in'


class UnwritableError(FlexbtError):
    """A package or file cannot be written; the message says why, and what to do."""


def write_package(name: str, parent: Path) -> list[Path]:
    """Write a package of this name into a new directory of ``parent``; return its files.

    Raises:
        UnwritableError: the name cannot be that of a package, or is taken, or the directory cannot be written.
    """
    if not _NAME.fullmatch(name):
        near = re.sub(r'[^a-z0-9]+', '_', re.sub(r'(?<=[a-z0-9])(?=[A-Z])', '_', name).lower()).strip('_0123456789')
        such = f', such as {short_repr(near)}' if _NAME.fullmatch(near) else ''
        raise UnwritableError(
            f'{short_repr(name)} is not the name of a package; use lower case letters, digits and _, with a letter '
            f'first{such}'
        )
    if keyword.iskeyword(name) or name in sys.stdlib_module_names:
        raise UnwritableError(f'{name} is a name of Python itself; choose another name, such as {name}_missions')
    if name in get_packages_with_prefixes():
        raise UnwritableError(f'a package {name} is installed already; choose another name')
    if importlib.util.find_spec(name) is not None:
        raise UnwritableError(f'a Python module {name} is installed already; choose another name')
    template = Path(get_package_share_directory('flexbt_bringup')) / 'template'
    title = ''.join(word.capitalize() for word in name.split('_'))
    directory = parent / name
    written = []
    try:
        directory.mkdir(parents=True)
        for source in sorted(template.rglob(f'*{_SUFFIX}')):
            place = str(source.relative_to(template)).removesuffix(_SUFFIX).replace('NAME', name)
            text = source.read_text(encoding='utf-8').replace('@NAME@', name).replace('@TITLE@', title)
            file = directory / place
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding='utf-8')
            written.append(file)
    except OSError as error:
        if isinstance(error, FileExistsError):
            raise UnwritableError(f'{directory} exists; choose another name or --directory') from error
        left = f'; remove {directory}, which is incomplete, before you try again' if written else ''
        failed = error.filename or directory
        raise UnwritableError(f'{failed}: {error.strerror}; choose another --directory{left}') from error
    return written
