# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/reference/bt_nodes.md, the reference of the node types, from the declarations of their classes.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from inspect import cleandoc
from itertools import groupby
from pathlib import Path
from typing import Any, Final, NamedTuple

from target import target

from flexbt_core.behavior_tree.engine.registry import node_skill
from flexbt_core.behavior_tree.model.definition import NodeManifest
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT
from flexbt_core.behavior_tree.model.status import NodeKind
from flexbt_core.skills.skill import Skill
from flexbt_server.node_types import node_registry

HERE: Final = Path(__file__).parent
PAGE: Final = HERE.parent / 'reference' / 'bt_nodes.md'
KINDS: Final = (NodeKind.CONTROL, NodeKind.DECORATOR, NodeKind.SUBTREE, NodeKind.ACTION, NodeKind.CONDITION)
"""In the order of the page."""
HEAD: Final = """\
# The nodes of a behavior tree

All node types, with ports, results and an example. `docs/tools/make_bt_nodes.py` writes this page from the declarations
of the nodes; every example is tested. The [tutorial](../tutorials/errands.md) shows how to write your own nodes.

A tick returns SUCCESS, FAILURE, RUNNING or SKIPPED. *Ticks* lists the results of an example's ticks, each at the time
that the tree requests. *Before* and *after* are entries of the blackboard.

A port is an input unless marked as output or inout. A value after its type is the default. `{key}` points to an entry
of the blackboard, `{=}` to the one named like the port, and `{@key}` to an entry of the topmost tree.

Any node may have a `name`, the pre-conditions `_failureIf`, `_successIf`, `_skipIf`, `_while` and the post-conditions
`_onSuccess`, `_onFailure`, `_onHalted`, `_post`, which are [scripts](bt_scripts.md).

Control nodes, decorators and Nav2's nodes behave as in BehaviorTree.CPP 4 and in Nav2. *(main)* and *(jazzy)* mark what
only this branch of Nav2 has. See also [How the engine ticks a tree](../explanation/bt_engine.md) and
[Differences from BehaviorTree.CPP](bt_differences.md).
"""
CHILDREN: Final = {
    NodeKind.CONTROL: ((1, None), 'A control node has one child or more, unless its section says otherwise.'),
    NodeKind.DECORATOR: ((1, 1), 'A decorator has one child.'),
    NodeKind.SUBTREE: ((1, 1), 'The attribute `ID` names the tree.'),
}
"""The usual number of children of a kind, and what its heading says about it."""

SHARED: Final = 4
"""Ports that at least this many sections would repeat have one list for all."""


class Port(NamedTuple):
    """A port as an item of a list."""

    name: str
    direction: str
    type: str
    default: str
    meaning: str

    def __str__(self) -> str:
        direction = '' if self.direction == 'input' else f'{self.direction} '
        default = f', {self.default}' if self.default else ''
        return f'- {self.name} ({direction}{self.type}{default}): {self.meaning}'


def page() -> str:
    """Return the whole page."""
    broken: list[str] = []
    registry = node_registry(lambda point, error: broken.append(f'{point}: {error}'))
    assert not broken, broken
    ours = ('flexbt_core.', 'flexbt_server.', 'flexbt_formal.')
    manifests = [manifest for manifest in registry if manifest.node_class.__module__.startswith(ours)]
    by_kind = {kind: list(alike(manifest for manifest in manifests if manifest.kind is kind)) for kind in KINDS}
    groups = [group for kind in KINDS for group in by_kind[kind]]
    repeated = Counter(port for group in groups for port in ports(group))
    shared = [port for port, times in repeated.items() if times >= SHARED]
    assert len({port.name for port in shared}) == len(shared), 'a name stands for one shared port'
    lines = [HEAD, '## Ports that many nodes have', '', *map(str, shared), '']
    for kind, of_kind in by_kind.items():
        lines += [f'## {kind.value} nodes', '']
        lines += [CHILDREN[kind][1], ''] if kind in CHILDREN else []
        for group in of_kind:
            lines += [*section(group, shared), '']
    text = '\n'.join(lines).rstrip('\n') + '\n'
    return re.sub(r'\(Nav2 (\w+) only\)', r'(\1)', text)


def alike(manifests: Iterable[NodeManifest]) -> Iterator[list[NodeManifest]]:
    """Group neighbours that have one documentation, such as Switch2 to Switch6, or the same ports and a sentence."""
    for _, group in groupby(manifests, key=_family):
        yield list(group)


def _family(manifest: NodeManifest) -> tuple[object, ...]:
    """Return what the nodes of a section have in common."""
    is_brief = '\n' not in manifest.documentation and not (manifest.example and manifest.example.ticks)
    if is_brief and manifest.ports:
        return (tuple(ports([manifest])), _skill(manifest))
    return (manifest.documentation, manifest.children)


def title(group: Sequence[NodeManifest]) -> str:
    return ', '.join(manifest.id for manifest in group)


def ports(group: Sequence[NodeManifest]) -> list[Port]:
    """Return the ports of alike nodes, in order; those that differ only in name or type are one item."""
    types: dict[tuple[str, str, str, str], list[str]] = {}
    for manifest in group:
        for name, port in manifest.ports.items():
            default = '' if port.default is NO_DEFAULT else f'`{port.default}`' if port.default != '' else "`''`"
            kind = f'`{port.type.name}`' if port.type is not None else 'any'
            found = types.setdefault((name, port.direction.value, default, port.documentation), [])
            if kind not in found:
                found.append(kind)
    names: dict[tuple[str, ...], list[str]] = {}
    for (name, direction, default, meaning), kinds in types.items():
        names.setdefault((direction, ', '.join(kinds), default, meaning), []).append(f'`{name}`')
    return [Port(', '.join(alike), *rest) for rest, alike in names.items()]


def section(group: Sequence[NodeManifest], shared: Sequence[Port]) -> Iterator[str]:
    """Return the section of alike node types."""
    manifest = group[0]
    yield f'### {title(group)}'
    yield ''
    texts = {node.id: node.documentation.replace('``', '`') for node in group}
    if len(set(texts.values())) == 1:
        yield manifest.documentation.replace('``', '`')
    else:
        yield from (f'- {name}: {text}' for name, text in texts.items())
    least, most = manifest.children
    if most != 0 and manifest.children != CHILDREN[manifest.kind][0]:
        yield ''
        number = f'{least}' if most == least else f'{least} or more' if most is None else f'{least} to {most}'
        yield f'Children: {number}.'
    rows = ports(group)
    own = [port for port in rows if port not in shared]
    if own:
        yield from ('', 'Ports:', '') if len(set(texts.values())) > 1 else ('',)
        yield from map(str, own)
    if len(own) < len(rows):
        names = ', '.join(port.name for port in rows if port in shared)
        yield ''
        yield f'[{"Also" if own else "Ports"}](#ports-that-many-nodes-have): {names}.'
    declared = _skill(manifest)
    if declared:
        yield ''
        yield f'[Skill](skills.md): {declared}.'
    if manifest.example is not None:
        yield ''
        yield from _shown(manifest.example)


def _skill(manifest: NodeManifest) -> str:
    """Return the skill of a leaf, without what its ports show."""
    skill = node_skill(manifest)
    if skill is None or manifest.node_class.skill == Skill():
        return ''
    facts = [f'needs `{literal}`' for literal in skill.preconditions]
    facts += [f'uses the {name} exclusively' for name in skill.resources]
    facts += [
        f'after {name} `{"`, `".join(map(str, outcome.effects))}`'
        for name, outcome in skill.outcomes.items()
        if outcome.effects
    ]
    facts += ['continues after a halt'] * skill.ignores_cancel
    return ', '.join(facts)


def _shown(example: Example) -> Iterator[str]:
    yield '```xml'
    yield cleandoc(example.xml)
    if example.trees:
        yield cleandoc(example.trees)
    yield '```'
    if example.ticks:
        yield ''
        before = f'Before: {_entries(example.before)}. ' if example.before else ''
        after = f' After: {_entries(example.after)}.' if example.after else ''
        yield f'{before}Ticks: {", ".join(status.name for status in example.ticks)}.{after}'


def _entries(entries: Mapping[str, Any]) -> str:
    return ', '.join(f'`{key}` = `{value!r}`' for key, value in entries.items())


if __name__ == '__main__':
    target(__doc__, PAGE).write_text(page(), encoding='utf-8')
