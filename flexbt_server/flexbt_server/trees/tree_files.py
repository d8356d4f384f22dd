# SPDX-License-Identifier: BSD-3-Clause
"""The files that a document is made of: read from where they may be, and checked again at the cost of a stat."""

from __future__ import annotations

import hashlib
import posixpath
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flexbt_common.errors import ResourceError
from flexbt_common.runtime import resolve_file
from flexbt_core.values import open_regular

Stamp = tuple[int, int, int]


@dataclass(frozen=True)
class Source:
    """A file, or a text, as it was read. ``stamp`` tells one state of the file from another; None for a text.

    A file that could not be read has no ``path``.
    """

    digest: bytes
    path: Path | None
    stamp: Stamp | None


UNREADABLE = Source(b'', None, None)


class TreeFiles:
    """Package shares and allowed directories, read up to ``max_size`` bytes a file."""

    def __init__(self, allowed: Sequence[Path], max_size: int) -> None:
        self._allowed = tuple(allowed)
        self._max_size = max_size

    def read(self, name: str) -> tuple[bytes, Source]:
        """Content and state of a file. Raises ResourceError or OSError."""
        path = resolve_file(name, self._allowed)
        stamp = _stamp(path)
        with open(path, 'rb', opener=open_regular) as file:
            # One byte more than may be read: the reader refuses it as too long, with its place.
            content = file.read(self._max_size + 1)
        return content, Source(hashlib.sha256(content).digest(), path, stamp)

    def are_current(self, sources: Mapping[str, Source]) -> bool:
        """Whether all of these files are as they were, by their stamps: a stat for each."""
        return all(self._is_current(name, source) for name, source in sources.items())

    def _is_current(self, name: str, source: Source) -> bool:
        if source.path is not None:
            return _stamp_now(source.path) == source.stamp
        if source is not UNREADABLE:
            return True  # a text
        try:
            resolve_file(name, self._allowed)
        except ResourceError:
            return True
        return False


class Reading:
    """Reads what one document is made of, each file once. ``sources`` are those that it was made of: the file itself,
    or ``text``, and what it includes; ``length`` is that of all of it, in bytes, each as often as it is included."""

    def __init__(self, files: TreeFiles, name: str, text: bytes | None = None) -> None:
        self._files = files
        self._known: dict[str, tuple[bytes, Source]] = {}
        if text is not None:
            self._known[name] = text, Source(hashlib.sha256(text).digest(), None, None)
        self.name = name
        self.text = text
        self.sources: dict[str, Source] = {}
        self.length = 0

    def main(self) -> bytes:
        """The document itself. Raises ResourceError or OSError."""
        return self._content(self.name)

    def include(self, path: str, package: str | None, including: str) -> tuple[str, bytes]:
        """An :data:`IncludeResolver`."""
        if package:
            name = f'{package}/{path}'
        elif path.startswith('/') or including.startswith('<'):
            name = path
        else:
            name = posixpath.normpath(f'{including.rpartition("/")[0]}/{path}')
        try:
            return name, self._content(name)
        except ResourceError as error:
            raise OSError(str(error).removeprefix(f'{name}: ')) from error

    def is_same(self, sources: Mapping[str, Source]) -> bool:
        """Whether these sources have the same content still; then they are those of this reading."""
        found = {name: self._state(name) for name in sources}
        if any(found[name].digest != source.digest for name, source in sources.items()):
            return False
        self.sources = found
        return True

    def _content(self, name: str) -> bytes:
        self.sources[name] = UNREADABLE
        content, self.sources[name] = self._read(name)
        self.length += len(content)
        return content

    def _read(self, name: str) -> tuple[bytes, Source]:
        known = self._known.get(name)
        if known is None:
            known = self._known[name] = self._files.read(name)
        return known

    def _state(self, name: str) -> Source:
        try:
            return self._read(name)[1]
        except (ResourceError, OSError):
            return UNREADABLE


def _stamp(path: Path) -> Stamp:
    status = path.stat()
    # The time of the last change of anything cannot be set back, as that of the content can.
    return status.st_ctime_ns, status.st_mtime_ns, status.st_size


def _stamp_now(path: Path) -> Stamp | None:
    try:
        return _stamp(path)
    except OSError:
        return None
