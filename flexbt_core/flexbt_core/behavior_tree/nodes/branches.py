# SPDX-License-Identifier: BSD-3-Clause
"""IfThenElse, WhileDoElse and Switch2 to Switch6: a condition or a value decides which child is ticked.

The first child is the condition, the second the branch for SUCCESS, the optional third the branch for FAILURE. As in
BehaviorTree.CPP, the number of children is checked when the node is ticked, so a tree runs if it never reaches the
wrong node. A skipped condition is an error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode, halt_child
from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.model.blackboard import EMPTY, MISSING, Entry
from flexbt_core.behavior_tree.model.errors import ConversionError, NodeExecutionError, PortError
from flexbt_core.behavior_tree.model.outcomes import Choice, Example
from flexbt_core.behavior_tree.model.ports import STRING, cast, input_port, number_from_text
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus
from flexbt_core.behavior_tree.script.values import SAME_NUMBER


class _Conditional(ControlNode):
    __slots__ = ('_has_else', '_incomplete')

    tickable_with = (2, 3)

    def attach(self, children: Sequence[TreeNode]) -> None:
        super().attach(children)
        self._incomplete = self.incompleteness(len(children))
        self._has_else = len(children) == 3

    def _undecided(self) -> NodeExecutionError:
        return self.fault(f'the condition [{self.children[0].path}] was skipped, and so says neither yes nor no')


class IfThenElse(_Conditional):
    """Evaluates the condition once, then ticks the chosen branch until it completes, and returns its result.

    FAILURE if the condition fails and the node has no third child. Only in this case are the children not set to IDLE,
    as in BehaviorTree.CPP: a condition that is a stateful action keeps its FAILURE, and is not evaluated again, until
    the parent resets or halts the node. A third child, such as AlwaysFailure, avoids this.
    """

    __slots__ = ('_chosen',)

    outcomes = Choice()
    example = Example(
        """
        <IfThenElse>
          <ScriptCondition code="battery > 20"/>
          <Script code="next := 'work'"/>
          <Script code="next := 'dock'"/>
        </IfThenElse>
        """,
        ticks=(SUCCESS,),
        before={'battery': 10},
        after={'next': 'dock'},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._chosen = 0

    def execute(self) -> NodeStatus:
        if self._incomplete:
            raise self.fault(self._incomplete)
        self.status = RUNNING
        ticks = self._ticks
        chosen = self._chosen
        if not chosen:
            status = ticks[0]()
            if status is SUCCESS:
                chosen = 1
            elif status is FAILURE:
                if not self._has_else:
                    self._failed = 0
                    self.status = FAILURE
                    return FAILURE
                chosen = 2
            elif status is RUNNING:
                return RUNNING
            else:
                raise self._undecided()
            self._chosen = chosen
        status = ticks[chosen]()
        if status is RUNNING:
            return RUNNING
        self._chosen = 0
        # Inlined reset_children: a call would cost much of the time of this tick.
        for child in self.children:
            if child.stored_status is RUNNING:
                child.halt_node()
            child.status = IDLE
        if status is not SKIPPED:
            self._failed = chosen
            self.status = status
        return status

    def halt(self) -> None:
        self._chosen = 0
        super().halt()


class WhileDoElse(_Conditional):
    """Evaluates the condition at every tick, ticks the chosen branch, and halts the other one.

    Returns the result of the branch. While the condition itself is RUNNING, the node neither ticks nor halts a branch.
    FAILURE if the condition fails and the node has no third child.
    """

    __slots__ = ()

    outcomes = Choice()
    example = Example(
        """
        <WhileDoElse>
          <ScriptCondition code="(asked += 1) == 1"/>
          <Sleep msec="100"/>
          <Script code="next := 'else'"/>
        </WhileDoElse>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'asked': 0},
        after={'next': 'else'},
    )

    def execute(self) -> NodeStatus:
        if self._incomplete:
            raise self.fault(self._incomplete)
        self.status = RUNNING
        ticks = self._ticks
        status = ticks[0]()
        if status is SUCCESS:
            if self._has_else:
                halt_child(self.children[2])
            chosen = 1
            status = ticks[1]()
        elif status is FAILURE:
            chosen = 0
            if self._has_else:
                halt_child(self.children[1])
                chosen = 2
                status = ticks[2]()
        elif status is RUNNING:
            return RUNNING
        else:
            self.reset_children()
            raise self._undecided()
        if status is RUNNING:
            return RUNNING
        # Inlined reset_children: a call would cost much of the time of this tick.
        for child in self.children:
            if child.stored_status is RUNNING:
                child.halt_node()
            child.status = IDLE
        if status is not SKIPPED:
            self._failed = chosen
            self.status = status
        return status


# Switch2 to Switch6: the value of an entry decides which child is ticked.


class Switch(ControlNode):
    """Ticks the child of the first case that equals ``variable``, or the last child, the default, if none does.

    Two texts are equal if they are identical or both are the same decimal number; the name of an enum constant means
    its number. The node ticks the default if the variable is missing, was never written, or is neither text nor number.
    It reads the variable at every tick; if the choice changes, it halts the RUNNING child. A skipped child skips the
    node: it does not try the default. As in BehaviorTree.CPP, the number of children is checked when the node is
    ticked.
    """

    __slots__ = ('_choice', '_constant', '_incomplete', '_running', '_text', '_variable')

    running_at_completion = False
    cases: ClassVar[tuple[str, ...]]
    """Names of the ports of the cases."""

    def __init_subclass__(cls, count: int | None = None) -> None:
        if count is not None:
            cls.__doc__ = cls.__doc__ or Switch.__doc__
            cls.cases = tuple(f'case_{number}' for number in range(1, count + 1))
            cls.tickable_with = count + 1, count + 1
            cls.ports = {
                'variable': input_port(STRING, optional=True, description='what decides: {key}, or text'),
                **{case: input_port(STRING, optional=True, description='value for this child') for case in cls.cases},
            }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._running: int | None = None
        # Literal cases never change: the node chooses again only when the variable changes.
        given = [config.values.get(case) for case in self.cases]
        self._constant = all(value is None or value.key is None for value in given)
        self._text: str | None = None
        self._choice = len(self.cases)
        variable = config.values.get('variable')
        self._variable = MISSING
        if variable is not None and variable.key is None:
            self._variable = Entry.constant(variable.text)

    def attach(self, children: Sequence[TreeNode]) -> None:
        super().attach(children)
        self._incomplete = self.incompleteness(len(children))

    def execute(self) -> NodeStatus:
        if self._incomplete:
            raise self.fault(self._incomplete)
        variable = self._variable
        value = variable.value if variable.present else self._find()
        text: str | None = value if value.__class__ is str else self._as_text(value)
        if text != self._text or not self._constant:
            self._text = text
            self._choice = self._match(text)
        choice = self._choice
        running = self._running
        if running is not None and running != choice:
            halt_child(self.children[running])
        status = self._ticks[choice]()
        if status is RUNNING:
            self._running = choice
            self.status = RUNNING
            return RUNNING
        self._running = None
        if status is SKIPPED:
            return SKIPPED
        self.reset_children()
        self._failed = choice
        self.status = status
        return status

    def _find(self) -> object:
        """Return the value of the variable, looking up its entry, which was missing before."""
        key = self.port_key('variable')
        self._variable = (None if key is None else self.blackboard.entry(key)) or MISSING
        return self._variable.value

    def _as_text(self, value: object) -> str | None:
        if value is EMPTY:
            return None
        try:
            text: str = cast(value, STRING)
        except ConversionError:
            return None
        return text

    def _match(self, variable: str | None) -> int:
        """Return the index of the child for this value of the variable."""
        default = len(self.cases)
        if variable is None:
            return default
        number = self._number(variable)
        for index, case in enumerate(self.cases):
            try:
                text: str | None = self.get_input_or(case, None)
            except PortError:
                continue
            if text == variable:
                return index
            if number is not None and text is not None:
                other = self._number(text)
                if other is not None and abs(number - other) <= SAME_NUMBER:
                    return index
        return default

    def _number(self, text: str) -> float | None:
        constant = self.context.scripts.enums.get(text)
        return number_from_text(text) if constant is None else float(constant)

    def halt(self) -> None:
        self._running = None
        super().halt()


class Switch2(Switch, count=2):
    __slots__ = ()

    example = Example(
        """
        <Switch2 variable="{room}" case_1="office" case_2="store">
          <AlwaysFailure/><AlwaysSuccess/><AlwaysFailure/>
        </Switch2>
        """,
        ticks=(SUCCESS,),
        before={'room': 'store'},
    )


class Switch3(Switch, count=3):
    __slots__ = ()


class Switch4(Switch, count=4):
    __slots__ = ()


class Switch5(Switch, count=5):
    __slots__ = ()


class Switch6(Switch, count=6):
    __slots__ = ()


NODES: Final = (
    IfThenElse,
    WhileDoElse,
    Switch2,
    Switch3,
    Switch4,
    Switch5,
    Switch6,
)
