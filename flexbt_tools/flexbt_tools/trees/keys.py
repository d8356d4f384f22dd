# SPDX-License-Identifier: BSD-3-Clause
"""Which blackboard keys a node uses: through its ports, by name, and in its scripts."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import NamedTuple

from flexbt_core.behavior_tree import NodeDefinition, Port
from flexbt_core.behavior_tree.model import KEY, KEYS, NO_DEFAULT, Script, separated
from flexbt_core.behavior_tree.script import (
    Assignment,
    Binary,
    Comparison,
    CompiledScript,
    Conditional,
    Expression,
    Name,
    Unary,
    parse_script,
)


class KeyUse(NamedTuple):
    """A node uses ``key``, as its ``attribute`` says. A key that it only ``may_read`` need not be there.

    ``port`` is the declared port; None for a script.
    """

    key: str
    attribute: str
    reads: bool = False
    writes: bool = False
    may_read: bool = False
    port: Port | None = None


def uses(node: NodeDefinition, enums: Collection[str]) -> Iterator[KeyUse]:
    """The uses of a node in its own scope. ``enums`` are the names that are constants in scripts.

    What a sub-tree is given leads to entries that others use; it is no use itself.
    """
    if node.tree_id is None:
        yield from _uses_of_ports(node, enums)
    for attribute, script in node.conditions.items():
        yield from _uses_of_script(attribute, script, enums)


def _uses_of_ports(node: NodeDefinition, enums: Collection[str]) -> Iterator[KeyUse]:
    for name, port in node.manifest.ports.items():
        value = node.values.get(name)
        if value is None:
            # Nodes of Nav2 take an entry of the same name for a port that is not given.
            if port.readable and port.default is NO_DEFAULT:
                yield KeyUse(name, name, may_read=True)
        elif isinstance(value.literal, CompiledScript):
            yield from _uses_of_script(name, value.literal, enums)
        elif value.key is not None:
            yield KeyUse(value.key, name, reads=port.readable, writes=port.writable, port=port)
        elif port.literal in (KEY, KEYS):
            for key in separated(value.text) if port.literal is KEYS else [value.text]:
                yield KeyUse(key, name, reads=not port.writable, writes=port.writable)


def _uses_of_script(attribute: str, script: Script, enums: Collection[str]) -> Iterator[KeyUse]:
    for statement in parse_script(script.text):
        for use in _uses_of_expression(attribute, statement):
            if use.writes or use.key not in enums:
                yield use


def _uses_of_expression(attribute: str, expression: Expression) -> Iterator[KeyUse]:
    inner: tuple[Expression, ...] = ()
    match expression:
        case Name(_, name):
            yield KeyUse(name, attribute, reads=True)
        case Assignment(_, operator, target, value):
            yield KeyUse(target, attribute, reads=operator not in (':=', '='), writes=True)
            inner = (value,)
        case Unary(_, _, operand):
            inner = (operand,)
        case Binary(_, _, left, right):
            inner = (left, right)
        case Comparison(_, _, operands):
            inner = operands
        case Conditional(_, condition, then, otherwise):
            inner = (condition, then, otherwise)
    for part in inner:
        yield from _uses_of_expression(attribute, part)
