# SPDX-License-Identifier: BSD-3-Clause
"""Scripts as Python code for the kinds of values that their entries hold at the moment.

The code first checks that the entries still hold values of these kinds, then computes with local variables, and writes
the entries last. Whatever it is not made for (another kind, an error, a number that is too large, a division by zero)
makes it call ``slow`` *before it has written anything*: the closures then do the whole script, and raise what there is
to be raised. So the code never decides what a script means; it only is several times as fast.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from flexbt_core.behavior_tree.model import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS
from flexbt_core.behavior_tree.script import Expression

from .script_code import CodeWriter, NotSpecializable, Variable

Factory = Callable[..., Callable[[], Any]]


def specialize(
    statements: Sequence[Expression],
    variables: Mapping[str, Variable],
    enums: Mapping[str, int],
    *,
    condition: bool,
) -> Factory:
    """Gives ``bind(entries, types, slow)``, which makes the code for entries of these kinds, in this order.

    The code gives the truth of the last statement when the script is a ``condition``, otherwise None. ``types`` are the
    present types of the entries. Raises NotSpecializable.
    """
    writer = CodeWriter(variables, enums)
    result = writer.statements(statements)
    if condition:
        writer.lines.append(f'result = {writer.truth(result)}')
    body = [
        *writer.guards(),
        *_guarded(writer.lines),
        *writer.commits(),
        'return result' if condition else 'return None',
    ]
    return _compiled(len(variables), ['slow'], body)


def specialize_pre_conditions(
    conditions: Sequence[tuple[Sequence[Expression], bool]],
    variables: Mapping[str, Variable],
    enums: Mapping[str, int],
    *,
    ongoing: bool,
    forgetful: bool,
) -> Factory:
    """Gives ``bind(entries, types, slow, node, execute, conditions)``, which makes the code that ticks a node with
    pre-conditions.

    Each condition is a script, and whether it decides by being true, or by being false. ``conditions.decide(place)`` is
    called for the first that does, ``execute()`` when none does; ``node.decided_by`` is None then, if it is
    ``forgetful``. The last condition is asked while the node is RUNNING as well when it is ``ongoing``. Raises
    NotSpecializable.
    """
    lines = ['status = node.status', 'if status is IDLE or status is SKIPPED:']
    lines += _indented(_decision(conditions, 0, variables, enums))
    if forgetful:
        lines.append('    node.decided_by = None')
    if ongoing:
        lines.append('elif status is RUNNING:')
        lines += _indented(_decision(conditions[-1:], len(conditions) - 1, variables, enums))
    lines.append('return execute()')
    return _compiled(len(variables), ['slow', 'node', 'execute', 'conditions'], lines)


def specialize_post_conditions(
    sides: Sequence[Sequence[Expression] | None],
    variables: Mapping[str, Variable],
    enums: Mapping[str, int],
) -> Factory:
    """Gives ``bind(entries, types, slow, node, execute)``, which makes the code that ticks a node with post-conditions.

    The ``sides`` are the statements for SUCCESS and for FAILURE; None: there is no code for them. When there is none,
    or when it does not fit, ``slow(status, before)`` does it all: ``before`` is the status of the node before the tick.
    Raises NotSpecializable.
    """
    slow = 'slow(status, before)'

    def side(statements: Sequence[Expression] | None) -> list[str]:
        if statements is None:
            return [f'return {slow}']
        if not statements:
            return ['pass']
        writer = CodeWriter(variables, enums)
        writer.statements(statements)
        return [*writer.guards(slow), *_guarded(writer.lines, slow), *writer.commits()]

    success, failure = sides
    body = ['before = node.status', 'status = execute()']
    if success == failure:
        body += ['if status is SUCCESS or status is FAILURE:', *_indented(side(success))]
    else:
        body += ['if status is SUCCESS:', *_indented(side(success))]
        body += ['elif status is FAILURE:', *_indented(side(failure))]
    return _compiled(len(variables), ['slow', 'node', 'execute'], [*body, 'return status'])


def _decision(
    conditions: Sequence[tuple[Sequence[Expression], bool]],
    first: int,
    variables: Mapping[str, Variable],
    enums: Mapping[str, int],
) -> list[str]:
    """The lines that let the first condition decide that does; the places of the conditions begin with ``first``."""
    writer = CodeWriter(variables, enums)
    decisive = []
    for statements, decides_by_truth in conditions:
        holds = writer.truth(writer.statements(statements))
        decisive.append(holds if decides_by_truth else f'not {holds}')
    if writer.writes:
        # What a condition has written stays written when a later one is for the closures.
        raise NotSpecializable
    places = range(first, first + len(conditions))
    if not writer.lines and not writer.may_raise:
        checks = [f'if {code}: return conditions.decide({place})' for place, code in zip(places, decisive, strict=True)]
        return [*writer.guards(), *checks]
    choice = ' else '.join(f'{place} if {code}' for place, code in zip(places, decisive, strict=True))
    lines = [*writer.lines, f'place = {choice} else -1']
    return [*writer.guards(), *_guarded(lines), 'if place >= 0: return conditions.decide(place)']


def _guarded(lines: Sequence[str], slow: str = 'slow()') -> list[str]:
    return [
        'try:',
        *_indented(lines or ['pass']),
        'except (ArithmeticError, ValueError):',
        f'    return {slow}',
    ]


def _indented(lines: Sequence[str]) -> list[str]:
    return [f'    {line}' for line in lines]


def _compiled(variables: int, names: Sequence[str], body: Sequence[str]) -> Factory:
    """``bind`` for a function with this body, in which so many entries and types, and the names, are known."""
    known = {f'e{place}': f'entries[{place}]' for place in range(variables)}
    known |= {f't{place}': f'types[{place}]' for place in range(variables)}
    known |= {name: name for name in names}
    words = set(re.findall(r'\w+', '\n'.join(body)))
    # As defaults of parameters that nobody gives, they take less memory than as variables of a closure.
    parameters = ', '.join(f'{name}={value}' for name, value in known.items() if name in words)
    lines = [
        f'def bind(entries, types, {", ".join(names)}):',
        f'    def run({parameters}):',
        *_indented(_indented(body)),
        '    return run',
    ]
    statuses = (IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED)
    namespace: dict[str, Any] = {status.name: status for status in statuses}
    exec(compile('\n'.join(lines), '<script>', 'exec'), namespace)  # noqa: S102 - made by CodeWriter, which says of what
    factory: Factory = namespace['bind']
    return factory
