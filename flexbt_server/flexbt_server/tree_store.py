# SPDX-License-Identifier: BSD-3-Clause
"""The trees that the server has loaded: all of a request is taken, or nothing of it.

Files are read on a worker thread of its own, one request after the other; the library that goals see is exchanged
as a whole.
"""

from __future__ import annotations

import hashlib
import posixpath
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from flexbt_common.errors import ResourceError
from flexbt_common.resources import resolve_file
from flexbt_msgs.msg import BtLoadReport
from flexbt_server.behavior_tree import (
    LoadError,
    NodeRegistry,
    TreeDocument,
    TreeKey,
    TreeLibrary,
    TreeLoadError,
    load_xml,
)
from flexbt_server.errors import UnknownTreeError

XML_TEXT: Final = '<xml>'
"""Name, in reports, of XML text that came with a goal."""

_TEXT_PREFIX: Final = '<xml '
"""How the names of such texts begin in the library."""


@dataclass
class FileReport:
    """What became of one file; ``code`` is a constant of BtLoadReport."""

    file: str
    code: int = BtLoadReport.UNKNOWN
    trees: tuple[str, ...] = ()
    errors: list[LoadError] = field(default_factory=list)


@dataclass(frozen=True)
class _Loaded:
    """A file that is in use. ``stamp`` are time and size of the file when it was read; None for text."""

    digest: bytes
    stamp: tuple[int, int] | None


class TreeStore:
    """Loads documents and finds trees. Safe to use from several threads."""

    def __init__(
        self, registry: NodeRegistry, allowed_directories: Sequence[Path], max_file_size: int, max_depth: int
    ) -> None:
        self.registry = registry
        self._allowed = tuple(allowed_directories)
        self._max_file_size = max_file_size
        self._max_depth = max_depth
        self._library = TreeLibrary()
        self._loaded: dict[str, _Loaded] = {}
        self._lock = threading.RLock()

    @property
    def library(self) -> TreeLibrary:
        """What is loaded now; it never changes, a load exchanges it."""
        return self._library

    def load(
        self, files: Sequence[str], xml: str = '', progress: Callable[[str, int], bool] | None = None
    ) -> list[FileReport]:
        """Load files and XML text: everything, or nothing when anything is refused.

        ``progress(file, done)`` is told before each file and stops the load, with nothing loaded, by returning False.
        One report per file in the order of the request, that of the text last.
        """
        with self._lock:
            reports: list[FileReport] = []
            documents: list[TreeDocument] = []
            loaded: dict[str, _Loaded] = {}
            requests = [(file, file) for file in files]
            if xml:
                requests.append((XML_TEXT, f'{_TEXT_PREFIX}{hashlib.sha256(xml.encode()).hexdigest()[:8]}>'))
            for done, (shown, name) in enumerate(requests):
                report = FileReport(shown)
                reports.append(report)
                if progress is not None and not progress(shown, done):
                    return reports
                self._read(report, name, xml.encode() if shown == XML_TEXT else None, documents, loaded)
            self._take(reports, documents, loaded)
            return reports

    def find(self, name: str) -> tuple[TreeLibrary, TreeKey]:
        """The tree that a goal names, by ID or by file, with the library to run it from.

        A file is loaded when it is not, and loaded again when it has changed.

        Raises:
            UnknownTreeError: there is no such tree, or its file is refused; says why.
        """
        with self._lock:
            is_file = '/' in name or name.endswith('.xml')
            file = name if is_file else self._file_of(name)
            if file is not None and self._is_outdated(file):
                self._reload(file)
            library = self._library
            if not is_file:
                key = library.find(name)
                if key is None:
                    raise UnknownTreeError(self._no_such_tree(name))
                return library, key
            document = library.documents[name]
            if document.main is None:
                trees = ', '.join(sorted(document.trees)) or 'none'
                raise UnknownTreeError(
                    f'{name}: does not say which tree ({trees}) to execute; set main_tree_to_execute, or name one'
                )
            return library, TreeKey(name, document.main)

    def _file_of(self, tree: str) -> str | None:
        key = self._library.find(tree)
        return None if key is None else key.file

    def _is_outdated(self, file: str) -> bool:
        loaded = self._loaded.get(file)
        if loaded is None:
            return True
        if loaded.stamp is None:
            return False
        try:
            return _stamp(resolve_file(file, self._allowed)) != loaded.stamp
        except (ResourceError, OSError):
            return True

    def _reload(self, file: str) -> None:
        (report,) = self.load([file])
        if report.code == BtLoadReport.REFUSED:
            reasons = '; '.join(str(error) for error in report.errors)
            raise UnknownTreeError(f'tree file refused: {reasons}')

    def _no_such_tree(self, name: str) -> str:
        known = ', '.join(sorted(self._library.tree_ids())) or 'none is loaded'
        return f'there is no tree {name!r}; load its file with BtLoad, or name the file. Known trees: {known}'

    def _read(
        self,
        report: FileReport,
        name: str,
        text: bytes | None,
        documents: list[TreeDocument],
        loaded: dict[str, _Loaded],
    ) -> None:
        try:
            content, stamp = (text, None) if text is not None else self._content(report.file)
            digest = hashlib.sha256(content).digest()
            known = self._loaded.get(name)
            if known is not None and known.digest == digest:
                report.code = BtLoadReport.UNCHANGED
                document = self._library.documents[name]
                report.trees = tuple(document.trees)
                loaded[name] = _Loaded(digest, stamp)
                if any(self._library.find(id) != TreeKey(name, id) for id in document.trees):
                    documents.append(document)  # its trees are the newest of their names again
                return
            document = load_xml(
                content,
                name,
                self.registry,
                include=self._include,
                max_bytes=self._max_file_size,
                max_depth=self._max_depth,
            )
        except TreeLoadError as error:
            report.code = BtLoadReport.REFUSED
            report.errors.extend(error.errors)
        except (ResourceError, OSError) as error:
            report.code = BtLoadReport.REFUSED
            report.errors.append(LoadError(report.file, 0, 0, '', _without_name(error, report.file)))
        else:
            report.code = BtLoadReport.VALID
            report.trees = tuple(document.trees)
            documents.append(document)
            loaded[name] = _Loaded(digest, stamp)

    def _take(self, reports: list[FileReport], documents: list[TreeDocument], loaded: dict[str, _Loaded]) -> None:
        if any(report.code == BtLoadReport.REFUSED for report in reports):
            return
        try:
            forgotten = self._replaced_texts(documents)
            library = self._library.stage(documents, without=forgotten)
        except TreeLoadError as error:
            self._blame(reports, error)
            return
        self._library = library
        self._loaded |= loaded
        for name in forgotten:
            del self._loaded[name]
        for report in reports:
            if report.code == BtLoadReport.VALID:
                report.code = BtLoadReport.LOADED

    def _replaced_texts(self, documents: Sequence[TreeDocument]) -> set[str]:
        """XML texts of which no tree can be named any more, once ``documents`` are loaded: newer ones have taken the
        names of all. They would be kept for ever."""
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

    def _content(self, file: str) -> tuple[bytes, tuple[int, int]]:
        path = resolve_file(file, self._allowed)
        stamp = _stamp(path)
        with path.open('rb') as content:
            # One byte more than may be read: the reader refuses it as too long, with its place.
            return content.read(self._max_file_size + 1), stamp

    def _include(self, path: str, package: str | None, including: str) -> tuple[str, str | bytes]:
        if package:
            name = f'{package}/{path}'
        elif path.startswith('/') or including.startswith('<'):
            name = path
        else:
            name = posixpath.normpath(f'{including.rpartition("/")[0]}/{path}')
        try:
            return name, self._content(name)[0]
        except ResourceError as error:
            raise OSError(_without_name(error, name)) from error


def _stamp(path: Path) -> tuple[int, int]:
    status = path.stat()
    return status.st_mtime_ns, status.st_size


def _without_name(error: Exception, name: str) -> str:
    return str(error).removeprefix(f'{name}: ')
