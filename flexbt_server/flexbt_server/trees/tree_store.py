# SPDX-License-Identifier: BSD-3-Clause
"""The store of loaded trees: a request is loaded as a whole or not at all. Changed files are noticed and read again.

Files are read on a separate worker thread, one request after the other; the library that goals see is exchanged as a
whole.
"""

from __future__ import annotations

import hashlib
import posixpath
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from flexbt_common.errors import ResourceError
from flexbt_common.files import resolve_file
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeDocument, TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import LoadError, TreeLoadError
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.values.text_files import open_regular
from flexbt_msgs.msg import BtLoadReport
from flexbt_server.errors import UnknownTreeError

from .tree_memory import MOST_LOADED, TreeMemory, TreeSize, check_room, no_room, tree_size

XML_TEXT: Final = '<xml>'
"""Name, in reports, of XML text that came with a goal."""

_TEXT_PREFIX: Final = '<xml '
"""Prefix of the names of such texts in the library."""

_MOST_ROUNDS: Final = 20
"""Maximum number of times that a tree may lead to further files that have changed."""


_MOST_SHOWN: Final = 20
"""Maximum number of dropped trees that are reported by name."""

_MOST_DROPPED: Final = 10_000
"""IDs of trees that were dropped, of which it is known where they came from."""


@dataclass
class FileReport:
    """The result of loading a file; ``code`` is a constant of BtLoadReport. ``notice``: what it displaced, or ''."""

    file: str
    code: int = BtLoadReport.UNKNOWN
    trees: tuple[str, ...] = ()
    errors: list[LoadError] = field(default_factory=list)
    notice: str = ''


class FoundTree(NamedTuple):
    """A tree to run, and the library to run it from, which has what it is made of. ``notice``: why an edit of its files
    was not taken over, and what was dropped to make room for it; or ''. The store keeps the files of the tree as long
    as the library is referenced."""

    library: TreeLibrary
    key: TreeKey
    notice: str

    def nodes(self) -> Iterator[NodeDefinition]:
        """Yield those of the tree, and of the trees of which it is made."""
        for tree in _trees_behind(self.library, self.key):
            yield from self.library.definition(tree).nodes()


class _Loaded(NamedTuple):
    """The source of a document in use; ``text`` is None for a file."""

    sources: Mapping[str, SourceFile]
    text: bytes | None


class _Refusal(NamedTuple):
    """An edit that was refused, and the files as they were then."""

    sources: Mapping[str, SourceFile]
    reason: str


class TreeStore:
    """A store that loads documents and finds trees. Safe to use from several threads.

    All that is loaded takes a bounded amount of memory. To make room, the documents that were not used for the longest
    time are dropped; not those of trees that run, and not what was loaded before :meth:`keep_loaded`. A file that was
    dropped is loaded again when a goal names it, or its tree.
    """

    def __init__(
        self,
        registry: NodeRegistry,
        allowed_directories: Sequence[Path],
        max_file_size: int,
        max_depth: int,
        max_loaded_memory: int = MOST_LOADED,
        on_loaded: Callable[[Iterator[NodeDefinition]], None] = lambda nodes: None,
    ) -> None:
        """``on_loaded`` gets the nodes that were loaded, on the thread that has loaded them. All documents may take
        ``max_loaded_memory`` bytes, as far as that is known (:mod:`.tree_memory`).
        """
        self.registry = registry
        self._on_loaded = on_loaded
        self._files = TreeFiles(allowed_directories, max_file_size)
        self._max_file_size = max_file_size
        self._max_depth = max_depth
        self._library = TreeLibrary()
        self._loaded: dict[str, _Loaded] = {}
        self._refused: dict[tuple[str, ...], _Refusal] = {}
        self._files_of: dict[TreeKey, list[str]] = {}
        self._memory = TreeMemory(max_loaded_memory)
        self._parts: weakref.WeakValueDictionary[TreeKey, TreeLibrary] = weakref.WeakValueDictionary()
        self._in_use: weakref.WeakSet[TreeLibrary] = weakref.WeakSet()
        self._dropped: dict[str, str] = {}  # the documents of trees that were dropped, by the IDs of these
        self._lock = threading.RLock()

    @property
    def library(self) -> TreeLibrary:
        """Library of the trees that are loaded now; it never changes, a load exchanges it."""
        return self._library

    def read_text(self, name: str) -> str:
        """Return the text of another file, from where those of trees may be, and as long as they may be.

        Raises:
            ResourceError: it cannot be read; says why.
        """
        try:
            content, _ = self._files.read(name)
            if len(content) > self._max_file_size:
                raise ResourceError(name, f'longer than {self._max_file_size} bytes (parameter max_file_size)')
            return content.decode('utf-8-sig')
        except (OSError, UnicodeDecodeError) as error:
            raise ResourceError(name, f'cannot be read: {error}') from error

    def keep_loaded(self) -> None:
        """Never drop what is loaded now: the server was configured with it."""
        with self._lock:
            self._memory.pin()

    def load(
        self, files: Sequence[str], xml: str = '', progress: Callable[[str, int], bool] | None = None
    ) -> list[FileReport]:
        """Load files and XML text: everything, or nothing when anything is refused.

        ``progress(file, done)`` is called before each file and stops the load, with nothing loaded, by returning False.
        One report per file in the order of the request, that of the text last.
        """
        readings = {file: FileReading(self._files, file) for file in files}
        requests = [(file, readings[file]) for file in files]
        if xml:
            name = f'{_TEXT_PREFIX}{hashlib.sha256(xml.encode()).hexdigest()[:8]}>'
            requests.append((XML_TEXT, FileReading(self._files, name, xml.encode())))
        with self._lock:
            return self._load(requests, progress, newest=True)

    def find(self, name: str) -> FoundTree:
        """Return the tree that a goal names, by ID or by file.

        A file is loaded when it is not. Files that the tree is made of, included ones too, are loaded again when they
        have changed; if what they have become is refused, all stays as it was, and the notice says why.

        Raises:
            UnknownTreeError: the tree does not exist, or its file was never valid; says why.
        """
        with self._lock:
            is_file = '/' in name or name.endswith('.xml')
            notices: list[str] = []
            file = name if is_file else self._dropped_file(name)
            if file and file not in self._loaded:
                reports = self._load([(file, FileReading(self._files, file))], None, newest=True)
                reasons = _errors_of(reports)
                if reasons:
                    raise UnknownTreeError(f'tree file refused: {reasons}')
                notices += [report.notice for report in reports]
            held: list[TreeLibrary] = []  # in use, so that it is not dropped when edits of its parts take room
            for _ in range(_MOST_ROUNDS):
                before = self._library
                key = self._key(name, is_file)
                if key is not None:
                    held.append(self._part(key))
                    files = self._files_behind(key)
                else:
                    files = [name] if is_file else list(self._loaded)  # any of them may have what is missing
                notices.append(self._refresh(files))
                if self._library is before:
                    break
            key = self._key(name, is_file)
            if key is not None:
                self._memory.use(self._files_behind(key))
                return FoundTree(self._part(key), key, '; '.join(filter(None, notices)))
            if not is_file:
                raise UnknownTreeError(self._no_such_tree(name))
            trees = ', '.join(sorted(self._library.documents[name].trees)) or 'none'
            raise UnknownTreeError(
                f'{name}: does not say which tree ({trees}) to execute; set main_tree_to_execute, or name one'
            )

    def _key(self, name: str, is_file: bool) -> TreeKey | None:
        if not is_file:
            return self._library.find(name)
        main = self._library.documents[name].main
        return None if main is None else TreeKey(name, main)

    def _dropped_file(self, id: str) -> str:
        """Return the file that has to be loaded again for a tree; '' if it is loaded, was never, or came as a text."""
        file = self._dropped.get(id, '')
        return '' if self._library.find(id) is not None or file.startswith(_TEXT_PREFIX) else file

    def _part(self, key: TreeKey) -> TreeLibrary:
        """Return the part of the library of which a tree is made: a run does not keep all the rest of it."""
        part = self._parts.get(key)
        if part is None:
            files = frozenset(self._files_behind(key))
            documents = [one for file, one in self._library.documents.items() if file in files]
            part = self._parts[key] = TreeLibrary(documents, max_nodes=self._library.max_nodes)
            self._in_use.add(part)
        return part

    def _files_behind(self, key: TreeKey) -> list[str]:
        """Return the documents that have the trees of which this one is made, and the models, which all go by."""
        found = self._files_of.get(key)
        if found is None:
            with_models = (file for file, document in self._library.documents.items() if document.models)
            files = [tree.file for tree in _trees_behind(self._library, key)]
            found = self._files_of[key] = list(dict.fromkeys([*files, *with_models]))
        return found

    def _refresh(self, names: Sequence[str]) -> str:
        """Load those of these documents again whose files have changed, together; return the report of it: the reason
        of a refusal, or the dropped trees."""
        outdated = tuple(name for name in names if not self._files.are_current(self._loaded[name].sources))
        if not outdated:
            return ''
        refused = self._refused.get(outdated)
        if refused is None or not self._files.are_current(refused.sources):
            readings = [FileReading(self._files, name, self._loaded[name].text) for name in outdated]
            reports = self._load([(reading.name, reading) for reading in readings], None, newest=False)
            reasons = _errors_of(reports)
            if not reasons:
                return '; '.join(filter(None, [report.notice for report in reports]))
            sources = {name: source for reading in readings for name, source in reading.sources.items()}
            refused = _Refusal(sources, f'an edit was not taken over, the last good version runs: {reasons}')
            self._refused[outdated] = refused
        return refused.reason

    def _no_such_tree(self, name: str) -> str:
        known = ', '.join(sorted(self._library.tree_ids())) or 'none is loaded'
        if name in self._dropped:
            return (
                f'tree {name!r} was dropped, as the least recently used one, to make room for others (parameter '
                f'max_loaded_memory); load it again with BtLoad. Known trees: {known}'
            )
        return f'there is no tree {name!r}; load its file with BtLoad, or name the file. Known trees: {known}'

    def _load(
        self, requests: Sequence[tuple[str, FileReading]], progress: Callable[[str, int], bool] | None, newest: bool
    ) -> list[FileReport]:
        """Load all or nothing. ``newest``: their trees become the newest of their names; otherwise they keep their
        places."""
        reports: list[FileReport] = []
        documents: list[TreeDocument] = []
        for done, (shown, reading) in enumerate(requests):
            report = FileReport(shown)
            reports.append(report)
            if progress is not None and not progress(shown, done):
                return reports
            self._read(report, reading, documents, newest)
        self._take(reports, documents, [reading for _, reading in requests], newest)
        return reports

    def _read(self, report: FileReport, reading: FileReading, documents: list[TreeDocument], newest: bool) -> None:
        name = reading.name
        known = self._loaded.get(name)
        try:
            if known is not None and reading.is_same(known.sources):
                report.code = BtLoadReport.UNCHANGED
                document = self._library.documents[name]
                report.trees = tuple(document.trees)
                if newest and any(self._library.find(id) != TreeKey(name, id) for id in document.trees):
                    documents.append(document)  # its trees are the newest of their names again
                self._memory.use([name])
                return
            content = reading.main()
            check_room(report.file, content)
            document = load_xml(
                content,
                name,
                self.registry,
                include=reading.include,
                max_bytes=self._max_file_size,
                max_depth=self._max_depth,
            )
        except TreeLoadError as error:
            report.code = BtLoadReport.REFUSED
            report.errors.extend(error.errors)
        except (ResourceError, OSError) as error:
            _refuse(report, error)
        except MemoryError:
            _refuse(report, no_room(report.file, reading.length))
        else:
            report.code = BtLoadReport.VALID
            report.trees = tuple(document.trees)
            documents.append(document)

    def _take(
        self,
        reports: list[FileReport],
        documents: list[TreeDocument],
        readings: Sequence[FileReading],
        newest: bool,
    ) -> None:
        if any(report.code == BtLoadReport.REFUSED for report in reports):
            return
        forgotten: set[str] = set()
        if documents:
            lengths = {reading.name: reading.length for reading in readings if reading.length}
            weights = {one.file: tree_size(one, lengths[one.file]) for one in documents if one.file in lengths}
            try:
                forgotten = self._replaced_texts(documents)
                library = self._library.stage(documents, without=forgotten, in_place=not newest)
                dropped = self._to_drop(library, weights, readings)
                self._library = library.stage((), without=dropped) if dropped else library
            except TreeLoadError as error:
                self._blame(reports, error)
                return
            except ResourceError as error:
                _refuse(next(report for report in reports if report.code == BtLoadReport.VALID), error)
                return
            reports[-1].notice = self._note_dropped(library, dropped)
            forgotten.update(dropped)
            self._memory.put(weights, forgotten)
            self._files_of.clear()
            self._parts.clear()
            self._refused.clear()
        self._loaded |= {reading.name: _Loaded(dict(reading.sources), reading.text) for reading in readings}
        for name in forgotten:
            del self._loaded[name]
        for report in reports:
            if report.code == BtLoadReport.VALID:
                report.code = BtLoadReport.LOADED
        self._on_loaded(node for document in documents for tree in document.trees.values() for node in tree.nodes())

    def _to_drop(
        self, library: TreeLibrary, weights: Mapping[str, TreeSize], readings: Sequence[FileReading]
    ) -> list[str]:
        """Return the documents that make room for new ones. Raises ResourceError when there are not enough of them."""
        in_use = {file for part in self._in_use for file in part.documents}
        return self._memory.to_drop(library, weights, in_use.union(reading.name for reading in readings))

    def _note_dropped(self, library: TreeLibrary, dropped: Sequence[str]) -> str:
        """Remember where the trees of these documents came from; gives what there is to tell of them, or ''."""
        ids = {id: file for file in dropped for id in library.documents[file].trees}
        self._dropped.update(ids)
        while len(self._dropped) > _MOST_DROPPED:
            del self._dropped[next(iter(self._dropped))]
        if not dropped:
            return ''
        shown = ', '.join(sorted(ids)[:_MOST_SHOWN]) + (', ...' if len(ids) > _MOST_SHOWN else '')
        return f'to make room (parameter max_loaded_memory), the least recently used trees were dropped: {shown}'

    def _replaced_texts(self, documents: Sequence[TreeDocument]) -> set[str]:
        """XML texts of which no tree can be named any more, once ``documents`` are loaded: newer ones have taken the
        names of all. They would never be removed."""
        library = self._library
        names = {document.file for document in documents}
        taken = {id for document in documents for id in document.trees}
        return {
            name
            for name, document in library.documents.items()
            if name.startswith(_TEXT_PREFIX)
            and name not in names
            and not document.models
            and all(id in taken or library.find(id) != TreeKey(name, id) for id in document.trees)
        }

    def _blame(self, reports: list[FileReport], error: TreeLoadError) -> None:
        """Give errors between documents to the files that they are in, otherwise to the last one that is new."""
        by_file = {report.file: report for report in reports}
        new = [report for report in reports if report.code == BtLoadReport.VALID]
        for reason in error.errors:
            name = XML_TEXT if reason.file.startswith(_TEXT_PREFIX) else reason.file
            report = by_file.get(name, new[-1] if new else reports[-1])
            report.code = BtLoadReport.REFUSED
            report.errors.append(reason)


def _refuse(report: FileReport, error: ResourceError | OSError) -> None:
    name = error.name if isinstance(error, ResourceError) else report.file
    report.code = BtLoadReport.REFUSED
    report.errors.append(LoadError(report.file, 0, 0, '', str(error).removeprefix(f'{name}: ')))


def _trees_behind(library: TreeLibrary, key: TreeKey) -> list[TreeKey]:
    """Return the tree, and those of which it is made."""
    keys = [key]
    for tree in keys:
        ids = {node.tree_id for node in library.definition(tree).nodes() if node.tree_id is not None}
        targets = {library.find(id, tree.file) for id in ids}
        keys += [target for target in targets if target is not None and target not in keys]
    return keys


def _errors_of(reports: Sequence[FileReport]) -> str:
    """Why a load was refused; '' when it was not."""
    return '; '.join(str(error) for report in reports for error in report.errors)


# The files that a document is made of: read from where they may be, and checked again at the cost of a stat.

FileStamp = tuple[int, int, int]


@dataclass(frozen=True)
class SourceFile:
    """A file, or a text, as it was read. ``stamp`` identifies a state of the file; None for a text.

    A file that could not be read has no ``path``.
    """

    digest: bytes
    path: Path | None
    stamp: FileStamp | None


UNREADABLE = SourceFile(b'', None, None)


class TreeFiles:
    """Package shares and allowed directories, read up to ``max_size`` bytes a file."""

    def __init__(self, allowed: Sequence[Path], max_size: int) -> None:
        self._allowed = tuple(allowed)
        self._max_size = max_size

    def read(self, name: str) -> tuple[bytes, SourceFile]:
        """Content and state of a file. Raises ResourceError or OSError."""
        path = resolve_file(name, self._allowed)
        stamp = _stamp(path)
        with open(path, 'rb', opener=open_regular) as file:
            # One byte more than may be read: the reader refuses it as too long, with its place.
            content = file.read(self._max_size + 1)
        return content, SourceFile(hashlib.sha256(content).digest(), path, stamp)

    def are_current(self, sources: Mapping[str, SourceFile]) -> bool:
        """Return whether all of these files are as they were, by their stamps: a stat for each."""
        return all(self._is_current(name, source) for name, source in sources.items())

    def _is_current(self, name: str, source: SourceFile) -> bool:
        if source.path is not None:
            return _stamp_now(source.path) == source.stamp
        if source is not UNREADABLE:
            return True  # a text
        try:
            resolve_file(name, self._allowed)
        except ResourceError:
            return True
        return False


class FileReading:
    """The reading of the files of one document, each once. ``sources`` are the files that it was made of: the file
    itself, or ``text``, and those that it includes. ``length`` is the total length in bytes, each file counted as often
    as it is included."""

    def __init__(self, files: TreeFiles, name: str, text: bytes | None = None) -> None:
        self._files = files
        self._known: dict[str, tuple[bytes, SourceFile]] = {}
        if text is not None:
            self._known[name] = text, SourceFile(hashlib.sha256(text).digest(), None, None)
        self.name = name
        self.text = text
        self.sources: dict[str, SourceFile] = {}
        self.length = 0

    def main(self) -> bytes:
        """Return the document itself. Raises ResourceError or OSError."""
        return self._content(self.name)

    def include(self, path: str, package: str | None, including: str) -> tuple[str, bytes]:
        """Return an :data:`IncludeResolver`."""
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

    def is_same(self, sources: Mapping[str, SourceFile]) -> bool:
        """Return whether these sources have the same content still; then they are those of this reading."""
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

    def _read(self, name: str) -> tuple[bytes, SourceFile]:
        known = self._known.get(name)
        if known is None:
            known = self._known[name] = self._files.read(name)
        return known

    def _state(self, name: str) -> SourceFile:
        try:
            return self._read(name)[1]
        except (ResourceError, OSError):
            return UNREADABLE


def _stamp(path: Path) -> FileStamp:
    status = path.stat()
    # The time of the last change of anything cannot be set back, as that of the content can.
    return status.st_ctime_ns, status.st_mtime_ns, status.st_size


def _stamp_now(path: Path) -> FileStamp | None:
    try:
        return _stamp(path)
    except OSError:
        return None
