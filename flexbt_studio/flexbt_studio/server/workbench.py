# SPDX-License-Identifier: BSD-3-Clause
"""What the pages of the studio work on together: one project, its checker, its palette, and their requests.

A request is a method of :class:`Workbench` that is marked :func:`request`; its arguments and its result are JSON
values. Offsets in them count as :mod:`.page_text` says.
"""

from __future__ import annotations

import difflib
import inspect
import os
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, TypeVar

from flexbt_core.behavior_tree.engine.registry import node_skills
from flexbt_core.behavior_tree.model.definition import NodeManifest
from flexbt_core.errors import FlexbtError
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_onboard.behaviors.machine_behavior import installed_states
from flexbt_server.node_types import node_registry
from flexbt_studio.documents.comparison import compared
from flexbt_studio.documents.diagnostics import Checker
from flexbt_studio.documents.document import Document, Problem
from flexbt_studio.documents.editor_help import MachineHelp, TreeHelp
from flexbt_studio.documents.flow import flow, keys_of_group
from flexbt_studio.documents.names import Mention, Names
from flexbt_studio.documents.palette import node_types, states
from flexbt_studio.documents.project import MOST_BYTES, Project, document_for, tree_places
from flexbt_studio.documents.text import Lines, TextEdit, applied
from flexbt_studio.documents.xml_document import XmlDocument
from flexbt_studio.errors import ConflictError, StudioError
from flexbt_studio.tool_process import ToolCopy, behavior_copy, check_copy, new_folder

from .page_text import PageText, shown
from .proposals import (
    GOAL_JOBS,
    add_palette,
    chosen_types,
    goal_copy,
    goals,
    models_of,
    models_text,
    palette_files,
    with_models,
    with_result,
)

_Request = TypeVar('_Request', bound=Callable[..., Any])
_MARK: Final = '_is_request'
_PLAN: Final = 'mocks.yaml'
MOST_EDITS: Final = 1000
"""Maximum number of edits that are kept of a file, for pages that were not connected meanwhile."""
MOST_KEPT: Final = 100_000
"""Length of an edit, characters, from which on neither it nor those before it are kept."""


def request(method: _Request) -> _Request:
    """Mark a method of :class:`Workbench` that pages may call."""
    setattr(method, _MARK, True)
    return method


class Workbench:
    """One project and what is known about it. Used from one thread at a time."""

    def __init__(self, root: str | Path) -> None:
        self.project = Project(root)
        self.notes: list[str] = []
        """What could not be loaded when the studio started."""
        self._registry = node_registry(lambda nodes, error: self.notes.append(f'without {nodes}: {error}'))
        self._skills: SkillLibrary = node_skills(self._registry, self.notes.append)
        classes, broken = installed_states()
        self._states = states(classes)
        self.notes += broken
        for file in palette_files(self.project):
            self.notes += add_palette(self._registry, file, self.project.text(file))
        self._checker = Checker(self.project, self._registry, self._skills)
        self._names = Names(self.project, self._registry, self._checker, self._states)
        self._help = TreeHelp(self.project, self._registry)
        self._machine_help = MachineHelp(self.project, self._states)
        self._edits: dict[str, deque[tuple[int, list[Any], str]]] = {}
        """The last edits of each file: the version that each has made, its edits, and its key."""

    def job_copy(
        self,
        job: str,
        file: str,
        tree: str = '',
        require: Sequence[str] = (),
        mock: Sequence[str] = (),
        set: Sequence[str] = (),
        plan: str = '',
        **asked: Any,
    ) -> ToolCopy:
        """Return the copy of the project for a job: ``prove``, ``compare`` (with what is on disk), or ``run``.

        Jobs for goals need no ``file``; what is ``asked`` for is as in :func:`.proposals.goal_copy`.

        ``require`` are requirements of a proof, ``mock`` and ``set`` what leaves do and what the blackboard has in a
        run, as the tools take them. ``plan`` is the text of a file of mocks.
        """
        if job in GOAL_JOBS:
            return goal_copy(self.project, job, **asked)
        document = self.project.open(file).document
        is_tree = document.language == 'xml'
        if asked or job not in ('prove', 'compare', 'run') or (job == 'run' and not is_tree):
            raise StudioError(
                f'{file}: there is no job {short_repr(job)} for it; there are prove, compare, and run for trees'
            )
        if document.language == 'python':
            return self._behavior_job(job, file, document, require)
        files = self._checker.files(file) if is_tree else [file]
        texts, words = _with_trees(self.project, file), ['run' if job == 'run' else 'prove', '--json']
        if job == 'compare':  # it may have had other sub-trees
            before = self.project.unedited()
            old = Checker(before, self._registry, self._skills).files(file) if is_tree else [file]
            files += [one for one in old if one not in files]
            texts |= {f'before/{one}': text for one, text in _with_trees(before, file).items()}
            words += [f'--against=before/{one}' for one in _having_trees(before, files)]
        palettes = palette_files(self.project) if is_tree else []
        for one in palettes:
            texts[one] = self.project.text(one)
            words.append(f'--models={one}')
        if plan:
            texts[_PLAN] = plan
            words += ['--mock', _PLAN]
        words += [f'--tree={tree}'] if tree and is_tree else []
        for flag, values in (('--require', require), ('--mock', mock), ('--set', set)):
            words += [f'{flag}={value}' for value in values]
        words += ['--', *_having_trees(self.project, files)]  # what is written or named may begin with a dash
        nodes = self._checker.nodes(file, tree) if is_tree else {}
        tool = 'bt_tool' if is_tree else 'behavior_tool'
        return ToolCopy(new_folder(texts), tool, words, nodes, [*files, *palettes])

    def _behavior_job(self, job: str, file: str, document: Document, require: Sequence[str]) -> ToolCopy:
        """Return the copy for a proof or comparison of a behavior in Python, the first one of its file."""
        name, texts, saved = behavior_copy(self.project, file)
        top = self.project.path(file).parents[name.count('/')]
        files = [os.path.relpath(top / one, self.project.root) for one in texts]
        behavior = document.view()['behavior']
        name += f':{behavior["class"]}' if behavior else ''
        words = ['prove', '--json', *(f'--require={one}' for one in require)]
        if job == 'compare':
            texts = texts | {f'before/{one}': text for one, text in saved.items()}
            words.append(f'--against=before/{name}')
        return ToolCopy(new_folder(texts), 'behavior_tool', [*words, '--', name], files=files)

    def check_copy(self, file: str) -> tuple[int, str, ToolCopy]:
        """Return version, name and copy of a behavior in Python for its check. Raises StudioError."""
        return self.project.open(file).version, *check_copy(self.project, file)

    def located(self, file: str, version: int, name: str, records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Return what a check of this version has found, with places in the text. Raises ConflictError if it is old."""
        opened = self.project.open(file)
        if opened.version != version:
            raise ConflictError(f'{file} was edited during its check')
        page = PageText(opened.document.text)
        found = self._checker.located(file, name, records)
        return {'version': version, 'findings': [shown_finding(asdict(one), page) for one in found]}

    def states(self, file: str) -> list[dict[str, Any]]:
        """Return the states of a machine as its view has them. Raises StudioError."""
        states: list[dict[str, Any]] = self.project.open(file).document.view().get('states', [])
        return states

    def answer(self, method: str, arguments: dict[str, Any]) -> Any:
        """Return the result of a request.

        Raises:
            StudioError: there is no such request, its arguments are wrong, or it cannot be done.
        """
        called = getattr(self, method, None) if method.isidentifier() else None
        if called is None or not hasattr(called, _MARK):
            known = [name for name, member in inspect.getmembers(type(self)) if hasattr(member, _MARK)]
            raise StudioError(f'there is no request {short_repr(method)}{did_you_mean(method, known)}')
        try:
            inspect.signature(called).bind(**arguments)
        except TypeError as error:
            raise StudioError(f'{method}: {error}') from error
        try:
            return called(**arguments)
        except (TypeError, ValueError, KeyError, AttributeError) as error:
            raise StudioError(f'{method}: wrong arguments: {error}') from error
        except StudioError:
            raise
        except FlexbtError as error:
            raise StudioError(str(error)) from error

    @request
    def hello(self) -> dict[str, Any]:
        """Return what a page needs first: the name of the project, its files, and the palette."""
        return {
            'project': self.project.root.name,
            'folder': str(self.project.root),
            'files': self.files(),
            'node_types': node_types(self._registry),
            'states': self._states,
            'notes': self.notes,
        }

    @request
    def files(self) -> list[dict[str, Any]]:
        """Return the files of the project and of those that are open whether they are changed."""
        opened = self.project.open_files
        found = {one['file']: one for one in self.project.files()}
        for file in opened:
            found.setdefault(file, {'file': file, 'kind': opened[file].document.language})
        return [
            {**one, 'open': name in opened, 'changed': name in opened and opened[name].is_changed}
            for name, one in sorted(found.items())
        ]

    @request
    def open(self, file: str, version: int = 0) -> dict[str, Any]:
        """Open a file and return its text and graph, and the edits ``since`` a version; None if they are not known."""
        opened = self.project.open(file)
        opened.stamp = None  # so that the page is told if it was changed on disk
        since = [one for one in self._edits.get(file, ()) if one[0] > version]
        is_known = 0 < version <= opened.version and len(since) == opened.version - version
        return {**self.model(file), 'since': since if is_known else None}

    @request
    def create(self, file: str, text: str) -> dict[str, Any]:
        """Open a new file with this text. It is on disk when it is saved."""
        self.project.create(file, text)
        return self.model(file)

    @request
    def close(self, file: str) -> None:
        """Close a file and forget its unsaved edits."""
        self.project.close(file)

    @request
    def model(self, file: str) -> dict[str, Any]:
        """Return text, version, graph and gestures of an open file."""
        opened = self.project.open(file)
        document = opened.document
        page = PageText(document.text)
        return {
            'file': file,
            'language': document.language,
            'version': opened.version,
            'changed': opened.is_changed,
            'text': shown(document.text),
            'view': page.spans_to_page(self._view(document)),
            'gestures': [] if opened.is_shown_only else list(document.gestures()),
            'problems': [self._problem(document, page, one) for one in document.problems],
        }

    @staticmethod
    def _problem(document: Document, page: PageText, problem: Problem) -> dict[str, Any]:
        line, column = Lines(document.text).position(problem.span.start)
        span = [page.to_page(problem.span.start), page.to_page(problem.span.end)]
        return {'message': problem.message, 'line': line + 1, 'column': column + 1, 'span': span}

    def _view(self, document: Document) -> dict[str, Any]:
        view = document.view()
        models = {one['id']: one['kind'] for one in view.get('models', ())}
        for node in view.get('nodes', ()):
            manifest: NodeManifest | None = self._registry.get(node['type'])
            kind = models.get(node['type'], '') if manifest is None else manifest.kind.value
            node['kind'] = 'subtree' if node['tag'].startswith('SubTree') else kind
        return view

    @request
    def run_nodes(self, file: str, tree: str = '') -> dict[str, list[str]]:
        """Return the file and the path in its view of each node of a tree, by the path of the node in a run."""
        return {path: list(place) for path, place in self._checker.nodes(file, tree).items()}

    @request
    def mocks(self, file: str, tree: str = '') -> list[dict[str, Any]]:
        """Return what needs a mock in a dry run of a tree, see :meth:`.Checker.mocks`."""
        return self._checker.mocks(file, tree)

    def tree_texts(self, file: str) -> dict[str, str]:
        """Return the texts of a file of trees and of the files that have its sub-trees, by their names."""
        return {one: self.project.text(one) for one in self._checker.files(file)}

    def question(self, file: str) -> dict[str, Any]:
        """Return what a check of an open file is about: its version, and for a machine what its worker is asked."""
        opened = self.project.open(file)
        question: dict[str, Any] = {'version': opened.version, 'language': opened.document.language}
        if opened.document.language == 'yaml':
            question |= {'root': str(self.project.root), 'file': file, 'text': opened.document.text}
        return question

    def users(self, file: str) -> list[str]:
        """Return the open files whose findings an edit of a file may change, see :meth:`.Checker.users`."""
        return self._checker.users(file)

    def checked(self, file: str) -> dict[str, Any]:
        """Return version and findings of an open file. Raises ConflictError if it was closed."""
        if file not in self.project.open_files:
            raise ConflictError(f'{file} was closed')
        return {'version': self.project.open(file).version, 'findings': self.findings(file)}

    @request
    def findings(self, file: str) -> list[dict[str, Any]]:
        """Return the checker's findings for an open file; none for what a program sends, which runs as it is."""
        opened = self.project.open(file)
        page = PageText(opened.document.text)
        found = [] if opened.is_shown_only else self._checker.findings(file)
        return [shown_finding(asdict(one), page) for one in found]

    @request
    def edit(self, file: str, version: int, edits: list[Any], key: str = '') -> int:
        """Apply edits to a version of an open file, and return the new version. Raises ConflictError.

        By the ``key`` a page that has lost the answer finds them again, see :meth:`open`.
        """
        page = PageText(self.project.open(file).document.text)
        opened = self.project.edit(file, version, page.edits_from_page(edits))
        kept = self._edits.setdefault(file, deque(maxlen=MOST_EDITS))
        if sum(len(text) for _, _, text in edits) < MOST_KEPT:
            kept.append((opened.version, edits, key))
        else:
            kept.clear()
        return opened.version

    @request
    def gesture(self, file: str, version: int, name: str, arguments: dict[str, Any]) -> list[Any]:
        """Return the edits that carry out a gesture, without applying them.

        A group hands on the keys of its states, unless its ``keys`` are given.
        """
        if name == 'group' and 'keys' not in arguments and isinstance(arguments.get('states'), list):
            keys = keys_of_group(self.project.document(file), arguments['states'], self._states)
            arguments = {**arguments, 'keys': keys}
        edits = self.project.gesture(file, version, name, arguments)
        return PageText(self.project.open(file).document.text).edits_to_page(edits)

    @request
    def completions(self, file: str, offset: int) -> list[dict[str, Any]]:
        """Return what may stand at an offset of an open file, the likeliest first."""
        document = self.project.open(file).document
        page = PageText(document.text)
        helpers: dict[str, TreeHelp | MachineHelp] = {'xml': self._help, 'yaml': self._machine_help}
        helper = helpers.get(document.language)
        found = [] if helper is None else helper.completions(file, page.from_page(offset))
        return [{**one._asdict(), 'span': [page.to_page(one.span.start), page.to_page(one.span.end)]} for one in found]

    @request
    def flow(self, file: str) -> list[dict[str, Any]]:
        """Return the keys of each tree or container of a file, with what uses them, see :mod:`.documents.flow`."""
        page = PageText(self.project.text(file))
        return list(page.spans_to_page(flow(self.project, file, self._states)))

    @request
    def name(self, file: str, offset: int) -> dict[str, str]:
        """Return what the name at an offset means: ``kind``, ``name``, and the ``file`` that defines it."""
        return self._names.at(file, PageText(self.project.text(file)).from_page(offset))._asdict()

    @request
    def uses(self, file: str, offset: int) -> dict[str, Any]:
        """Return what the name at an offset means (``kind``, ``name``), and where it is used in all files."""
        named = self._names.at(file, PageText(self.project.text(file)).from_page(offset))
        return {**named._asdict(), 'uses': [self._mention(one) for one in self._names.uses(named)]}

    @request
    def rename(self, file: str, offset: int, new: str) -> dict[str, Any]:
        """Return the edits that rename in all files what the name at an offset means, without applying them.

        They are for the versions that are told with them. ``notes`` are places that may mean it and stay.

        Raises:
            ConflictError: a file that it concerns was changed on disk.
            StudioError: there is nothing to rename, or the new name does not fit.
        """
        named = self._names.at(file, PageText(self.project.text(file)).from_page(offset))
        made = self._names.rename(named, new)
        foreign = set(made.edits) & set(self.project.changed_on_disk())
        if foreign:
            raise ConflictError(f'{", ".join(sorted(foreign))} was changed on disk by another program; save it first')
        files = []
        for one, edits in made.edits.items():
            before, after = self.project.text(one), applied(self.project.text(one), edits)
            lines = difflib.unified_diff(shown(before).splitlines(), shown(after).splitlines(), n=0, lineterm='')
            edited = PageText(before).edits_to_page(edits)
            files.append({'file': one, 'version': self.project.version(one), 'edits': edited, 'lines': [*lines]})
        return {**named._asdict(), 'files': files, 'notes': [self._mention(one) for one in made.notes]}

    def _mention(self, mention: Mention) -> dict[str, Any]:
        text = self.project.text(mention.file)
        page, lines = PageText(text), Lines(text)
        line = lines.line(mention.span.start)
        return {
            'file': mention.file,
            'line': line + 1,
            'span': [page.to_page(offset) for offset in mention.span],
            'text': mention.text,
            'source': text[lines.start(mention.span.start) : lines.end(mention.span.start)].strip(),
        }

    @request
    def trees(self, file: str) -> dict[str, str]:
        """Return the file of each tree of the project by its ID. If several have an ID, that near ``file`` counts."""
        return {id: place.file for id, place in tree_places(self.project, file).items()}

    def compared(self, file: str, before: str, after: str) -> dict[str, Any]:
        """Return what has changed between two texts of a file, see :func:`.comparison.compared`. From any thread."""
        if len(before) + len(after) > MOST_BYTES:
            raise StudioError(f'both texts have more than {MOST_BYTES} characters, too many for a picture')
        documents = [document_for(file, text) for text in (before, after)]
        found = compared(*(PageText(one.text).spans_to_page(self._view(one)) for one in documents))
        return {**found, 'problems': [problem.message for one in documents for problem in one.problems]}

    @request
    def goals(self) -> list[dict[str, Any]]:
        """Return the goals that can be planned or synthesized for, see :func:`.proposals.goals`."""
        return goals(self.project)

    @request
    def with_result(self, file: str, result: str) -> str:
        """Return the text of an open file with the result of a job for a goal in it."""
        return shown(with_result(self.project.open(file).document, result))

    @request
    def models(self, file: str, into: bool) -> str:
        """Return models of node types: a file with those that ``file`` uses (all if it is ''), or ``into`` its text."""
        document = self.project.open(file).document if file else None
        types = chosen_types(self._registry, document)
        if not types:
            raise StudioError(f'{file} uses only node types of BehaviorTree.CPP, which editors know')
        if into and isinstance(document, XmlDocument):
            return shown(with_models(document, models_text(types)))
        return models_text(types)

    @request
    def import_models(self, file: str, text: str) -> dict[str, Any]:
        """Open a new file with the models of another one, and make their node types known. Return it, and all types."""
        made = models_of(text)
        self.project.create(file, made)
        known = {one.id for one in self._registry}
        problems = add_palette(self._registry, file, made)
        added = [one.id for one in self._registry if one.id not in known]
        return {'model': self.model(file), 'types': node_types(self._registry), 'added': added, 'problems': problems}

    @request
    def clip(self, file: str, part: str) -> str:
        """Return the text of a node or state for the clipboard, without its indentation."""
        clip: Callable[[str], str] | None = getattr(self.project.open(file).document, 'clip', None)
        if clip is None:
            raise StudioError(f'{file}: parts of this kind of file cannot be copied')
        return shown(clip(part))

    @request
    def difference(self, file: str) -> list[str]:
        """Return what a save would change on disk, as the lines of a unified diff."""
        opened = self.project.open(file)
        before = shown(opened.saved_text).splitlines()
        return list(difflib.unified_diff(before, shown(opened.document.text).splitlines(), file, file, lineterm=''))

    @request
    def save(self, file: str, version: int, over: str = '') -> dict[str, Any]:
        """Write a version of an open file to disk. Raises ConflictError if somebody else has changed it there."""
        opened = self.project.save(file, version, over=over or None)
        return {'version': opened.version, 'changed': opened.is_changed}

    @request
    def take_disk(self, file: str) -> str | None:
        """Take the text on disk as the saved one and return it; None if another page has done so."""
        text = self.project.take_disk(file)
        return None if text is None else shown(text)

    @request
    def on_disk(self, file: str) -> dict[str, str]:
        """Return the text that is on disk now, and its identity for ``save``."""
        text, disk = self.project.text_on_disk(file)
        return {'text': shown(text), 'disk': disk}


def _with_trees(project: Project, file: str) -> dict[str, str]:
    """Return the texts of a file, and of the files with trees that can be read, which it may use."""
    return {one: tree.text for one, tree in project.tree_files()} | {file: project.text(file)}


def _having_trees(project: Project, files: Sequence[str]) -> list[str]:
    """Return the first of these files, and those of the others that have trees in this project."""
    known = {one for one, tree in project.tree_files() if tree.trees}
    return [*files[:1], *(one for one in files[1:] if one in known)]


def shown_finding(finding: Mapping[str, Any], page: PageText) -> dict[str, Any]:
    """Return a finding, as plain data, with the offsets of the page."""
    fixes = [{'title': one['title'], 'edits': [TextEdit(*edit) for edit in one['edits']]} for one in finding['fixes']]
    return {
        **finding['record'],
        'path': finding['path'],
        'span': [page.to_page(offset) for offset in finding['span']],
        'fixes': [{**one, 'edits': page.edits_to_page(one['edits'])} for one in fixes],
    }
