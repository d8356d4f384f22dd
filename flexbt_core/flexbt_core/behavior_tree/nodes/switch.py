# SPDX-License-Identifier: BSD-3-Clause
"""Switch2 to Switch6: the value of an entry decides which child is ticked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

from flexbt_core.behavior_tree.engine import ControlNode, NodeConfig, TreeNode, halt_child
from flexbt_core.behavior_tree.model import (
    EMPTY,
    MISSING,
    RUNNING,
    SKIPPED,
    STRING,
    SUCCESS,
    ConversionError,
    Entry,
    Example,
    NodeStatus,
    PortError,
    cast,
    input_port,
    number_from_text,
)
from flexbt_core.behavior_tree.script import SAME_NUMBER


class Switch(ControlNode):
    """Ticks the child of the first case that equals ``variable``, or the last child, the default, when none does.

    Two texts are equal when they are the same, or are, as a whole, the same decimal number; the name of an enum
    constant is its number. A variable that is missing, was never written, or is neither text nor number, leads to the
    default. The variable is read at every tick; when the choice changes, the child that is RUNNING is halted. A skipped
    child skips the node: the default is not tried. As in BehaviorTree.CPP the number of children is checked when the
    node is ticked.
    """

    __slots__ = ('_choice', '_constant', '_incomplete', '_running', '_text', '_variable')

    running_at_completion = False
    cases: ClassVar[tuple[str, ...]]
    """The ports of the cases."""

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
        # Cases that are literals are the same at every tick: the choice is only made anew when the variable changes.
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
        """The value of the variable, whose entry was not there the last time."""
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
        """The child for this value of the variable."""
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


NODES: Final = (Switch2, Switch3, Switch4, Switch5, Switch6)
