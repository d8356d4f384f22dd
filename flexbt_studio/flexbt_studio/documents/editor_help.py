# SPDX-License-Identifier: BSD-3-Clause
"""What an editor asks about a place in a text: completions, help and definitions.

It works on the text around the place, so that it also helps in a text that cannot be read yet.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import NodeManifest

from .machine_document import LEVELS
from .palette import node_type
from .project import Project, tree_places
from .text import Span
from .xml_document import XmlDocument

_NAME: Final = re.compile(r'[\w:.-]*$')
_OPEN_ATTRIBUTE: Final = re.compile(r'([\w:.-]+)\s*=\s*(["\'])([^"\']*)$')
_GIVEN: Final = re.compile(r'([\w:.-]+)\s*=\s*["\']')
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


@dataclass(frozen=True, slots=True)
class _Tag:
    """The start tag around an offset: where it begins, its name, and the attributes before the offset."""

    start: int
    name: str
    given: tuple[str, ...]
    attribute: str
    """The attribute in whose value the offset is, or ''."""
    value: Span


def _tag_at(text: str, offset: int) -> _Tag | None:
    """Return the start tag that is open at an offset; None outside of tags."""
    start = text.rfind('<', 0, offset)
    while (before := text.rfind('<', 0, max(start, 0))) >= 0 and _opened_quote(text[before:start]):
        start = before  # the character is in a value of an earlier tag
    if start < 0 or text.startswith(('<!', '<?', '</'), start):
        return None
    inside = text[start:offset]
    quote = _opened_quote(inside)
    if '>' in _QUOTED.sub('', inside if not quote else inside[: inside.rindex(quote)]):
        return None
    name = re.match(r'<([\w:.-]*)', inside)
    assert name is not None
    opened = _OPEN_ATTRIBUTE.search(inside) if quote else None
    attribute, value = '', Span(offset, offset)
    if opened is not None:
        end = text.find(quote, offset)
        line_end = text.find('\n', offset)
        end = end if end >= 0 and (line_end < 0 or end < line_end) else offset
        attribute, value = opened[1], Span(start + opened.start(3), end)
    return _Tag(start, name[1], tuple(_GIVEN.findall(inside)), attribute, value)


_QUOTED: Final = re.compile(r'"[^"]*"|\'[^\']*\'')


def _opened_quote(tag: str) -> str:
    """Return the quote that is open at the end of a text that begins with a tag; '' if none is open, or the tag has
    ended."""
    bare = _QUOTED.sub('', tag)
    quote = re.search('["\'>]', bare)
    return '' if quote is None or quote[0] == '>' else quote[0]


class TreeHelp:
    """Help for trees in XML."""

    def __init__(self, project: Project, registry: NodeRegistry) -> None:
        self._project = project
        self._registry = registry

    def completions(self, file: str, offset: int) -> list[Completion]:
        """Return what may stand at an offset of an open file, the likeliest first."""
        text = self._project.open(file).document.text
        tag = _tag_at(text, offset)
        if tag is None or tag.start + 1 + len(tag.name) >= offset:
            return [] if tag is None else list(self._types(text, tag))
        if tag.attribute:
            return list(self._values(file, text, tag, offset))
        return list(self._attributes(text, tag, offset))

    def _types(self, text: str, tag: _Tag) -> Iterator[Completion]:
        name = re.compile(r'[\w:.-]*').match(text, tag.start + 1)
        assert name is not None
        span = Span(*name.span())
        yield Completion('SubTree', 'tree', 'runs another tree', '', span, 'SubTree')
        for manifest in self._registry:
            told = manifest.documentation
            yield Completion(manifest.id, 'node', manifest.kind.value, told, span, manifest.id)

    def _attributes(self, text: str, tag: _Tag, offset: int) -> Iterator[Completion]:
        begun = _NAME.search(text, tag.start, offset)
        assert begun is not None
        span = Span(begun.start(), offset)
        manifest = self._manifest(text, tag)
        known: dict[str, tuple[str, str]] = {}
        if tag.name.startswith('SubTree'):
            known = {'ID': ('tree', 'the tree that it runs'), '_autoremap': ('bool', 'hand over all keys')}
        elif manifest is not None:
            for port in node_type(manifest)['ports']:
                detail = f'{port["direction"]} {port["type"]}'.strip() + (', required' if port['required'] else '')
                known[port['name']] = detail, port['description']
        known |= {'name': ('', 'name of the node')} | {key: ('script', told) for key, told in _CONDITIONS.items()}
        for name, (detail, told) in known.items():
            if name not in tag.given:
                yield Completion(name, 'port', detail, told, span, f'{name}=""')

    def _values(self, file: str, text: str, tag: _Tag, offset: int) -> Iterator[Completion]:
        if tag.name.startswith('SubTree') and tag.attribute == 'ID':
            for id, place in sorted(tree_places(self._project, file).items()):
                yield Completion(id, 'tree', place.file, '', tag.value, id)
            return
        written = text[tag.value.start : offset]
        opened = written.rfind('{')
        if opened >= 0 and '}' not in written[opened:]:
            closed = text.find('}', offset, tag.value.end)
            span = Span(tag.value.start + opened + 1, closed if closed >= 0 else offset)
            form = '{}' if closed >= 0 else '{}}}'
        else:
            span, form = tag.value, '{{{}}}'
        document = self._project.open(file).document
        assert isinstance(document, XmlDocument)
        for key in sorted({use.key for tree in document.trees.values() for use in document.keys.readable(tree)}):
            yield Completion(f'{{{key}}}', 'key', 'key of the blackboard', '', span, form.format(key))
        manifest = self._manifest(text, tag)
        port = None if manifest is None else manifest.ports.get(tag.attribute)
        if port is not None and port.type is not None and port.type.category == 'bool':
            for value in ('true', 'false'):
                yield Completion(value, 'value', 'bool', '', tag.value, value)

    def help(self, file: str, offset: int) -> Help | None:
        """Return help about the node type or port at an offset; None if there is none."""
        text = self._project.open(file).document.text
        word = _word_at(text, offset)
        tag = _tag_at(text, word.end)
        if tag is None:
            closing = re.match(r'</([\w:.-]+)$', text[text.rfind('<', 0, word.end) : word.end])
            manifest = self._registry.get(closing[1]) if closing else None
            return None if manifest is None else Help(word, type_help(manifest))
        manifest = self._manifest(text, tag)
        if manifest is None:
            return None
        name = text[word.start : word.end]
        if word.start == tag.start + 1 or name == manifest.id:
            return Help(word, type_help(manifest))
        port = next((one for one in node_type(manifest)['ports'] if one['name'] == name), None)
        if port is None:
            told = _CONDITIONS.get(name)
            return Help(word, f'**{name}**: {told}') if told else None
        default = '' if port['default'] is None else f', default `{port["default"]}`'
        head = f'**{name}** ({port["direction"]} {port["type"]}{default})'
        return Help(word, '\n\n'.join(part for part in (head, port['description']) if part))

    def _manifest(self, text: str, tag: _Tag) -> NodeManifest | None:
        name = re.compile(r'[\w:.-]*').match(text, tag.start + 1)
        found = self._registry.get(name[0] if name else tag.name)
        if found is None:
            id = re.compile(r'<\w+\b[^<>]*?\bID\s*=\s*["\']([^"\'<>]+)').match(text, tag.start)
            found = None if id is None else self._registry.get(id[1])
        return found


def type_help(manifest: NodeManifest) -> str:
    """Return help about a node type in Markdown, with its ports and example."""
    described = node_type(manifest)
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
