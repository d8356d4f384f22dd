# SPDX-License-Identifier: BSD-3-Clause
"""Likely slips: keys and texts that are mixed up, and leftovers of copies.

An error code of a planner is a number, and so is one of a controller. The name of a planner is a text, and so is that
of a controller. Only the name of the port, and the leaf, show what a port holds.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import NodeDefinition, NodeManifest, TreeLibrary
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT
from flexbt_core.behavior_tree.model.status import NodeKind
from flexbt_tools.trees.key_usage import EntryUsage, NodePlace

from .diagnostics import CROSSED, MISNAMED, TWICE, Diagnostic

_WRITERS_OF_CODES: Final[Mapping[str, tuple[str, ...]]] = {
    'WouldAPlannerRecoveryHelp': ('ComputePathToPose', 'ComputePathThroughPoses'),
    'WouldAControllerRecoveryHelp': ('FollowPath',),
    'WouldASmootherRecoveryHelp': ('SmoothPath',),
    'WouldARouteRecoveryHelp': ('ComputeRoute', 'ComputeAndTrackRoute'),
}
"""Node types that write the error code that each of Nav2's conditions reads."""
_SELECTED: Final = re.compile(r'selected_(\w+)')
_CHOSEN: Final = re.compile(r'(\w+)_id')
_ADDRESS: Final = re.compile(r'topic|service|server')
_SWITCH: Final = re.compile(r'Switch[2-6]')
_CODE: Final = re.compile(r'(\w+?)_error_(?:code|msg)(?:_id)?')
_RECOVERIES: Final = frozenset(
    ('ClearEntireCostmap', 'ClearCostmapExceptRegion', 'ClearCostmapAroundRobot', 'BackUp', 'Spin', 'Wait')
)
_MAIN: Final = frozenset(
    (
        *('ComputePathToPose', 'ComputePathThroughPoses', 'ComputeRoute', 'ComputeAndTrackRoute', 'SmoothPath'),
        *('FollowPath', 'NavigateToPose', 'NavigateThroughPoses', 'DockRobot'),
    )
)

_CONTRARIES: Final = (
    *(('local', 'global'), ('open', 'close'), ('left', 'right'), ('front', 'rear'), ('start', 'stop')),
    *(('enable', 'disable'), ('planner', 'controller'), ('load', 'unload')),
)


def crossed_keys(usages: Iterable[EntryUsage]) -> Iterator[Diagnostic]:
    """Yield a finding for each reader of a key whose writer uses it for something else."""
    for usage in usages:
        for reader in usage.readers:
            wanted = _read_meaning(reader)
            if not wanted:
                continue
            for writer in usage.writers:
                meant = _written_meaning(writer)
                if meant and not meant & wanted:
                    message = (
                        f'key [{reader.use.key}] is read here as {_shown(wanted)}, and {writer.node.label} writes '
                        f'{_shown(meant)} to it'
                    )
                    yield Diagnostic(CROSSED, reader.error(message))
                    break


def _written_meaning(place: NodePlace) -> frozenset[str]:
    node, port = place.node, place.use.attribute
    if match := _SELECTED.fullmatch(port):
        return frozenset((f'a {match[1]}',))
    if port.startswith('error_code'):
        return frozenset((f'an error code of {node.manifest.id}',))
    return frozenset()


def _read_meaning(place: NodePlace) -> frozenset[str]:
    node, port = place.node, place.use.attribute
    if port == 'error_code':
        return frozenset(f'an error code of {one}' for one in _WRITERS_OF_CODES.get(node.manifest.id, ()))
    match = _CHOSEN.fullmatch(port)
    return frozenset((f'a {match[1]}',)) if match else frozenset()


def _shown(meanings: frozenset[str]) -> str:
    return ' or '.join(sorted(meanings))


def mixed_up(library: TreeLibrary, registry: NodeRegistry) -> Iterator[Diagnostic]:
    """Yield a finding for each of these slips:

    - a key that is named after another leaf;
    - a text that belongs to another type, or contradicts the name of its node;
    - a child at the wrong case of a Switch;
    - a RecoveryNode whose children are swapped.
    """
    used = (node.manifest for key in library.tree_keys() for node in library.definition(key).nodes())
    manifests = list({one.id: one for one in (*registry, *used)}.values())
    coded = [one.id for one in manifests if any(name.startswith('error_code') for name in one.ports)]
    owners: dict[tuple[str, str], list[str]] = {}
    for one in manifests:
        for name, port in one.ports.items():
            if _ADDRESS.search(name) and isinstance(port.default, str):
                owners.setdefault((name, port.default), []).append(one.id)
    for key in library.tree_keys():
        tree = library.definition(key)
        for node in tree.nodes():
            for name, value in node.values.items():
                if value.key is not None:
                    problem = _key_of_another(node, name, value.key, coded)
                else:
                    problem = _text_of_another(node, name, value.text, owners.get((name, value.text), ()))
                if problem:
                    yield Diagnostic(CROSSED, tree.error(node, problem, name))
            for child, message in _wrong_cases(node):
                yield Diagnostic(CROSSED, tree.error(child, message))
            if node.manifest.id == 'RecoveryNode' and len(node.children) == 2 and _are_swapped(node.children):
                message = 'its first child only recovers, and the second one is what can fail: are they swapped?'
                yield Diagnostic(CROSSED, tree.error(node, message))


def _wrong_cases(node: NodeDefinition) -> Iterator[tuple[NodeDefinition, str]]:
    """Yield children of a Switch that are named after the case of another child, and the message."""
    if not _SWITCH.fullmatch(node.manifest.id):
        return
    cases = [node.values.get(f'case_{number}') for number in range(1, len(node.children) + 1)]
    texts = [one.text.casefold() if one is not None and one.key is None else '' for one in cases]
    for place, child in enumerate(node.children):
        own = {child.name.casefold(), (child.tree_id or child.manifest.id).casefold()}
        if not own.isdisjoint(texts) and texts[place] not in own:
            yield child, f'it is called after a case of {node.label}, and stands where that is not the case'


def _key_of_another(node: NodeDefinition, name: str, key: str, coded: Sequence[str]) -> str:
    """Return the message if the key for an error is named after another type; '' if it is not."""
    match = _CODE.fullmatch(key)
    word = match[1].replace('_', '').casefold() if match else ''
    port = node.manifest.ports.get(name)
    is_error = port is not None and port.writable and name.startswith('error_')
    if not is_error or len(word) < 4 or node.manifest.id.casefold().startswith(word):
        return ''
    owner = next((one for one in coded if one.casefold().startswith(word)), '')
    return f'its {name} goes to the key of {owner}, [{key}]' if owner else ''


def _text_of_another(node: NodeDefinition, name: str, text: str, owners: Sequence[str]) -> str:
    """Return the message if a text belongs to another type or contradicts the name of its node; '' otherwise."""
    port = node.manifest.ports.get(name)
    own = port.default if port is not None else NO_DEFAULT
    if len(owners) == 1 and node.manifest.id not in owners and own not in (NO_DEFAULT, text):
        return f'{name}="{text}" is that of {owners[0]}; {node.manifest.id} has {own!r}'
    if words := _contrary(node.name, text):
        return f'it is called after {words[0]!r}, and its {name} is about {words[1]!r}: "{text}"'
    return ''


def _contrary(name: str, text: str) -> tuple[str, str] | None:
    """Return a word in a name and its opposite, if the text contains only the opposite."""
    name, text = name.casefold(), text.casefold()
    for pair in _CONTRARIES:
        for word, other in (pair, pair[::-1]):
            # One word may contain the other: load, unload.
            told, said = name.replace(other, '') if word in other else name, text
            if word in told and other not in name and other in said and word not in said.replace(other, ''):
                return word, other
    return None


def _are_swapped(children: Sequence[NodeDefinition]) -> bool:
    (first, second) = ({one.manifest.id for one in _inside(child)} for child in children)
    return bool(first & _RECOVERIES) and not first & _MAIN and bool(second & _MAIN)


def _inside(node: NodeDefinition) -> Iterator[NodeDefinition]:
    yield node
    for child in node.children:
        yield from _inside(child)


# Likely leftovers of copies: a node with the name of another type or tree, or a node that occurs twice in a row.

_LEAVES: Final = (NodeKind.ACTION, NodeKind.CONDITION)
_IN_ORDER: Final = frozenset(('Sequence', 'ReactiveSequence', 'SequenceWithMemory', 'SequenceStar', 'PipelineSequence'))
"""Controls that continue with the next child after a success. In a Fallback, a repeated node is another attempt."""


def copies(library: TreeLibrary, registry: NodeRegistry) -> Iterator[Diagnostic]:
    """Yield a finding for each likely leftover."""
    trees = {_letters(key.id): key.id for key in library.tree_keys()}
    used = (node.manifest for key in library.tree_keys() for node in library.definition(key).nodes())
    leaves = {_letters(one.id): one for one in (*registry, *used) if one.kind in _LEAVES}
    for key in library.tree_keys():
        tree = library.definition(key)
        looks: dict[int, int] = {}
        _look(tree.root, looks, {})
        for node in tree.nodes():
            if meant := _meant(node, trees, leaves):
                yield Diagnostic(MISNAMED, tree.error(node, f'{meant}: is that the one that is meant?'))
            if node.manifest.id in _IN_ORDER:
                for first, second in pairwise(node.children):
                    if looks[id(first)] == looks[id(second)]:
                        yield Diagnostic(TWICE, tree.error(second, 'it is there twice in a row, with the same ports'))


def _meant(node: NodeDefinition, trees: Mapping[str, str], leaves: Mapping[str, NodeManifest]) -> str:
    """Return the message if the name means another tree, or another type that has these ports; '' otherwise."""
    name = _letters(node.name)
    if _letters(node.tree_id or node.manifest.id).endswith(name):
        return ''
    if node.tree_id is not None:
        return f'it runs the tree [{node.tree_id}], and there is a tree [{trees[name]}]' if name in trees else ''
    other = leaves.get(name) if node.manifest.kind in _LEAVES else None
    if other is None or not node.values.keys() <= other.ports.keys():
        return ''
    return f'it is a [{node.manifest.id}], and there is a node type [{other.id}]'


def _letters(name: str) -> str:
    """Return a name without the characters that differ between spellings."""
    return re.sub(r'[\W_]', '', name).casefold()


def _look(node: NodeDefinition, looks: dict[int, int], numbers: dict[object, int]) -> int:
    """Return a number that is equal for nodes with equal text and equal children.

    ``looks`` caches it by the ``id`` of each node, ``numbers`` by the text.
    """
    ports = sorted((port, value.key, value.text) for port, value in node.values.items())
    conditions = sorted((name, script.text) for name, script in node.conditions.items())
    children = tuple(_look(one, looks, numbers) for one in node.children)
    said = node.manifest.id, node.tree_id, node.name, repr(ports), tuple(conditions), children
    looks[id(node)] = numbers.setdefault(said, len(numbers))
    return looks[id(node)]
