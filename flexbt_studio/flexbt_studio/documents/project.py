# SPDX-License-Identifier: BSD-3-Clause
"""A project: the trees, machines and behaviors below a folder, and those of them that are open.

An open file has a version, which each edit raises by one. An edit for another version than the current one is refused,
as in the language server protocol. A file that somebody else has changed on disk is never overwritten.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.text_files import TextFileError, open_regular, read_text, version_of, write_text
from flexbt_studio.errors import ConflictError, StudioError

from .document import Document
from .python_document import PythonDocument
from .text import Span, TextEdit, applied
from .xml_document import XmlDocument
from .yaml_document import YamlDocument

MOST_FILES: Final = 5000
"""Maximum number of files that a project looks into."""
MOST_BYTES: Final = 4_000_000
"""Maximum size of a file that is opened, bytes."""
MOST_KEPT: Final = 1000
"""Maximum number of documents that are kept of files that are not open."""
_BEGINNING: Final = 65_536
"""Characters of a file in which its kind is looked for."""

_SKIPPED_FOLDERS: Final = frozenset({'build', 'install', 'log', 'out', 'node_modules', '__pycache__', 'site-packages'})


class Kind(NamedTuple):
    """A kind of file that the studio opens."""

    name: str
    suffixes: tuple[str, ...]
    mark: re.Pattern[str]
    """What its text has and that of other files with these suffixes has not."""
    document: type[Document]


KINDS: Final = (
    Kind('trees', ('.xml',), re.compile(r'<(?:BehaviorTree|TreeNodesModel)\b|BTCPP_format'), XmlDocument),
    Kind('machine', ('.yaml', '.yml'), re.compile(r'(?m)^(?:machine|concurrency|priority)\s*:'), YamlDocument),
    Kind('behavior', ('.py',), re.compile(r'(?m)^class\s+\w+\((?:[^)]*\b)?Behavior\b'), PythonDocument),
)


def kind_of(file: str, text: str) -> Kind | None:
    """Return the kind of a file by its name and the beginning of its text; None if the studio does not open it."""
    suffix = Path(file).suffix
    return next((kind for kind in KINDS if suffix in kind.suffixes and kind.mark.search(text[:_BEGINNING])), None)


def document_for(file: str, text: str) -> Document:
    """Return the document of a text. The suffix of the file decides its language.

    Raises:
        StudioError: no language has this suffix.
    """
    suffix = Path(file).suffix
    for kind in KINDS:
        if suffix in kind.suffixes:
            return kind.document(text, file)
    known = ', '.join(suffix for kind in KINDS for suffix in kind.suffixes)
    raise StudioError(f'{file}: files of this kind are not edited here; rename it to one of {known}')


class Place(NamedTuple):
    """A place in a file of the project."""

    file: str
    span: Span


@dataclass(slots=True)
class OpenFile:
    """An open file. ``disk`` identifies the text on disk when it was read or saved; '' if there was none."""

    document: Document
    version: int
    disk: str
    saved_text: str
    has_mark: bool = False
    """Whether the file begins with a byte order mark, which is no part of the text."""
    stamp: tuple[int, ...] | None = None
    """Version of the file on disk when it was last compared with ``disk``."""
    is_shown_only: bool = False
    """Whether it is no file, but a text that comes from elsewhere and cannot be edited."""

    @property
    def is_changed(self) -> bool:
        """Whether the text differs from that on disk when it was read or saved."""
        return self.document.text != self.saved_text


class Project:
    """The files below ``root``. Names of files are relative to it, with ``/``."""

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root).resolve()
        self._open: dict[str, OpenFile] = {}
        self._closed: dict[str, tuple[tuple[int, ...], Document]] = {}
        """Documents of files that are not open, with the version on disk of each when it was read."""
        self._kinds: dict[Path, tuple[tuple[int, ...], Kind | None]] = {}
        """Kinds of the files on disk, with the version of each when it was looked into."""
        self._written: set[Path] = set()
        """Files that were written or removed since the last call of :meth:`written`, as far as that was seen."""
        self._last: dict[str, tuple[str, int]] = {}
        """The last version of each file that is not open, and the identity of its text on disk; '' if it was edited."""

    def files(self) -> list[dict[str, str]]:
        """Return name and kind of each file that the studio opens, in order of names."""
        found: list[dict[str, str]] = []
        suffixes = {suffix for kind in KINDS for suffix in kind.suffixes}
        paths = list(itertools.islice(self.walk(suffixes), MOST_FILES))
        for path in self._kinds.keys() - set(paths):
            del self._kinds[path]
            self._written.add(path)
        for path in paths:
            name = path.relative_to(self.root).as_posix()
            if name in self._open:
                self._kinds.pop(path, None)
                kind = kind_of(name, self._open[name].document.text)
            else:
                kind = self._kind_on_disk(path)
            if kind is not None:
                found.append({'file': name, 'kind': kind.name})
        for name, opened in self._open.items():
            kind = kind_of(name, opened.document.text)
            if kind is not None and opened.is_changed and not opened.disk:  # it is new
                found.append({'file': name, 'kind': kind.name})
        return sorted(found, key=lambda one: one['file'])

    def _kind_on_disk(self, path: Path) -> Kind | None:
        stamp = version_of(path)
        known = self._kinds.get(path)
        if known is None or known[0] != stamp:
            if known is not None:
                self._written.add(path)
            known = self._kinds[path] = stamp, kind_of(path.name, _beginning(path))
        return known[1]

    def written(self) -> list[str]:
        """Return the files that were written or removed between the calls of :meth:`files` since the last call of this.
        Those that are open are left out, see :meth:`disk_changes`."""
        found = [path.relative_to(self.root).as_posix() for path in sorted(self._written)]
        self._written.clear()
        return [file for file in found if file not in self._open]

    def document(self, file: str) -> Document:
        """Return the document of a file, which is not opened: as edited, else as on disk. Raises StudioError."""
        opened = self._open.get(file)
        if opened is not None:
            return opened.document
        stamp = version_of(self.path(file))
        known = self._closed.pop(file, None)
        if known is None or known[0] != stamp:
            known = stamp, document_for(file, self.text_on_disk(file)[0])
        self._closed[file] = known
        if len(self._closed) > MOST_KEPT:
            del self._closed[next(iter(self._closed))]
        return known[1]

    def documents(self, kind: str = '') -> Iterator[tuple[str, Document]]:
        """Yield the files of a kind, or of all kinds, with their documents. Those that cannot be read are left out."""
        for one in self.files():
            if not kind or one['kind'] == kind:
                with contextlib.suppress(StudioError):
                    yield one['file'], self.document(one['file'])

    def trees(self, file: str) -> XmlDocument:
        """Return the document of a file with trees, as :meth:`document`. Raises StudioError."""
        document = self.document(file)
        if not isinstance(document, XmlDocument):
            raise StudioError(f'{file} has no trees; name a file with behavior trees in XML')
        return document

    def tree_files(self) -> Iterator[tuple[str, XmlDocument]]:
        """Yield the files with trees, with their documents. Those that cannot be read are left out."""
        for file, document in self.documents('trees'):
            if isinstance(document, XmlDocument):
                yield file, document

    def texts_with(self, suffixes: set[str]) -> Iterator[tuple[str, str]]:
        """Yield the files with these suffixes and their texts. Those that cannot be read are left out."""
        for path in itertools.islice(self.walk(suffixes), MOST_FILES):
            file = path.relative_to(self.root).as_posix()
            with contextlib.suppress(StudioError):
                yield file, self.text(file)

    def walk(self, suffixes: set[str]) -> Iterator[Path]:
        """Yield the files with these suffixes, without those in folders of programs and hidden ones."""
        for folder, folders, names in os.walk(self.root):
            folders[:] = sorted(one for one in folders if one not in _SKIPPED_FOLDERS and not one.startswith('.'))
            yield from (Path(folder, name) for name in sorted(names) if Path(name).suffix in suffixes)

    def path(self, file: str) -> Path:
        """Return where a file is on disk. Raises StudioError if that is outside of the project, or has another name."""
        path = Path(os.path.realpath(self.root / file)) if '\0' not in file else self.root.parent
        if not path.is_relative_to(self.root) or path == self.root:
            raise StudioError(f'{short_repr(file)} is not in the project; open the folder that contains it instead')
        name = os.path.relpath(self.root / file, self.root)
        if file != name:  # a file has one name: who edits it under another one would not see what others edit
            raise StudioError(f'{short_repr(file)} has the name {short_repr(name)} in the project; write that')
        return path

    def unedited(self) -> Project:
        """Return the project as it is on disk, without what is edited here."""
        project = Project(self.root)
        project._closed, project._kinds, project._written = self._closed, self._kinds, self._written
        return project

    # Open files.

    @property
    def open_files(self) -> Mapping[str, OpenFile]:
        """The open files by name."""
        return self._open

    def open(self, file: str) -> OpenFile:
        """Open a file, or return it if it is open. Raises StudioError if it cannot be read."""
        opened = self._open.get(file)
        if opened is None:
            text, disk, has_mark = self._read(file)
            version = self._version_of(file, disk)
            opened = self._open[file] = OpenFile(document_for(file, text), version, disk, text, has_mark)
        return opened

    def version(self, file: str) -> int:
        """Return the version of a file; of one that is not open, that with which it would be opened now. It is another
        one if the text is another one than before. Raises StudioError."""
        opened = self._open.get(file)
        return self._version_of(file, self.text_on_disk(file)[1]) if opened is None else opened.version

    def _version_of(self, file: str, disk: str) -> int:
        last, version = self._last.get(file, ('', 0))
        if not disk or last != disk:
            version += 1
            self._last[file] = disk, version
        return version

    def create(self, file: str, text: str) -> OpenFile:
        """Open a new file with this text. It is written when it is saved. Raises StudioError if it exists."""
        if file in self._open or version_of(self.path(file)):
            raise StudioError(f'{file} exists already; open it, or choose another name')
        self._open[file] = OpenFile(document_for(file, text), self._version_of(file, ''), '', '')
        return self._open[file]

    def adopt(self, file: str, text: str) -> OpenFile:
        """Open a file with the text that an editor shows, or replace the text of an open file by it."""
        opened = self._open.get(file)
        if opened is None:
            saved = disk = ''
            with contextlib.suppress(StudioError):  # there is no such file, or no text that can be read here
                saved, disk, _ = self._read(file)
            opened = self._open[file] = OpenFile(document_for(file, text), 0, disk, saved)
        elif opened.document.text != text:
            opened.document = document_for(file, text)
        opened.version += 1
        return opened

    def show(self, file: str, text: str) -> OpenFile:
        """Open a text that comes from elsewhere and cannot be edited, or replace the one that is open."""
        version = self._open[file].version + 1 if file in self._open else 1
        self._open[file] = OpenFile(document_for(file, text), version, '', text, is_shown_only=True)
        return self._open[file]

    def close(self, file: str) -> None:
        """Forget an open file with its unsaved edits. A text from elsewhere stays."""
        if file in self._open and not self._open[file].is_shown_only:
            self.forget(file)

    def leave(self, used: Collection[str]) -> None:
        """Forget the open files without unsaved edits that are not used: they are again as on disk. A text from
        elsewhere stays."""
        for file, opened in list(self._open.items()):
            if file not in used and not opened.is_changed:
                self.close(file)

    def forget(self, file: str) -> None:
        """Forget an open file, or a text from elsewhere."""
        opened = self._open.pop(file, None)
        if opened is not None:
            self._last[file] = '' if opened.is_changed else opened.disk, opened.version

    def edit(self, file: str, version: int, edits: Sequence[TextEdit]) -> OpenFile:
        """Apply edits to a version of an open file.

        Raises:
            ConflictError: the file has another version.
            StudioError: the file is not open, or the edits are not within its text.
        """
        opened = self._current(file, version)
        try:
            text = applied(opened.document.text, edits)
        except ValueError as error:
            raise StudioError(f'{file}: {error}') from error
        if len(text) > MOST_BYTES:
            raise StudioError(f'{file}: it would have more than {MOST_BYTES} characters; split it')
        opened.document = opened.document.after(text)
        opened.version += 1
        return opened

    def gesture(self, file: str, version: int, name: str, arguments: dict[str, Any]) -> list[TextEdit]:
        """Return the edits that carry out a gesture in a version of an open file, without applying them.

        Raises ConflictError and StudioError as :meth:`edit`; GestureError if the gesture does not apply.
        """
        return self._current(file, version).document.gesture(name, arguments)

    def save(self, file: str, version: int, *, over: str | None = None) -> OpenFile:
        """Write a version of an open file to disk.

        ``over`` is the identity (:attr:`OpenFile.disk`) of a text on disk that somebody else has written and that the
        user has seen: it is overwritten.

        Raises:
            ConflictError: the file has another version, or was changed on disk.
            StudioError: it cannot be written.
        """
        opened = self._current(file, version)
        path = self.path(file)
        on_disk = self._disk(file)
        if (not on_disk or on_disk not in (opened.disk, over)) and version_of(path):
            raise ConflictError(f'{file} was changed on disk by another program; compare the two, then save again')
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, '\ufeff' * opened.has_mark + opened.document.text)
        except OSError as error:
            raise StudioError(f'{file} could not be written: {error.strerror}; nothing of it is lost here') from error
        opened.disk = self._disk(file)
        opened.saved_text = opened.document.text
        return opened

    def text(self, file: str) -> str:
        """Return the text of a file: as edited if it is open, else as on disk. Raises StudioError."""
        opened = self._open.get(file)
        return self.text_on_disk(file)[0] if opened is None else opened.document.text

    def text_on_disk(self, file: str) -> tuple[str, str]:
        """Return the text that is on disk now, and its identity. Raises StudioError if it cannot be read."""
        text, disk, _ = self._read(file)
        return text, disk

    def take_disk(self, file: str) -> str | None:
        """Take the text on disk as the saved one and return it; None if it is that. Raises StudioError."""
        opened = self.open(file)
        text, disk, has_mark = self._read(file)
        if disk == opened.disk:
            return None
        opened.disk, opened.saved_text, opened.has_mark = disk, text, has_mark
        return text

    def disk_changes(self) -> list[str]:
        """Return the open files that were written since the last call, and not by the studio. It is quick."""
        found = []
        for file, opened in self._open.items():
            with contextlib.suppress(StudioError):
                if opened.stamp != (stamp := version_of(self.path(file))):
                    opened.stamp = stamp
                    found += [file] if self._disk(file) not in (opened.disk, '') else []
        return found

    def changed_on_disk(self) -> list[str]:
        """Return the open files whose text on disk is no longer what was read or saved."""
        return [file for file, opened in self._open.items() if self._disk(file) != opened.disk]

    def texts(self) -> dict[str, str]:
        """Return the texts of all open files by their path on disk."""
        return {str(self.root / file): opened.document.text for file, opened in self._open.items()}

    def _current(self, file: str, version: int) -> OpenFile:
        opened = self._open.get(file)
        if opened is None:
            raise StudioError(f'{short_repr(file)} is not open{did_you_mean(file, list(self._open))}; open it first')
        if opened.is_shown_only:
            raise StudioError(f'{file} is what a program sends; copy the text into a file of the project to change it')
        if version != opened.version:
            raise ConflictError(f'{file}: this is for version {version}, and version {opened.version} is current')
        return opened

    def _read(self, file: str) -> tuple[str, str, bool]:
        path = self.path(file)
        try:
            text = read_text(path, MOST_BYTES)
            with path.open('rb') as content:
                has_mark = content.read(3) == b'\xef\xbb\xbf'
        except (TextFileError, OSError) as error:
            raise StudioError(f'{file} cannot be read: {getattr(error, "strerror", None) or error}') from error
        return text, _identity('\ufeff' * has_mark + text), has_mark

    def _disk(self, file: str) -> str:
        """Return the identity of the text on disk; '' if there is no file, or none that can be read as text."""
        try:
            return self._read(file)[1]
        except StudioError:
            return ''


def tree_places(project: Project, near: str = '') -> dict[str, Place]:
    """Return where each tree is defined, by its ID.

    If several trees have one, that in the file ``near`` counts, else that in the nearest folder.
    """

    def distance(file: str) -> tuple[bool, int, str]:
        pairs = zip(Path(near).parts[:-1], Path(file).parts[:-1], strict=False)
        return file != near, -sum(1 for _ in itertools.takewhile(lambda pair: pair[0] == pair[1], pairs)), file

    found: dict[str, Place] = {}
    for file, document in sorted(project.tree_files(), key=lambda one: distance(one[0])):
        for tree in reversed(document.trees.values()):
            if id := tree.attributes.get('ID', ''):
                found.setdefault(id, Place(file, tree.value_span('ID')))
    return found


def _identity(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _beginning(path: Path) -> str:
    try:
        with open(path, 'rb', opener=open_regular) as content:
            return content.read(_BEGINNING).decode('utf-8', 'replace')
    except OSError:
        return ''
