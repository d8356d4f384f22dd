# SPDX-License-Identifier: BSD-3-Clause
"""What may be put into an open file: the tree of a plan, a synthesized machine, models of node types."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Sequence
from importlib.metadata import entry_points
from typing import Any, Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import NodeManifest
from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.values.text import short_repr
from flexbt_server.groot2.protocol import models_document
from flexbt_studio.documents.document import Document
from flexbt_studio.documents.project import Project
from flexbt_studio.documents.text import LINE_BREAK, Span, TextEdit, applied
from flexbt_studio.documents.xml_document import XmlDocument
from flexbt_studio.documents.yaml_document import YamlDocument
from flexbt_studio.errors import StudioError
from flexbt_studio.tool_process import ToolCopy, new_folder
from flexbt_tools.errors import missing_package
from flexbt_tools.trees.stand_ins import add_models

GOAL_JOBS: Final = {'plan': 'bt_tool', 'synthesize': 'behavior_tool'}
"""Jobs that make something for a goal, and the tool of each."""
MOST_LETTERS: Final = 20_000
"""Maximum length of what is asked for."""
_YAML: Final = {'.yaml', '.yml'}
_MISSION: Final = re.compile(r'^(?:start|goal)\s*:', re.MULTILINE)
_GOAL: Final = re.compile(r'^goal\s*:[ \t]*(.+?)[ \t]*(?:[ \t]#.*)?$', re.MULTILINE)
_CAPABILITIES: Final = re.compile(r'^capabilities\s*:', re.MULTILINE)
_CAPABILITY: Final = re.compile(r'^[ ]+([A-Za-z_]\w*)\s*:[^\n]*\n(?=(?:[ ]+#[^\n]*\n)*[ ]+interface\s*:)', re.MULTILINE)
_REQUEST: Final = re.compile(r'^goals\s*:', re.MULTILINE)
_REST: Final = re.compile(r'[^\r\n]*(?:(?:\r\n?|\n)[ \t]+[^\s][^\r\n]*)*')


# Plans and machines for goals.


def goals(project: Project) -> list[dict[str, Any]]:
    """Return what can be asked for, by the files of a project: ``job``, ``source`` (a mission, or capabilities),
    ``request`` (a file, or ''), the ``goal`` that it has, and ``words`` of which goals are made.

    Raises StudioError if flexbt_formal is not installed, or there is no such file.
    """
    installed = entry_points(group='flexbt.commands').names
    if not {f'{tool}.{job}' for job, tool in GOAL_JOBS.items()} <= installed:
        raise StudioError(str(missing_package('planning and synthesis')))
    texts = dict(project.texts_with(_YAML))
    requests = [file for file, text in texts.items() if _REQUEST.search(text)]
    found = []
    for file, text in texts.items():
        if _CAPABILITIES.search(text):
            words = _CAPABILITY.findall(text)
            for request in ('', *requests):
                found.append({'job': 'synthesize', 'source': file, 'request': request, 'goal': '', 'words': words})
        elif _MISSION.search(text):
            goal = _GOAL.search(text)
            stated = goal[1].strip('\'"') if goal else ''
            found.append({'job': 'plan', 'source': file, 'request': '', 'goal': stated, 'words': []})
    if not found:
        raise StudioError(
            'no file of this project says what the robot can do: a plan needs a mission (YAML: skills, start, goal), '
            'a machine needs capabilities (YAML); see the guides From a goal to a tree, and Make a machine'
        )
    return found


def goal_copy(
    project: Project,
    job: str,
    source: str,
    request: str = '',
    goal: str = '',
    start: Sequence[str] = (),
    name: str = '',
) -> ToolCopy:
    """Return the copy for a job that makes something for a ``goal``: ``plan`` or ``synthesize``.

    ``source`` and ``request`` are files, see :func:`goals`. ``start`` has what holds at the start, ``name`` is the ID
    of a planned tree. What is empty is as the files say.
    """
    words = [str(one) for one in (goal, name, *start)]
    if job not in GOAL_JOBS or sum(map(len, words)) > MOST_LETTERS:
        raise StudioError(f'a goal is for one of {", ".join(GOAL_JOBS)}, and has at most {MOST_LETTERS} letters')
    texts = dict(project.texts_with(_YAML))
    for file in (source, *filter(None, [request])):
        if file not in texts:
            raise StudioError(f'{short_repr(file)} is no YAML file of this project any more; choose another one')
    options = [f'--goal={goal}'] if goal else []
    options += [f'{"--start" if job == "plan" else "--initial"}={one}' for one in start]
    options += [f'--name={name}'] if name and job == 'plan' else []
    options += [f'--request={request}'] if request else []
    return ToolCopy(new_folder(texts), GOAL_JOBS[job], [job, '--json', *options, '--', source])


def with_result(document: Document, result: str) -> str:
    """Return the text of a document with the trees of a plan, or the synthesized machine, in it.

    Trees take the place of those with the same IDs, or come behind the others; models of node types that are not
    installed come with them. A machine takes the place of the machine.
    Raises StudioError if the document has no place for it.
    """
    if isinstance(document, XmlDocument):
        made = XmlDocument(result)
        for id in made.trees:
            document = XmlDocument(applied(document.text, _tree_edits(document, made, id)), document.file)
        return with_models(document, result)
    new = YamlDocument(result)
    span, written = _machine(document), _machine(new)
    if span is None or written is None:
        raise StudioError(f'{document.file} has no machine in YAML on lines of its own; make a new file of the result')
    return applied(document.text, [TextEdit(*span, LINE_BREAK.sub(document.line_break, new.source(written)))])


def _machine(document: Document) -> Span | None:
    """Return the lines of the machine of a file, with the comments in it; None if it has none that can be replaced."""
    if not isinstance(document, YamlDocument) or document.unreadable or not document.roots:
        return None
    root = document.roots[0][1]
    start, end = root.span
    before = document.text[document.lines.start(start) : start]
    rest = _REST.match(document.text, end)
    is_apart = root.tables['entries'].inner is None and before in ('', '\ufeff')
    return Span(start, rest.end() if rest else end) if is_apart else None


def _tree_edits(document: XmlDocument, made: XmlDocument, id: str) -> list[TextEdit]:
    """Return the edits that put a tree of another document into a document."""
    tree, old = made.trees[id], document.trees.get(id)
    if old is None:
        return document.gesture('add_tree', {'id': id, 'xml': made.clip(f'{id}/0')})
    base, indentation = made.indentation(tree.offset), document.indentation(old.offset)
    text = made.lifted(tree.span, base, indentation, units=(made.unit, document.unit))
    return [TextEdit(*old.span, text.replace('\n', document.line_break))]


# Models of node types (<TreeNodesModel>), which Groot2 and other editors read.


def chosen_types(registry: NodeRegistry, document: Document | None) -> list[NodeManifest]:
    """Return the node types that a document uses, or all without one; not those of BehaviorTree.CPP itself, which
    editors know."""
    used = None if document is None else {one['type'] for one in document.view().get('nodes', ())}
    builtin = builtin_registry()
    found = (one for one in registry if one.kind.value != 'SubTree' and one.id not in builtin)
    return sorted((one for one in found if used is None or one.id in used), key=lambda one: one.id)


def models_text(types: Iterable[NodeManifest]) -> str:
    """Return the text of a file with the models of node types."""
    return '\n'.join(models_document(types)) + '\n'


def with_models(document: XmlDocument, models: str) -> str:
    """Return the text of a document with those of the models of another text that it lacks. Raises StudioError."""
    known = {model['id'] for model in document.view()['models']}
    asked = [one for one in XmlDocument(models).view()['models'] if one['id'] not in known]
    text = document.text
    for part in (asked[:1], asked[1:]):  # the first may make <TreeNodesModel>; the others come at one place
        now = XmlDocument(text, document.file)
        edits: list[TextEdit] = []
        for model in part:
            written = [{**port, 'type': port['type'] or None} for port in model['ports']]
            ports = [{key: value for key, value in port.items() if key != 'span'} for port in written]
            edits += now.gesture('add_model', {'id': model['id'], 'kind': model['kind'], 'ports': ports})
        text = applied(text, edits)
    return text


def models_of(text: str) -> str:
    """Return a text with only the models of a file, as they are written there. Raises StudioError if it has none."""
    document = XmlDocument(text)
    found = [document.text[model.offset : model.end] for model in document.models if model.tag != 'SubTree']
    if not found:
        raise StudioError('this file has no <TreeNodesModel> with node types; export the models in the other editor')
    lines = '\n'.join(f'    {one}' for one in found)
    return f'<root BTCPP_format="4">\n  <TreeNodesModel>\n{lines}\n  </TreeNodesModel>\n</root>\n'


def palette_files(project: Project) -> list[str]:
    """Return the files of a project that have only models: their node types are known in it."""
    found = []
    for one in project.files():
        if one['kind'] == 'trees':
            with contextlib.suppress(StudioError):  # what cannot be read is told when it is opened
                text = project.text(one['file'])
                is_palette = '<TreeNodesModel' in text and '<BehaviorTree' not in text
                if is_palette and not XmlDocument(text).problems:
                    found.append(one['file'])
    return found


def add_palette(registry: NodeRegistry, file: str, text: str) -> list[str]:
    """Make the node types of a file of models known, and return what could not be read of it."""
    try:
        return [str(one) for one in add_models(registry, file, text)]
    except TreeLoadError as error:
        return [str(one) for one in error.errors]
