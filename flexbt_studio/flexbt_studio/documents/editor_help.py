# SPDX-License-Identifier: BSD-3-Clause
"""What an editor asks about a place in a text: completions, help and definitions.

It works on the text around the place, so that it also helps in a text that cannot be read yet.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import PRE_POST_ATTRIBUTES, NodeManifest
from flexbt_core.behavior_tree.script.interpreter import CONDITION, SCRIPT
from flexbt_core.skills.skill import LEVELS

from . import palette
from .project import Project, tree_places
from .text import LINE_BREAK, Span
from .xml_document import XmlDocument
from .xml_keys import SUBTREES, node_type
from .xml_text import XmlElement

_NAME: Final = re.compile(r'[\w:.-]*\Z')
_TAG_NAME: Final = re.compile(r'[\w:.-]*')
_EQUALS: Final = re.compile(r'\s*=')
_OPEN_VALUE: Final = re.compile(r'([\w:.-]+)\s*=\s*(["\'])((?:(?!\2).)*)\Z', re.DOTALL)
_SCRIPT_NAME: Final = re.compile(r'[\w@]*')
_BEGUN_NAME: Final = re.compile(r'[\w@]*\Z')
_CONDITIONS: Final = {
    '_skipIf': 'skip the node if this is true',
    '_successIf': 'succeed without a tick if this is true',
    '_failureIf': 'fail without a tick if this is true',
    '_while': 'tick the node as long as this is true',
    '_onSuccess': 'run this after success',
    '_onFailure': 'run this after failure',
    '_onHalted': 'run this after a halt',
    '_post': 'run this after the node ends',
}


class Completion(NamedTuple):
    """A text that may stand at a place. ``span`` is what it replaces; ``kind`` is node, port, key, tree or state."""

    label: str
    kind: str
    detail: str
    documentation: str
    span: Span
    text: str


class Help(NamedTuple):
    """Help about the word at ``span``, in Markdown."""

    span: Span
    text: str


class _OpenValue(NamedTuple):
    """The attribute in whose value an offset is, and the span of the value."""

    attribute: str
    span: Span


def _tag_at(document: XmlDocument, offset: int) -> XmlElement | None:
    """Return the element in whose start tag an offset is, also if that is not finished; None outside of tags."""
    found = None
    for element in (one for top in document.tops for one in top.all()):
        if element.offset < offset:
            found = element
    if found is None:
        return None
    is_open = document.text[found.open_end - 1] != '>' and not document.text[found.open_end : offset].strip()
    return found if is_open or offset < found.open_end else None


def _value_at(text: str, tag: XmlElement, offset: int) -> _OpenValue | None:
    """Return the value in which an offset is, also if its end is not written yet; None outside of values."""
    opened = _OPEN_VALUE.search(text, tag.offset, offset)
    if opened is None:
        return None
    line_break = LINE_BREAK.search(text, offset)
    end = text.find(opened[2], offset, line_break.start() if line_break else len(text))
    return _OpenValue(opened[1], Span(opened.start(3), end if end >= 0 else offset))


class TreeHelp:
    """Help for trees in XML."""

    def __init__(self, project: Project, registry: NodeRegistry) -> None:
        self._project = project
        self._registry = registry

    def completions(self, file: str, offset: int) -> list[Completion]:
        """Return what may stand at an offset of an open file, the likeliest first."""
        document = self._project.trees(file)
        tag = _tag_at(document, offset)
        start = document.text.rfind('<', 0, offset)
        is_name = start >= 0 and _TAG_NAME.fullmatch(document.text, start + 1, offset)
        if is_name and not document.text.startswith('</', start) and (tag is None or tag.offset == start):
            return list(self._types(document.text, start + 1))
        if tag is None:
            return []
        value = _value_at(document.text, tag, offset)
        if value is None:
            return list(self._attributes(document.text, tag, offset))
        return list(self._values(file, tag, value, offset))

    def _types(self, text: str, start: int) -> Iterator[Completion]:
        name = _TAG_NAME.match(text, start)
        assert name is not None
        span = Span(*name.span())
        yield Completion('SubTree', 'tree', 'runs another tree', '', span, 'SubTree')
        for manifest in self._registry:
            told = manifest.documentation
            yield Completion(manifest.id, 'node', manifest.kind.value, told, span, manifest.id)

    def _attributes(self, text: str, tag: XmlElement, offset: int) -> Iterator[Completion]:
        manifest = self._manifest(tag)
        known: dict[str, tuple[str, str]] = {}
        if tag.tag in SUBTREES:
            known = {'ID': ('tree', 'the tree that it runs'), '_autoremap': ('bool', 'hand over all keys')}
        elif manifest is not None:
            for port in palette.node_type(manifest)['ports']:
                detail = f'{port["direction"]} {port["type"]}'.strip() + (', required' if port['required'] else '')
                known[port['name']] = detail, port['description']
        known |= {'name': ('', 'name of the node')} | {key: ('script', told) for key, told in _CONDITIONS.items()}
        begun = _NAME.search(text, tag.offset, offset)
        start = begun.start() if begun else offset
        written = _TAG_NAME.match(text, start)
        assert written is not None
        before = text[tag.offset : start]
        is_equal = before.rstrip().endswith('=') or (start == offset and _EQUALS.match(text, offset))
        if is_equal or not before[-1].isspace():  # beside the sign of equality, or directly behind a value
            return
        span, form = Span(start, offset), '{}="" '  # before another attribute
        if start < offset or not written[0]:
            span, form = Span(*written.span()), '{}' if _EQUALS.match(text, written.end()) else '{}=""'
        for name, (detail, told) in known.items():
            if name not in tag.parts or tag.parts[name].start == span.start < span.end:
                yield Completion(name, 'port', detail, told, span, form.format(name))

    def _values(self, file: str, tag: XmlElement, value: _OpenValue, offset: int) -> Iterator[Completion]:
        document, text = self._project.trees(file), self._project.trees(file).text
        if tag.tag in SUBTREES and value.attribute == 'ID':
            for id, place in sorted(tree_places(self._project, file).items()):
                yield Completion(id, 'tree', place.file, '', value.span, id)
            return
        manifest = self._manifest(tag)
        port = None if manifest is None else manifest.ports.get(value.attribute)
        is_script = port is not None and (port.literal or port.type) in (SCRIPT, CONDITION)
        written = text[value.span.start : offset]
        opened = written.rfind('{')
        label = '{{{}}}'
        if is_script or value.attribute in PRE_POST_ATTRIBUTES:
            begun = _BEGUN_NAME.search(text, value.span.start, offset)
            word = _SCRIPT_NAME.match(text, begun.start() if begun else offset, value.span.end)
            span = Span(*word.span()) if word else value.span
            label = form = '{}'
        elif opened >= 0 and '}' not in written[opened:]:
            closed = text.find('}', offset, value.span.end)
            span = Span(value.span.start + opened + 1, closed if closed >= 0 else offset)
            form = '{}' if closed >= 0 else '{}}}'
        elif LINE_BREAK.search(written) is None:
            span, form = value.span, '{{{}}}'
        else:  # it would be replaced wholly, and editors replace within a line
            return
        for key in sorted({use.key for tree in document.trees.values() for use in document.keys.readable(tree)}):
            yield Completion(label.format(key), 'key', 'key of the blackboard', '', span, form.format(key))
        if port is not None and port.type is not None and port.type.category == 'bool':
            yield from (Completion(one, 'value', 'bool', '', value.span, one) for one in ('true', 'false'))

    def help(self, file: str, offset: int) -> Help | None:
        """Return help about the node type or port at an offset; None if there is none."""
        document = self._project.trees(file)
        text = document.text
        word = _word_at(text, offset)
        tag = _tag_at(document, word.end)
        closing = re.compile(r'</([\w:.-]+)').fullmatch(text, max(text.rfind('<', 0, word.end), 0), word.end)
        manifest = self._manifest(tag) if tag is not None else self._registry.get(closing[1]) if closing else None
        if manifest is None or tag is None:
            return None if manifest is None else Help(word, type_help(manifest))
        name = text[word.start : word.end]
        if word.start == tag.offset + 1 or name == manifest.id:
            return Help(word, type_help(manifest))
        port = next((one for one in palette.node_type(manifest)['ports'] if one['name'] == name), None)
        if port is None:
            told = _CONDITIONS.get(name)
            return Help(word, f'**{name}**: {told}') if told else None
        default = '' if port['default'] is None else f', default `{port["default"]}`'
        head = f'**{name}** ({port["direction"]} {port["type"]}{default})'
        return Help(word, '\n\n'.join(part for part in (head, port['description']) if part))

    def _manifest(self, tag: XmlElement) -> NodeManifest | None:
        return self._registry.get(tag.tag) or self._registry.get(node_type(tag))


def type_help(manifest: NodeManifest) -> str:
    """Return help about a node type in Markdown, with its ports and example."""
    described = palette.node_type(manifest)
    lines = [f'**{manifest.id}** ({manifest.kind.value})', manifest.documentation]
    ports = [f'- `{one["name"]}` {one["direction"]} {one["type"]}: {one["description"]}' for one in described['ports']]
    lines += ['\n'.join(ports)] if ports else []
    lines += [f'```xml\n{described["example"].strip()}\n```'] if described['example'] else []
    return '\n\n'.join(line for line in lines if line)


def _word_at(text: str, offset: int) -> Span:
    start = end = max(0, min(offset, len(text)))
    while start > 0 and (text[start - 1].isalnum() or text[start - 1] in '_@.-'):
        start -= 1
    while end < len(text) and (text[end].isalnum() or text[end] in '_.-'):
        end += 1
    return Span(start, end)


class MachineHelp:
    """Help for machines in YAML. ``palette`` are the states as :func:`.palette.states` returns them."""

    def __init__(self, project: Project, palette: Sequence[Mapping[str, Any]]) -> None:
        self._project = project
        self._states = {one['id']: one for one in palette}

    def completions(self, file: str, offset: int) -> list[Completion]:
        """Return what may stand at an offset of an open file: types of states, parameters, targets, levels."""
        document = self._project.open(file).document
        text = document.text
        start = max(text.rfind('\n', 0, offset), text.rfind('{', 0, offset), text.rfind(',', 0, offset)) + 1
        begun = re.match(r'\s*(?:-\s+)?(?:([\w.$-]+)\s*:\s+)?([\w./-]*)$', text[start:offset])
        if begun is None:
            return []
        word = Span(offset - len(begun[2]), offset + len(re.match(r'[\w./-]*', text[offset:])[0]))  # type: ignore[index]
        around = _outer_keys(text, start)
        view = document.view()
        state = _state_at(view['states'], offset)
        if begun[1] in ('state', 'use') and state is not None:
            return [_of_state(one, word) for one in self._states.values()]
        if begun[1] is not None and around[:1] == ['transitions'] and state is not None:
            return [Completion(name, 'state', told, '', word, name) for name, told in _targets(view['states'], state)]
        if begun[1] is not None and around[:1] == ['autonomy']:
            return [Completion(level, 'value', 'level of autonomy', '', word, level) for level in LEVELS]
        if begun[1] is None and around[:1] == ['parameters'] and state is not None:
            known = self._states.get(state['type'], {'parameters': ()})['parameters']
            given = {one['name'] for one in state['parameters']}
            return [
                Completion(one['name'], 'port', one['type'], one['description'], word, f'{one["name"]}: ')
                for one in known
                if one['name'] not in given
            ]
        return []

    def help(self, file: str, offset: int) -> Help | None:
        """Return help about the type of state, or the parameter, at an offset; None if there is none."""
        document = self._project.open(file).document
        word = _word_at(document.text, offset)
        name = document.text[word.start : word.end]
        state = _state_at(document.view()['states'], offset)
        described = self._states.get(state['type']) if state is not None else None
        if described is None:
            return None
        if name == described['id']:
            return Help(word, _state_help(described))
        parameter = next((one for one in described['parameters'] if one['name'] == name), None)
        if parameter is None:
            return None
        default = '' if parameter['required'] else f', default `{parameter["default"]}`'
        return Help(word, f'**{name}** ({parameter["type"]}{default})\n\n{parameter["description"]}')


def _outer_keys(text: str, start: int) -> list[str]:
    """Return the keys whose values contain the line, or the flow mapping, at ``start``, the innermost first."""
    flow = re.search(r'([\w.-]+)\s*:\s*\{[^{}]*$', text[:start])
    if flow is not None:
        return [flow[1]]
    found: list[str] = []
    line = re.compile(r'[ \t]*').match(text, start)
    indent = len(line[0]) if line is not None else 0
    for before in reversed(text[:start].splitlines()):
        key = re.match(r'([ \t]*)(?:-\s+)?([\w.-]+)\s*:\s*(?:#.*)?$', before)
        if key is not None and len(key[1]) < indent:
            found.append(key[2])
            indent = len(key[1])
    return found


def _state_at(states: Sequence[Mapping[str, Any]], offset: int) -> Mapping[str, Any] | None:
    within = [one for one in states if one['span'][0] <= offset <= one['span'][1]]
    return within[-1] if within else None


def _targets(states: Sequence[Mapping[str, Any]], state: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for one in states:
        if one['parent'] == state['parent']:
            yield one['label'], 'state'
        if one['path'] == state['parent']:
            yield from ((name, 'outcome of the machine') for name in one['outcomes'])


def _of_state(state: Mapping[str, Any], span: Span) -> Completion:
    return Completion(state['id'], 'state', state['summary'], _state_help(state), span, state['id'])


def _state_help(state: Mapping[str, Any]) -> str:
    lines = [f'**{state["id"]}** ({state["package"]})', state['documentation']]
    for title, key in (
        ('Parameters', 'parameters'),
        ('Reads', 'inputs'),
        ('Writes', 'outputs'),
        ('Outcomes', 'outcomes'),
    ):
        if state[key]:
            lines.append(f'{title}:\n\n' + '\n'.join(f'- `{one["name"]}` {one["description"]}' for one in state[key]))
    return '\n\n'.join(lines)
