# SPDX-License-Identifier: BSD-3-Clause
"""Findings for open files: the checker's, at their places in the text and in the graph, with edits that mend them."""

from __future__ import annotations

import difflib
import itertools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.errors import LoadError, Source
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.values.findings import FindingRecord, finding_record
from flexbt_studio.errors import GestureError
from flexbt_tools.behaviors.built_behavior import build, machine_file_entry
from flexbt_tools.behaviors.check import check_behavior
from flexbt_tools.errors import RefusedError
from flexbt_tools.mock_runs.mocks import is_instant, needs_mock
from flexbt_tools.tree_checks.check import check_trees
from flexbt_tools.tree_checks.diagnostics import (
    LOST_WRITE,
    NEVER_READ,
    NEVER_WRITTEN,
    REFUSED,
    UNDECLARED,
    UNUSED_PORT,
    UNUSED_TREE,
    Diagnostic,
)
from flexbt_tools.trees.files import read_library, shown_name
from flexbt_tools.trees.outline import Item, run_items
from flexbt_tools.trees.stand_ins import OpenRegistry

from .document import Document, Problem
from .project import Place, Project, tree_places
from .text import Span, TextEdit
from .xml_document import XmlDocument, nodes_of
from .xml_text import XmlElement

_MEANT: Final = re.compile(r"did you mean (?:\[([^\]]+)\]|'([^']+)')\?")
_WORD: Final = re.compile(r'[\w.:/-]+')
_QUOTED: Final = re.compile(r"""(?<=["'])[^"'<>&\\\n]+(?=["'])""")
_LIKENESS: Final = 0.5
"""Least likeness (difflib's ratio) of a word to the suggested one for which a fix replaces it."""


@dataclass(frozen=True, slots=True)
class Fix:
    """Edits that mend a finding. ``title`` says what they do."""

    title: str
    edits: list[TextEdit]


@dataclass(frozen=True, slots=True)
class Finding:
    """A finding of the checker in an open file.

    ``path`` is the node or state concerned in the view of the document, '' for none. ``record`` is what the tools print
    with ``--json``.
    """

    record: FindingRecord
    span: Span
    path: str = ''
    fixes: list[Fix] = field(default_factory=list)


class Checker:
    """The checkers for the files of a project, by their languages. A file of trees is checked with those of its
    sub-trees."""

    def __init__(self, project: Project, registry: NodeRegistry, skills: SkillLibrary) -> None:
        self._project = project
        self._registry = registry
        self._skills = skills

    def findings(self, file: str) -> list[Finding]:
        """Return the findings for a file, which is opened if it is not open. Raises StudioError."""
        document = self._project.open(file).document
        if document.language == 'xml':
            return self._of_trees(file)
        found = [_of_problem(document, problem) for problem in document.problems]
        if document.language == 'python':
            return found or [Finding(NOT_RUN, Span(0, 0))]
        behavior = build(machine_file_entry(file, document.text), ())  # makes the states of a machine, and runs none
        if behavior.machine is not None or not found:
            checked = check_behavior(behavior, [], self._registry, self._skills)
            found += _placed(document, [one.to_json(behavior.name) for one in checked], file)
        return sorted(found, key=lambda one: one.span)

    def located(self, file: str, name: str, records: Sequence[Mapping[str, Any]]) -> list[Finding]:
        """Return what ``behavior_tool check`` has found in a behavior in Python, which it knows by this name."""
        found = _placed(self._project.open(file).document, records, name)
        return sorted(found, key=lambda one: one.span)

    def _of_trees(self, file: str) -> list[Finding]:
        """Return the findings for a file with trees, in the order of their places. Raises StudioError."""
        document = self._project.trees(file)
        found = [_of_problem(document, problem) for problem in document.problems]
        nodes = document.view()['nodes']
        places = Places(document.text)
        for one in self._check(file, document.text, self._registry):
            if document.problems and one.rule is REFUSED:
                continue
            span = places.span(one.place)
            path = _innermost(nodes, span.start)
            fixes = list(_fixes(document, path, span, one.place.message))
            found.append(Finding(_record(one.to_json(), file), span, path, fixes))
        if any(one.record['rule'] == REFUSED.name for one in found):
            found += self._of_the_rest(file, document, {one.span.start for one in found})
        return sorted(found, key=lambda one: one.span)

    def nodes(self, file: str, tree: str = '') -> dict[str, tuple[str, str]]:
        """Return the file and the path in its view of each node of a tree, by the path of the node in a run.

        Without ``tree`` it is the main one. A file that cannot be read has none.
        """
        return {path: place for path, place, _ in self._run_items(file, tree)}

    def mocks(self, file: str, tree: str = '') -> list[dict[str, Any]]:
        """Return the nodes of a tree that need a mock in a run without a robot: ``run``, its path in a run, ``pattern``
        of a mock for it, its place (``file``, ``path``), ``type``, ``name``, whether it ``passes`` on what its child
        does, and whether it is ``instant``, that is never RUNNING."""
        return [
            {
                'run': path,
                'pattern': item.type if item.node.children else path,
                'file': place[0],
                'path': place[1],
                'type': item.type,
                'name': item.name,
                'passes': len(item.node.children) == 1,
                'instant': is_instant(item.node),
            }
            for path, place, item in self._run_items(file, tree)
            if needs_mock(item.node)
        ]

    def _run_items(self, file: str, tree: str) -> Iterator[tuple[str, tuple[str, str], Item]]:
        """Yield the nodes of a tree with their paths in a run, and their files and paths in views."""
        texts = {path: text.encode() for path, text in self._project.texts().items()}
        files = {str(self._project.root / one): one for one in self.files(file)}
        try:
            library = read_library(list(files), OpenRegistry(self._registry), texts)
        except RefusedError:
            return
        read = library.documents[shown_name(next(iter(files)))]
        id = tree or read.main or next(iter(read.trees), '')
        key = library.find(id, read.file)
        if key is None:
            return
        paths: dict[str, dict[int, str]] = {}
        for path, item in run_items(library, key):
            name = files.get(item.tree.error(item.node, '').file)
            if name is not None and name not in paths:
                paths[name] = {element.offset: own for element, own in self._project.trees(name).paths.items()}
            if name is not None:
                yield path, (name, paths[name].get(item.node.offset, '')), item

    def _check(self, file: str, text: str, registry: NodeRegistry) -> Iterator[Diagnostic]:
        """Yield what the checker finds in a file with this text."""
        files = [str(self._project.root / one) for one in self.files(file)]
        texts = {path: other.encode() for path, other in self._project.texts().items()} | {files[0]: text.encode()}
        found = check_trees(files, registry, skills=self._skills, texts=texts)
        return (one for one in found if one.place.file == files[0])

    def _of_the_rest(self, file: str, document: XmlDocument, refused: set[int]) -> Iterator[Finding]:
        """Yield what is found in a text when that is left out for which it is refused.

        Rules about keys and trees say nothing then: what is left out may use them.
        """
        registry = OpenRegistry(self._registry)
        for _ in range(_ATTEMPTS):
            text, origins = without(document, refused)
            places = Places(text)
            found = list(self._check(file, text, registry))
            again = {origins.get(places.span(one.place).start, -1) for one in found if one.rule is REFUSED}
            if again <= refused:
                break
            refused = refused | again
        if again:
            return
        for one in found:
            start = origins.get(places.span(one.place).start)
            if start is not None and one.rule.name not in _NEEDS_ALL:
                path = _innermost(document.view()['nodes'], start)
                yield Finding(_record(one.to_json(), file), Span(start, start + len(one.place.node)), path)

    def users(self, file: str) -> list[str]:
        """Return the other open files that use trees of other files: an edit of ``file`` may change their findings."""
        opened = ((name, one.document) for name, one in self._project.open_files.items() if name != file)
        trees = ((name, one) for name, one in opened if isinstance(one, XmlDocument))
        return [name for name, one in trees if any(_is_elsewhere(one, call) for call in one.subtrees)]

    def files(self, file: str) -> list[str]:
        """Return the file, then the files that define sub-trees of it and of one another; those nearest to it first."""
        wanted = [file]
        owners: dict[str, Place] | None = None
        for one in wanted:
            document = self._project.trees(one)
            missing = {call.attributes.get('ID') for call in document.subtrees if _is_elsewhere(document, call)}
            if missing and owners is None:
                owners = tree_places(self._project, file)
            found = (owners[id].file for id in sorted(filter(None, missing)) if owners and id in owners)
            wanted += [owner for owner in dict.fromkeys(found) if owner not in wanted]
        return wanted


def _is_elsewhere(document: XmlDocument, call: XmlElement) -> bool:
    """Return whether the tree of a sub-tree is not in its file."""
    return document.definition(call.attributes.get('ID')) is None


def _placed(document: Document, records: Sequence[Mapping[str, Any]], name: str) -> Iterator[Finding]:
    """Yield findings in the machines of a file at their lines, if they have some, or else at their states.

    ``name`` is that of the file in the records.
    """
    view = document.view()
    roots = {one.get(key): one['root'].rstrip('/') for one in view['behaviors'] for key in ('class', 'name')}
    spans = {state['path']: Span(*(state['label_span'] or state['span'])) for state in view['states']}
    places = Places(document.text, document.language)
    for one in records:
        path = roots.get(one.get('behavior', ''), '') + one['path'] if one.get('path') else ''
        while path and path not in spans:  # a state that code adds: the container of it
            path = path.rpartition('/')[0] or '/' * (path != '/' and '/' in spans)
        record, span = _record(one, document.file), spans.get(path, Span(0, 0))
        if one['file'] == name and one['line']:
            span = places.span(_place(record))
            if span.start == span.end:
                line = document.text[span.start :].partition('\n')[0].rstrip()
                span = Span(span.start + len(line) - len(line.lstrip()), span.start + len(line))
            path = _innermost(view['states'], span.start)
        yield Finding(record, span, path, list(_fixes(document, '', span, record['message'])))


NOT_RUN: Final = finding_record(
    'not-run',
    'info',
    'it is only read: the checker and proofs of a behavior in Python run its code',
    fix='allow that if you trust the code',
)
"""What is told of a behavior in Python until the user allows to run its code."""


_ATTEMPTS: Final = 4
_NEEDS_ALL: Final = frozenset(
    rule.name for rule in (NEVER_WRITTEN, UNDECLARED, LOST_WRITE, NEVER_READ, UNUSED_PORT, UNUSED_TREE)
)


def without(document: XmlDocument, refused: Collection[int]) -> tuple[str, dict[int, int]]:
    """Return the text of a document with its trees only, without the attributes and nodes that begin at the offsets
    ``refused``.

    Also return from where each tag and attribute comes, by its offset in the new text. A node that is left out stands
    as AlwaysSuccess.
    """
    parts: list[tuple[str, int]] = []  # texts, and where they come from; -1 for new ones

    def put(element: XmlElement) -> None:
        if element.offset in refused:
            parts.append(('<AlwaysSuccess/>', -1))
            return
        parts.append((f'<{element.tag}', element.offset))
        for part in (one for one in element.parts.values() if one.start not in refused):
            parts.extend(((' ', -1), (document.text[part.start : part.end], part.start)))
        parts.append(('>', -1))
        for child in nodes_of(element):
            put(child)
        parts.append((f'</{element.tag}>', -1))

    parts.append((f'<root BTCPP_format="{document.view()["format"] or 4}">', -1))
    for path, tree in document.trees.items():
        if tree.children:
            parts.append((f'<BehaviorTree ID="{path}">', -1))
            for child in tree.children:
                put(child)
            parts.append(('</BehaviorTree>', -1))
    parts.append(('</root>', -1))
    starts = itertools.accumulate((len(part) for part, _ in parts), initial=0)
    origins = {start: origin for start, (_, origin) in zip(starts, parts, strict=False) if origin >= 0}
    return ''.join(part for part, _ in parts), origins


def _record(found: Mapping[str, Any], file: str) -> FindingRecord:
    """Return a finding of the tools, with the name of the file in the project."""
    return FindingRecord(**{**{key: found[key] for key in FindingRecord.__annotations__}, 'file': file})  # type: ignore[typeddict-item]


def _place(record: FindingRecord) -> LoadError:
    end = record['end_line'], record['end_column']
    return LoadError(record['file'], record['line'], record['column'], record['node'], record['message'], end=end)


_LINE_BREAKS: Final = {'xml': '\n', 'python': '\r\n?|\n', 'yaml': '\r\n?|[\n\x85\u2028\u2029]'}
"""Patterns of the ends of lines, as the reader of each language counts lines."""


class Places:
    """The places that errors of the checker name in a text, as spans."""

    def __init__(self, text: str, language: str = 'xml') -> None:
        self._starts = [0, *(match.end() for match in re.finditer(_LINE_BREAKS[language], text))]
        self._length = len(text)

    def span(self, place: LoadError) -> Span:
        """Return the characters that an error is about; nothing at the beginning for the whole file."""
        if place.line == 0:
            return Span(0, 0)
        start = self._offset(place.line, place.column)
        end = self._offset(*place.end) if place.end[0] else start
        return Span(start, max(start, end))

    def _offset(self, line: int, column: int) -> int:
        return min(self._starts[min(line, len(self._starts)) - 1] + column - 1, self._length)


def _of_problem(document: Document, problem: Problem) -> Finding:
    place = Source(document.file, document.text).error(problem.span.start, problem.message)
    return Finding(Diagnostic(REFUSED, place).to_json(), problem.span)


def _innermost(nodes: Sequence[Mapping[str, Any]], offset: int) -> str:
    """Return the path of the innermost node that contains the character at ``offset``; '' if none does."""
    found = ''
    for node in nodes:  # parents come first
        start, end = node['span']
        if start <= offset < end:
            found = node['path']
    return found


def _fixes(document: Document, path: str, span: Span, message: str) -> Iterator[Fix]:
    """Yield the fix that a message suggests by "did you mean"."""
    meant = _MEANT.search(message)
    if meant is None:
        return
    name = meant[1] or meant[2]
    written = _WORD if _WORD.fullmatch(name) else _QUOTED  # a name of several words is replaced as a whole
    if name not in written.findall(f'"{name}"'):  # it would have to be escaped
        return
    words = list(written.finditer(document.text, span.start, max(span.end, span.start + 1)))
    likeness = [difflib.SequenceMatcher(None, word[0], name).ratio() for word in words]
    if not words or max(likeness) < _LIKENESS or name in [word[0] for word in words]:
        return
    word = words[likeness.index(max(likeness))]
    title = f'Replace {word[0]} by {name}'
    if document.text[word.start() - 1] == '<' and path:
        try:
            yield Fix(title, document.gesture('set_type', {'node': path, 'type': name}))
        except GestureError:
            return
    else:
        yield Fix(title, [TextEdit(word.start(), word.end(), name)])
