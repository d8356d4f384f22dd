# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/reference/bt_nodes.md, the reference of the node types, from the declarations of their classes.

In a shell with the environment of the workspace.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from inspect import cleandoc
from pathlib import Path
from typing import Any, Final

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

All node types, with their ports, results and an example. The text comes from the declarations of the nodes
(`docs/tools/make_bt_nodes.py` writes this page), and every example is tested. The [tutorial](../tutorials/errands.md)
shows how to write your own nodes. The server and its tools find and list them in the same way.

A tick returns SUCCESS, FAILURE, RUNNING or SKIPPED. *Ticks* lists the results of an example's ticks, each at the time
that the tree requests. *Before* and *after* are entries of the blackboard.

Any node may have a `name`, the pre-conditions `_failureIf`, `_successIf`, `_skipIf`, `_while` and the post-conditions
`_onSuccess`, `_onFailure`, `_onHalted`, `_post`, which are [scripts](bt_scripts.md). `{key}` points to an entry of the
blackboard, `{=}` to the one named like the port, and `{@key}` to an entry of the topmost tree. See also
[How the engine ticks a tree](../explanation/bt_engine.md) and
[Differences from BehaviorTree.CPP](bt_differences.md).

## Overview

Control nodes, decorators and Nav2's nodes behave as in BehaviorTree.CPP 4 and in Nav2's branches jazzy and
main.
"""


def page() -> str:
    """Return the whole page."""
    broken: list[str] = []
    registry = node_registry(lambda point, error: broken.append(f'{point}: {error}'))
    assert not broken, broken
    ours = ('flexbt_core.', 'flexbt_server.', 'flexbt_formal.')
    manifests = [manifest for manifest in registry if manifest.node_class.__module__.startswith(ours)]
    by_kind = {kind: [manifest for manifest in manifests if manifest.kind is kind] for kind in KINDS}
    lines = [HEAD]
    for kind, nodes in by_kind.items():
        lines += [f'| {kind.value} | Effect |', '|---|---|', *map(overview_row, nodes), '']
    for kind, nodes in by_kind.items():
        lines += [f'## {kind.value} nodes', '']
        for manifest in nodes:
            lines += [*section(manifest), '']
    return '\n'.join(lines).rstrip('\n') + '\n'


def overview_row(manifest: NodeManifest) -> str:
    """Return the row of a node type in the overview."""
    summary = ' '.join(manifest.documentation.partition('\n\n')[0].replace('``', '`').split())
    return f'| [{manifest.id}](#{manifest.id.lower()}) | {summary} |'


def section(manifest: NodeManifest) -> Iterator[str]:
    """Return the section of one node type."""
    yield f'### {manifest.id}'
    yield ''
    yield manifest.documentation.replace('``', '`')
    least, most = manifest.children
    if most != 0:
        number = f'{least}' if most == least else f'{least} or more' if most is None else f'{least} to {most}'
        yield ''
        yield f'Children: {number}.' if manifest.kind.value != 'SubTree' else 'Attribute `ID`: the tree.'
    if manifest.ports:
        yield ''
        yield '| Port | Direction | Type | Default | Meaning |'
        yield '|---|---|---|---|---|'
        for name, port in manifest.ports.items():
            default = '' if port.default is NO_DEFAULT else f'`{port.default}`'
            kind = f'`{port.type.name}`' if port.type is not None else 'any'
            yield f'| `{name}` | {port.direction.value} | {kind} | {default} | {port.documentation} |'
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
    facts += ['its work continues after a halt'] * skill.ignores_cancel
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
