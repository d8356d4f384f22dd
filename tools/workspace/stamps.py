# SPDX-License-Identifier: BSD-3-Clause
"""What was done last, in small JSON files in the directories that it made; and hashes of what it was made from.

A directory without a stamp is not to be relied on: the stamp is written last and removed first."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

STAMP = 'flexbt-stamp.json'


def read_stamp(file: Path) -> dict[str, Any]:
    """The content of `file`; empty when there is none, or it is damaged."""
    try:
        content = json.loads(file.read_text(encoding='utf-8'))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def write_stamp(file: Path, content: dict[str, Any]) -> None:
    """Replaces `file` at once, so that an interruption leaves the old or the new one."""
    file.parent.mkdir(parents=True, exist_ok=True)
    fresh = file.with_name(file.name + '.new')
    fresh.write_text(json.dumps(content, indent=1, sort_keys=True) + '\n', encoding='utf-8')
    fresh.replace(file)


def remove(path: Path) -> None:
    """Removes a directory, a file or a link, if there is one; the stamp first, in case of an interruption."""
    if path.is_dir() and not path.is_symlink():
        (path / STAMP).unlink(missing_ok=True)
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def hash_of(files: Iterable[Path], root: Path, *, names_only: Iterable[Path] = ()) -> str:
    """A hash of the names (below `root`) and contents of `files`, and of the names alone of `names_only`."""
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(f'{file.relative_to(root)}\0'.encode())
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    for file in sorted(names_only):
        digest.update(f'{file.relative_to(root)}\0'.encode())
    return digest.hexdigest()
