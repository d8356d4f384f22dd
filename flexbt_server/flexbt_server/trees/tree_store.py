# SPDX-License-Identifier: BSD-3-Clause
"""The store of loaded trees. It loads a request as a whole or not at all, and reads changed files again.

A separate worker thread reads files, one request after the other. The library that goals see is replaced as a
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
"""Name in reports for XML text from a goal."""

_TEXT_PREFIX: Final = '<xml '
"""Prefix of the names of such texts in the library."""

_MOST_ROUNDS: Final = 20
"""Maximum number of rounds in which a tree leads to further changed files."""


_MOST_SHOWN: Final = 20
"""Maximum number of dropped trees that a report names."""

_MOST_DROPPED: Final = 10_000
"""Maximum number of dropped tree IDs whose file is remembered."""


@dataclass
class FileReport:
    """The result of loading a file; ``code`` is a constant of BtLoadReport. ``notice``: the displaced trees, or ''."""

    file: str
    code: int = BtLoadReport.UNKNOWN
    trees: tuple[str, ...] = ()
    errors: list[LoadError] = field(default_factory=list)
    notice: str = ''


class FoundTree(NamedTuple):
    """A tree to run, and a library with all its parts. ``notice``: why an edit of its files was refused, and which
    trees were dropped to make room for it, or ''. The store keeps the files of the tree as long as the library is
    referenced."""

    library: TreeLibrary
    key: TreeKey
    notice: str

    def nodes(self) -> Iterator[NodeDefinition]:
        """Yield the nodes of the tree and of its sub-trees."""
        for tree in _trees_behind(self.library, self.key):
            yield from self.library.definition(tree).nodes()


class _Loaded(NamedTuple):
    """The source of a document in use; ``text`` is None for a file."""

    sources: Mapping[str, SourceFile]
    text: bytes | None


class _Refusal(NamedTuple):
    """A refused edit, and the state of the files at that time."""

    sources: Mapping[str, SourceFile]
    reason: str


class TreeStore:
    """A store that loads documents and finds trees. Safe to use from several threads.

    The memory of all loaded documents is bounded. To make room, the store drops the least recently used documents,
    except those of running trees and those loaded before :meth:`keep_loaded`. It loads a dropped file again when a goal
    names the file or its tree.
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
        """``on_loaded`` gets the loaded nodes, on the thread that has loaded them. ``max_loaded_memory`` limits the
        size of all documents, estimated bytes (:mod:`.tree_memory`).
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
        self._dropped: dict[str, str] = {}  # documents of dropped trees, by tree ID
        self._lock = threading.RLock()

    @property
    def library(self) -> TreeLibrary:
        """Library of the loaded trees; immutable: a load replaces it."""
        return self._library

    def read_text(self, name: str) -> str:
        """Return the text of another file, with the allowed places and the size limit of tree files.

        Raises:
            ResourceError: it cannot be read; the text has the reason.
        """
        try:
            content, _ = self._files.read(name)
            if len(content) > self._max_file_size:
                raise ResourceError(name, f'longer than {self._max_file_size} bytes (parameter max_file_size)')
            return content.decode('utf-8-sig')
        except (OSError, UnicodeDecodeError) as error:
            raise ResourceError(name, f'cannot be read: {error}') from error

    def keep_loaded(self) -> None:
        """Never drop the documents that are loaded now: they belong to the configuration of the server."""
        with self._lock:
            self._memory.pin()

    def load(
        self, files: Sequence[str], xml: str = '', progress: Callable[[str, int], bool] | None = None
    ) -> list[FileReport]:
        """Load files and XML text: everything, or nothing if any of it is refused.

        ``progress(file, done)`` is called before each file. If it returns False, the load stops and nothing is loaded.
        Return one report per file in the order of the request, with the report of the text last.
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

        A file is loaded if needed. Changed files of the tree, included ones too, are loaded again. If a change is
        refused, everything stays as it was, and the notice has the reason.

        Raises:
            UnknownTreeError: the tree does not exist, or its file was never valid; the text has the reason.
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
            held: list[TreeLibrary] = []  # a reference, so that edits of its parts do not drop it
            for _ in range(_MOST_ROUNDS):
                before = self._library
                key = self._key(name, is_file)
                if key is not None:
                    held.append(self._part(key))
                    files = self._files_behind(key)
                else:
                    files = [name] if is_file else list(self._loaded)  # any file may contain the missing tree
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
        """Return the dropped file to load again for a tree; '' if the tree is loaded, never was, or came as text."""
        file = self._dropped.get(id, '')
        return '' if self._library.find(id) is not None or file.startswith(_TEXT_PREFIX) else file

    def _part(self, key: TreeKey) -> TreeLibrary:
        """Return the part of the library that a tree needs, so that a run does not keep the rest."""
        part = self._parts.get(key)
        if part is None:
            files = frozenset(self._files_behind(key))
            documents = [one for file, one in self._library.documents.items() if file in files]
            part = self._parts[key] = TreeLibrary(documents, max_nodes=self._library.max_nodes)
            self._in_use.add(part)
        return part

    def _files_behind(self, key: TreeKey) -> list[str]:
        """Return the documents with the parts of a tree, and those with models, which may be of its sub-trees."""
        found = self._files_of.get(key)
        if found is None:
            with_models = (file for file, document in self._library.documents.items() if document.models)
            files = [tree.file for tree in _trees_behind(self._library, key)]
            found = self._files_of[key] = list(dict.fromkeys([*files, *with_models]))
        return found

    def _refresh(self, names: Sequence[str]) -> str:
        """Load the documents among ``names`` whose files have changed again, together. Return the reason of a refusal,
        or a report of the dropped trees."""
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
        """Load all or nothing. With ``newest``, the trees become the newest of their names; otherwise they keep their
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
        """Return the documents to drop for new ones. Raises ResourceError if they do not make enough room."""
        in_use = {file for part in self._in_use for file in part.documents}
        return self._memory.to_drop(library, weights, in_use.union(reading.name for reading in readings))

    def _note_dropped(self, library: TreeLibrary, dropped: Sequence[str]) -> str:
        """Remember the files of the trees in these documents. Return a report of the dropped trees, or ''."""
        ids = {id: file for file in dropped for id in library.documents[file].trees}
        self._dropped.update(ids)
        while len(self._dropped) > _MOST_DROPPED:
            del self._dropped[next(iter(self._dropped))]
        if not dropped:
            return ''
        shown = ', '.join(sorted(ids)[:_MOST_SHOWN]) + (', ...' if len(ids) > _MOST_SHOWN else '')
        return f'to make room (parameter max_loaded_memory), the least recently used trees were dropped: {shown}'

    def _replaced_texts(self, documents: Sequence[TreeDocument]) -> set[str]:
        """Return the XML texts whose trees all have newer namesakes once ``documents`` are loaded. No goal could name
        these trees, and the texts would never be removed."""
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
        """Add errors between documents to the reports of their files, or else of the last new file."""
        by_file = {report.file: report for report in reports}
        new = [report for report in reports if report.code == BtLoadReport.VALID]
        for reason in error.errors:
            report = by_file.get(asked_name(reason.file), new[-1] if new else reports[-1])
            report.code = BtLoadReport.REFUSED
            report.errors.append(reason)


def asked_name(file: str) -> str:
    """Return the name of a document as it was asked for: :data:`XML_TEXT` for a text."""
    return XML_TEXT if file.startswith(_TEXT_PREFIX) else file


def _refuse(report: FileReport, error: ResourceError | OSError) -> None:
    name = error.name if isinstance(error, ResourceError) else report.file
    report.code = BtLoadReport.REFUSED
    report.errors.append(LoadError(report.file, 0, 0, '', str(error).removeprefix(f'{name}: ')))


def _trees_behind(library: TreeLibrary, key: TreeKey) -> list[TreeKey]:
    """Return the tree and its sub-trees."""
    keys = [key]
    for tree in keys:
        ids = {node.tree_id for node in library.definition(tree).nodes() if node.tree_id is not None}
        targets = {library.find(id, tree.file) for id in ids}
        keys += [target for target in targets if target is not None and target not in keys]
    return keys


def _errors_of(reports: Sequence[FileReport]) -> str:
    """Return the reason why a load was refused, or ''."""
    return '; '.join(str(error) for report in reports for error in report.errors)


# The files of a document, read from the allowed places and checked for changes by a stat.

FileStamp = tuple[int, int, int]


@dataclass(frozen=True)
class SourceFile:
    """A file or a text in the state in which it was read. ``stamp`` identifies the state of a file; None for a text.

    A file that could not be read has no ``path``.
    """

    digest: bytes
    path: Path | None
    stamp: FileStamp | None


UNREADABLE = SourceFile(b'', None, None)


class TreeFiles:
    """A reader of files in package shares and allowed directories, up to ``max_size`` bytes per file."""

    def __init__(self, allowed: Sequence[Path], max_size: int) -> None:
        self._allowed = tuple(allowed)
        self._max_size = max_size

    def read(self, name: str) -> tuple[bytes, SourceFile]:
        """Return content and state of a file. Raises ResourceError or OSError."""
        path = resolve_file(name, self._allowed)
        stamp = _stamp(path)
        with open(path, 'rb', opener=open_regular) as file:
            # Read one byte more than allowed, so that the parser refuses a longer file as too long.
            content = file.read(self._max_size + 1)
        named = Path(name) if name.startswith('/') else path  # its links may lead to another file later
        return content, SourceFile(hashlib.sha256(content).digest(), named, stamp)

    def are_current(self, sources: Mapping[str, SourceFile]) -> bool:
        """Return whether all these files are unchanged, by their stamps: one stat for each."""
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
    """A reader of the files of one document, each read once. ``sources`` are the files of the document: the file itself
    or ``text``, and the included files. ``length`` is the total length in bytes, with each file counted as often as it
    is included."""

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
        """Resolve an include; an :data:`IncludeResolver`."""
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
        """Return whether these sources still have the same content. If so, ``sources`` gets their present state."""
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
    # Programs can set back the time of the content (mtime), but not the time of the last status change (ctime).
    return status.st_ctime_ns, status.st_mtime_ns, status.st_size


def _stamp_now(path: Path) -> FileStamp | None:
    try:
        return _stamp(path)
    except OSError:
        return None
