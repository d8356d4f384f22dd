# SPDX-License-Identifier: BSD-3-Clause
"""Scripts and conditions as Python code for the kinds of values that their entries hold at the moment."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any, Final

from flexbt_core.behavior_tree.engine.conditions import Conditions, NodeScript
from flexbt_core.behavior_tree.engine.context import Tick
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.model.blackboard import Blackboard, Entry
from flexbt_core.behavior_tree.model.definition import ParsedScript
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus
from flexbt_core.behavior_tree.script.interpreter import BoundScript, CompiledScript
from flexbt_core.behavior_tree.script.parser import Expression

from .node_classes import stores_directly
from .script_code import CodeWriter, NotSpecializable, Variable, variable_of

_MOST_FACTORIES: Final = 16


class SpecializedScript(CompiledScript):
    """A script with the code that was made of it, for the kinds of values that were met."""

    __slots__ = ('_factories',)

    def __init__(self, text: str, enums: Mapping[str, int], warm_up: int) -> None:
        super().__init__(text, enums, warm_up)
        self._factories: dict[Hashable, Factory | None] = {}

    def factory(self, variables: Mapping[str, Variable], condition: bool) -> Factory | None:
        """Return what makes the code for entries of these kinds; None when that is for the closures."""

        def make() -> Factory:
            return specialize(self.statements, variables, self.enums, condition=condition)

        return self.made((condition, *variables.values()), make)

    def made(self, key: Hashable, make: Callable[[], Factory]) -> Factory | None:
        """Return what was made for this key."""
        if key not in self._factories:
            if len(self._factories) >= _MOST_FACTORIES:
                self._factories.clear()
            try:
                self._factories[key] = make()
            except NotSpecializable:
                self._factories[key] = None
        return self._factories[key]


def pre_conditions_factory(
    scripts: Sequence[SpecializedScript],
    decisive: Sequence[bool],
    variables: Mapping[str, Variable],
    *,
    ongoing: bool,
    forgetful: bool,
) -> Factory | None:
    """Return what makes the code that ticks a node with these pre-conditions, see ``specialize_pre_conditions``.

    None when that is for the closures. All scripts are of one library.
    """
    first = scripts[0]

    def make() -> Factory:
        conditions = [(script.statements, wanted) for script, wanted in zip(scripts, decisive, strict=True)]
        return specialize_pre_conditions(conditions, variables, first.enums, ongoing=ongoing, forgetful=forgetful)

    key = (*scripts[1:], *decisive, *variables.items(), ongoing, forgetful)
    return first.made(key, make)


def post_conditions_factory(
    sides: Sequence[Sequence[SpecializedScript] | None], variables: Mapping[str, Variable]
) -> Factory | None:
    """Return what makes the code that ticks a node with these post-conditions, see ``specialize_post_conditions``.

    None when that is for the closures. All scripts are of one library.
    """
    first = next(script for side in sides for script in side or ())

    def make() -> Factory:
        statements = [
            None if side is None else [statement for script in side for statement in script.statements]
            for side in sides
        ]
        return specialize_post_conditions(statements, variables, first.enums)

    key = (*(None if side is None else tuple(side) for side in sides), *variables.items())
    return first.made(key, make)


def kinds_of(entries: Mapping[str, Entry]) -> dict[str, Variable] | None:
    """Return the kinds of the entries that scripts use, by name; None when there is no code for one of them."""
    variables = {name: variable for name, entry in entries.items() if (variable := variable_of(entry)) is not None}
    return variables if len(variables) == len(entries) else None


class SpecializedBoundScript(BoundScript):
    """``run`` is the code for what the entries hold now, once it is made; before, and where it does not fit, the
    closures."""

    __slots__ = ('_countdown', 'run')

    script: Any

    def __init__(self, script: CompiledScript, board: Blackboard, *, condition: bool) -> None:
        super().__init__(script, board, condition=condition)
        self._countdown = script.warm_up
        self.run: Callable[[], bool | None] = self._evaluate

    @property
    def entries(self) -> dict[str, Entry]:
        """The entries that the script uses, by name, as it found them in its last run."""
        return dict(zip(self.script.names, self.scope.entries, strict=True))

    def _evaluate(self) -> bool | None:
        """Run the closures; also for the code that is made of them, when that does not fit."""
        self._countdown -= 1
        if self._countdown <= 0:
            self._countdown = self.script.warm_up
            self._specialize()
        return BoundScript.run(self)

    def _specialize(self) -> None:
        """Make the code for what the entries hold now, if there is such code."""
        self.run = self._evaluate
        entries = self.scope.entries
        variables = kinds_of(self.entries)
        # Two names of one entry: a local variable of the code could not stand for it.
        if variables is not None and len(set(map(id, entries))) == len(entries):
            factory = self.script.factory(variables, self.condition)
            if factory is not None:
                self.run = factory(entries, [entry.type for entry in entries], self._evaluate)


# Pre- and post-conditions that are one function with the code of their scripts, when they run often.


class SpecializedConditions(Conditions):
    """The conditions of one node, and the tick function that is made of them; which that is changes at times."""

    __slots__ = (
        '_around',
        '_asking',
        '_asking_due',
        '_completing',
        '_completing_due',
        '_inner',
        '_ticking',
    )

    def __init__(self, node: TreeNode, scripts: Mapping[str, ParsedScript]) -> None:
        super().__init__(node, scripts)
        self._around: tuple[Any, ...] | None = None
        self._asking_due = _warm_up(self._pre)
        self._completing_due = _warm_up([script for side in self._post.values() for script in side])

    def around(self, tick: Tick) -> Tick:
        # The same tick in the same surroundings: the code that was made stays.
        around = (self._node.context.callbacks, type(self._node))
        if around != self._around:
            self._around = around
            self._inner = tick
            self._surround(self._bare_completing(tick) if self.completing else tick)
        return self._asking

    def _surround(self, completing: Tick) -> None:
        """Put the pre-conditions before ``completing``."""
        self._completing = completing
        self._ticking = self._after_pre_conditions(completing)
        self._asking: Tick = self._ask_and_tick if self._pre else completing

    # -- pre-conditions ----------------------------------------------------------------------------------------------

    def _ask_and_tick(self) -> NodeStatus:
        """Tick the node after its pre-conditions; also for the code that is made of them, when that does not fit."""
        self._asking_due -= 1
        if self._asking_due <= 0:
            self._asking_due = _warm_up(self._pre)
            self._specialize_asking()
        return self._ticking()

    def _specialize_asking(self) -> None:
        """Make code for the pre-conditions and what their entries hold now, if there is such code."""
        asking: Tick = self._ask_and_tick
        entries = {name: entry for script in self._pre for name, entry in _bound(script).entries.items()}
        variables = kinds_of(entries)
        if variables is not None:
            factory = pre_conditions_factory(
                [_bound(script).script for script in self._pre],
                [script.decisive for script in self._pre],
                variables,
                ongoing=self.asks_while_running,
                forgetful=self._pre[0].result is FAILURE,
            )
            if factory is not None:
                found = list(entries.values())
                types = [entry.type for entry in found]
                asking = factory(found, types, self._ask_and_tick, self._node, self._completing, self)
        if asking != self._asking:
            self._asking = asking
            self._node.context.rewrapped.append(self._node)

    # -- post-conditions ---------------------------------------------------------------------------------------------

    def _bare_completing(self, tick: Tick) -> Tick:
        """``tick`` with the post-conditions. When the store of the result is no call, they run after it, and the status
        is put back when one raises."""
        node = self._node
        if not stores_directly(node):
            return self._before_post_conditions(tick)

        def tick_and_complete() -> NodeStatus:
            before = node.status
            status = tick()
            return self._complete_or_put_back(status, before) if status is SUCCESS or status is FAILURE else status

        return tick_and_complete

    def _complete_or_put_back(self, status: NodeStatus, before: NodeStatus) -> NodeStatus:
        """Run the scripts; also for the code that is made of them, when that does not fit."""
        self._completing_due -= 1
        if self._completing_due <= 0:
            self._completing_due = _warm_up([script for side in self._post.values() for script in side])
            self._specialize_completing()
        try:
            self._run(status)
        except NodeExecutionError:
            self._node.status = RUNNING if self._node.running_at_completion else before
            raise
        return status

    def _specialize_completing(self) -> None:
        """Make code for the scripts and what their entries hold now, as far as there is such code."""
        sides: list[list[SpecializedScript] | None] = []
        entries: dict[str, Entry] = {}
        for status in (SUCCESS, FAILURE):
            bound = [_bound(script) for script in self._post[status]]
            found = {name: entry for one in bound for name, entry in one.entries.items()}
            # Two names of one entry: a local variable of the code could not stand for it.
            if kinds_of(found) is None or len(set(map(id, found.values()))) < len(found):
                sides.append(None)
            else:
                sides.append([one.script for one in bound])
                entries |= found
        variables = kinds_of(entries)
        if variables is None or not any(sides):
            return
        factory = post_conditions_factory(sides, variables)
        if factory is not None:
            types = [entry.type for entry in entries.values()]
            completing = factory(list(entries.values()), types, self._complete_or_put_back, self._node, self._inner)
            self._surround(completing)
            self._node.context.rewrapped.append(self._node)


def _bound(script: NodeScript) -> SpecializedBoundScript:
    """Scripts are made by the same acceleration."""
    bound: Any = script.bound
    return bound


def _warm_up(scripts: Sequence[NodeScript]) -> int:
    return max((_bound(script).script.warm_up for script in scripts), default=0)


# Scripts as Python code for the kinds of values that their entries hold at the moment.
#
# The code first checks that the entries still hold values of these kinds, then computes with local variables, and
# writes the entries last. Whatever it is not made for (another kind, an error, a number that is too large, a division
# by zero) makes it call ``slow`` *before it has written anything*: the closures then do the whole script, and raise
# what there is to be raised. So the code never decides what a script means; it only is several times as fast.

Factory = Callable[..., Callable[[], Any]]


def specialize(
    statements: Sequence[Expression],
    variables: Mapping[str, Variable],
    enums: Mapping[str, int],
    *,
    condition: bool,
) -> Factory:
    """Give ``bind(entries, types, slow)``, which makes the code for entries of these kinds, in this order.

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
    """Give ``bind(entries, types, slow, node, execute, conditions)``, which makes the code that ticks a node with
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
    """Give ``bind(entries, types, slow, node, execute)``, which makes the code that ticks a node with post-conditions.

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
    """Return the lines that let the first condition decide that does; the places of the conditions begin with
    ``first``."""
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
