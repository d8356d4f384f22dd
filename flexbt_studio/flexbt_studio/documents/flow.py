# SPDX-License-Identifier: BSD-3-Clause
"""Data flow: the keys of each tree and each container, with the nodes and states that write and read them.

A key is ``{'scope', 'key', 'span', 'given', 'early', 'uses': [{'path', 'role', 'name'}]}``. ``scope`` is the tree or
container. ``given`` says where a value comes from at the start, '' if that is not known. ``early`` is the path of a
node that reads the key, if the order of the tree has no writer before it. ``role`` is reads, writes, both, or another
word; ``name`` is the port, or the key of the state.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from flexbt_tools.tree_checks.check import HOST_KEYS

from .document import Document
from .machine_document import CONTAINERS, MachineDocument, State, Table
from .project import Project, tree_places
from .text import Span
from .xml_document import XmlDocument
from .xml_keys import SUBTREES, arguments, is_autoremapped
from .xml_text import XmlElement

_INPUTS: Final = ('input_keys', 'io_keys')
_OUTPUTS: Final = ('output_keys', 'io_keys')
_ANY_KEY: Final = 'KEY'
"""What docstrings of states call keys that their parameters declare."""
_KEPT: Final = ('result', 'response', 'message')
"""Parameters of states whose values are the keys that they write."""
_ONLY_WITH: Final = re.compile(r'\bonly with an? (\w+)')
"""What docstrings of states say of a key that depends on a parameter."""
_WORD: Final = re.compile(r'[A-Za-z_]\w*')
_IN_BRACES: Final = re.compile(r'\{([^{}]*)\}')


class _Use(NamedTuple):
    key: str
    path: str
    role: str
    name: str
    span: Span


def flow(project: Project, file: str, palette: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the keys of a file by their scopes, in the order of their first uses. Raises StudioError."""
    document = project.document(file)
    found: list[dict[str, Any]] = []
    if isinstance(document, XmlDocument):
        trees = _Trees(project, file)
        for path, tree in document.trees.items():
            given = dict.fromkeys(HOST_KEYS, 'the BT server') | dict.fromkeys(trees.ports(tree), 'the tree around it')
            found += _keys(path, trees.uses(document, tree), given, is_ordered=True)
    elif isinstance(document, MachineDocument):
        known = {one['id']: one for one in palette}
        for state in document.states.values():
            if state.kind in CONTAINERS:
                given = {item.key: 'the machine around it' for table in _INPUTS for item in state.items(table)}
                given |= {item.key: 'a default' for item in state.items('userdata')}
                uses = [use for child in state.children for use in _of_child(document, child, known)]
                found += _keys(state.path, [*_declared(state), *uses], given, is_ordered=False)
    return found


def _keys(scope: str, uses: Sequence[_Use], given: Mapping[str, str], *, is_ordered: bool) -> Iterator[dict[str, Any]]:
    by_key: dict[str, list[_Use]] = {}
    for use in uses:
        by_key.setdefault(use.key, []).append(use)
    for key, own in by_key.items():
        first = next((use for use in own if use.role not in ('hands over', 'uses')), None)
        is_early = is_ordered and first is not None and first.role == 'reads' and key not in given
        yield {
            'scope': scope,
            'key': key,
            'span': next(([*use.span] for use in own if use.span.start < use.span.end), None),
            'given': given.get(key, ''),
            'early': first.path if is_early and first and any('writes' in use.role for use in own) else '',
            'uses': [{'path': use.path, 'role': use.role, 'name': use.name} for use in own if use.path],
        }


class _Trees:
    """The uses of keys by trees, with what their sub-trees do with the keys that they are given."""

    def __init__(self, project: Project, file: str) -> None:
        self._project = project
        self._file = file
        self._places = tree_places(project, file)
        self._roles: dict[XmlElement | None, dict[str, str]] = {}

    def ports(self, tree: XmlElement) -> set[str]:
        """Return the names under which sub-trees and models hand keys to a tree of the file."""
        id = tree.attributes.get('ID', '')
        found: set[str] = set()
        for file, document in self._project.tree_files():
            if file == self._file or document.definition(id) is None:
                for one in (*document.subtrees, *document.models):
                    if one.tag in SUBTREES and one.attributes.get('ID') == id:
                        found |= {*one.attributes, *(port.attributes.get('name', '') for port in one.children)}
        return found

    def uses(self, document: XmlDocument, tree: XmlElement) -> list[_Use]:
        """Return the uses of keys in the order of the tree, each with the path of its node."""
        found: list[_Use] = []
        for element in tree.all():
            inner = self._inside(document, element) if element.tag in SUBTREES else {}
            given = arguments(element, bare=document.is_old) if inner else {}
            owner = element if element in document.paths else element.parent  # that of a <remap> is its sub-tree
            path = document.paths.get(owner, '') if owner is not None else ''
            for use in document.keys.of(element):
                role = inner.get(use.attribute, use.role) if use.form in ('argument', 'same', 'default') else use.role
                found.append(_Use(use.key, path, role, use.attribute, use.span))
            if inner and is_autoremapped(element):
                shared = {key: role for key, role in inner.items() if key not in given and key[:1] not in '_@'}
                found += [_Use(key, path, role, key, Span(0, 0)) for key, role in shared.items()]
        return found

    def _inside(self, document: XmlDocument, call: XmlElement) -> dict[str, str]:
        """Return what the tree of a sub-tree does with each of its keys."""
        id = call.attributes.get('ID', '')
        owner, tree = document, document.definition(id)
        if tree is None and id in self._places:
            owner = self._project.trees(self._places[id].file)
            tree = owner.definition(id)
        if tree is None or tree in self._roles:
            return self._roles.get(tree, {})
        roles = self._roles[tree] = {}  # of a tree that runs itself nothing is known yet
        for use in self.uses(owner, tree):
            both = f'{roles.get(use.key, "")} {use.role}'
            words = [word for word in ('reads', 'writes') if word in both]
            roles[use.key] = ' and '.join(words) or use.role
        return roles


def _declared(state: State) -> Iterator[_Use]:
    """Yield the keys that a container declares, as uses by nobody."""
    for table in ('userdata', *_INPUTS, 'output_keys'):
        for item in state.items(table):
            yield _Use(item.key, '', 'uses', '', item.name_span)


def _of_child(document: MachineDocument, child: State, known: Mapping[str, Mapping[str, Any]]) -> Iterator[_Use]:
    """Yield the keys of its container that a state uses, by its remapping and by what is known of its class."""
    reads, writes, _ = state_keys(document, child, known)
    for key in dict.fromkeys([*(item.key for item in child.items('remapping')), *sorted(reads | writes)]):
        item = child.find('remapping', key)
        role = ' and '.join(['reads'] * (key in reads) + ['writes'] * (key in writes)) or 'uses'
        span = item.value_span if item is not None else Span(child.label_span.start, child.label_span.start)
        yield _Use(key if item is None else item.value or '', child.path, role, key, span)


def keys_of_group(
    document: Document, paths: Sequence[str], palette: Sequence[Mapping[str, Any]]
) -> dict[str, list[str]]:
    """Return the keys that a machine needs which takes the place of states: its input_keys, output_keys and io_keys, as
    far as it is known what the states do with their keys."""
    known = {one['id']: one for one in palette}
    states = document.states if isinstance(document, MachineDocument) else {}
    members = [states[path] for path in paths if isinstance(path, str) and path in states]
    parent = members[0].parent if members else None
    if not isinstance(document, MachineDocument) or parent is None:
        return {}
    own: dict[str, str] = {}  # what the states do with each key, and what is done around them
    around: dict[str, str] = {}
    for child in parent.children:
        side = own if child in members else around
        for use in _of_child(document, child, known):
            side[use.key] = f'{side.get(use.key, "")} {use.role.replace("uses", "reads writes")}'
    for tables, role in ((('userdata', *_INPUTS), 'writes'), (_OUTPUTS, 'reads')):
        for item in (item for table in tables for item in parent.items(table)):
            around[item.key] = f'{around.get(item.key, "")} {role}'
    found: dict[str, list[str]] = {}
    for key, roles in own.items():
        is_input = 'reads' in roles and ('writes' not in roles or 'writes' in around.get(key, ''))
        is_read_later = is_input or 'reads' in around.get(key, '')  # when the machine is entered again, or around it
        is_output = 'writes' in roles and ('reads' not in roles or is_read_later)
        table = 'io_keys' if is_input and is_output else 'input_keys' if is_input else 'output_keys'
        if is_input or is_output:
            found.setdefault(table, []).append(key)
    return found


def state_keys(
    document: MachineDocument, state: State, known: Mapping[str, Mapping[str, Any]]
) -> tuple[set[str], set[str], bool]:
    """Return the keys that a state reads, and those that it writes, by its own names, and whether these are all.

    They are those of the docstring of its class and, where that says ``KEY``, those that parameters name.
    """
    if state.kind in CONTAINERS:
        tables = [{item.key for table in one for item in state.items(table)} for one in (_INPUTS, _OUTPUTS)]
        return tables[0], tables[1], True
    described = known.get(state.type.rpartition('.')[2])
    if described is None or state.kind != 'state':
        return set(), set(), False
    given = {item.key for item in state.items('parameters')}
    reads, writes = ({one['name'] for one in described[kind] if _applies(one, given)} for kind in ('inputs', 'outputs'))
    is_all = True
    if _ANY_KEY in reads | writes:
        values = {item.key: document.value(item) for item in state.items('parameters')}
        is_all = all(is_literal for _, is_literal in values.values())
        is_all = is_all and not state.tables.get('parameters', Table()).locked
        for name, (value, _) in values.items():
            if _ANY_KEY in reads and name not in ('outputs', 'result', 'response'):
                reads |= _keys_in(name, value)
            if _ANY_KEY in writes and name == 'outputs' and isinstance(value, dict):
                writes |= set(value)
            elif _ANY_KEY in writes and name in _KEPT and isinstance(value, dict):
                writes |= {one for one in value.values() if isinstance(one, str)}
    return reads - {_ANY_KEY}, writes - {_ANY_KEY}, is_all


def _applies(key: Mapping[str, Any], given: Collection[str]) -> bool:
    """Return whether a state has a key of its docstring with the parameters that are given."""
    only = _ONLY_WITH.search(key['description'])
    return only is None or only[1] in given


def _keys_in(name: str, value: Any) -> set[str]:
    """Return the keys that a parameter names: as entries of ``inputs``, items of ``shows``, and in texts elsewhere."""
    if name in ('inputs', 'shows') and isinstance(value, dict | list):
        return {one for one in value if isinstance(one, str)}
    texts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else [value]
    form = _WORD if name == 'outcomes' and isinstance(value, dict) else _IN_BRACES
    parts = [part for text in texts if isinstance(text, str) for part in form.findall(text)]
    return {word for part in parts for word in _WORD.findall(part)}
