# SPDX-License-Identifier: BSD-3-Clause
"""Decorators that change a result or repeat their child, and SubTree."""

from __future__ import annotations

from typing import ClassVar, Final

from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode, halt_child
from flexbt_core.behavior_tree.engine.parents import DecoratorNode
from flexbt_core.behavior_tree.model.blackboard import MISSING
from flexbt_core.behavior_tree.model.errors import PortError
from flexbt_core.behavior_tree.model.outcomes import Example, Exchanged, Repeated
from flexbt_core.behavior_tree.model.ports import BOOL, INT, input_port
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus


class Inverter(DecoratorNode):
    """Returns FAILURE if the child succeeds, and SUCCESS if it fails."""

    __slots__ = ()

    outcomes = Exchanged(success=FAILURE, failure=SUCCESS)
    example = Example('<Inverter><AlwaysFailure/></Inverter>', ticks=(SUCCESS,))

    def execute(self) -> NodeStatus:
        self.status = RUNNING
        status = self._tick()
        if status is SUCCESS:
            self.child.status = IDLE
            self.status = FAILURE
            return FAILURE
        if status is FAILURE:
            self.child.status = IDLE
            self.status = SUCCESS
            return SUCCESS
        return status

    def failure_cause(self) -> TreeNode | None:
        return None

    def failure_reason(self) -> str:
        return f'{self.id}: the child [{self.child.path}] succeeded'


class ForceSuccess(DecoratorNode):
    """Returns SUCCESS when the child completes with any result."""

    __slots__ = ()

    outcomes = Exchanged(failure=SUCCESS)
    example = Example('<ForceSuccess><AlwaysFailure/></ForceSuccess>', ticks=(SUCCESS,))

    def execute(self) -> NodeStatus:
        self.status = RUNNING
        status = self._tick()
        if status is SUCCESS or status is FAILURE:
            self.child.status = IDLE
            self.status = SUCCESS
            return SUCCESS
        return status


class ForceFailure(DecoratorNode):
    """Returns FAILURE when the child completes with any result."""

    __slots__ = ()

    outcomes = Exchanged(success=FAILURE)
    example = Example('<ForceFailure><AlwaysSuccess/></ForceFailure>', ticks=(FAILURE,))

    def execute(self) -> NodeStatus:
        self.status = RUNNING
        status = self._tick()
        if status is SUCCESS or status is FAILURE:
            self.child.status = IDLE
            self.status = FAILURE
            return FAILURE
        return status

    def failure_cause(self) -> TreeNode | None:
        return None

    def failure_reason(self) -> str:
        return f'{self.id}: the child [{self.child.path}] completed'


class _Repeating(DecoratorNode):
    """A decorator that counts the runs of the child. It reads the limit at each tick; -1: no limit."""

    __slots__ = ('_count', '_limit')

    limit: ClassVar[str]
    """Name of the port of the limit."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._count = 0
        self._limit = MISSING

    def _read_limit(self) -> int:
        value: int = self.get_input(self.limit)
        self._limit = self.ready_entry(self.limit)
        return value

    def halt(self) -> None:
        self._count = 0
        super().halt()


class Repeat(_Repeating):
    """Runs the child ``num_cycles`` times while it succeeds (-1: no limit); FAILURE when it fails.

    Between two cycles, if the child began and completed in one tick, it yields: returns RUNNING and wakes the tree.
    """

    __slots__ = ('_failed_cycle',)

    ports = {'num_cycles': input_port(INT, description='number of successes; -1: without end')}
    limit = 'num_cycles'
    outcomes = Repeated('num_cycles', SUCCESS)
    example = Example(
        '<Repeat num_cycles="3"><Script code="n += 1"/></Repeat>',
        ticks=(RUNNING, RUNNING, SUCCESS),
        before={'n': 0},
        after={'n': 3},
    )

    def execute(self) -> NodeStatus:
        cycles = self._limit.value
        if cycles.__class__ is not int:
            cycles = self._read_limit()
        count = self._count
        child = self.child
        self.status = RUNNING
        while count < cycles or cycles == -1:
            was_idle = child.stored_status is IDLE
            status = self._tick()
            if status is SUCCESS:
                self._count = count = count + 1
                child.status = IDLE
                if was_idle and (count < cycles or cycles == -1):
                    self.context.woken = True
                    return RUNNING
            elif status is FAILURE:
                self._failed_cycle = count + 1
                self._count = 0
                child.status = IDLE
                self.status = FAILURE
                return FAILURE
            elif status is RUNNING:
                return RUNNING
            else:
                halt_child(child)
                return SKIPPED
        self._count = 0
        self.status = SUCCESS
        return SUCCESS

    def failure_reason(self) -> str:
        return f'{self.id}: cycle {self._failed_cycle} failed (num_cycles="{self.port_text("num_cycles")}")'


class RetryUntilSuccessful(_Repeating):
    """Runs the child up to ``num_attempts`` times until it succeeds (-1: no limit). It yields as Repeat does."""

    __slots__ = ('_used',)

    ports = {'num_attempts': input_port(INT, description='attempts in all; -1: without end')}
    limit = 'num_attempts'
    outcomes = Repeated('num_attempts', FAILURE)
    example = Example(
        """
        <RetryUntilSuccessful num_attempts="5"><ScriptCondition code="(n += 1) == 2"/></RetryUntilSuccessful>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'n': 0},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        # Number of attempts when the node failed.
        self._used = 0

    def execute(self) -> NodeStatus:
        attempts = self._limit.value
        if attempts.__class__ is not int:
            attempts = self._read_limit()
        child = self.child
        again = self._count < attempts or attempts == -1
        self.status = RUNNING
        while again:
            was_idle = child.stored_status is IDLE
            status = self._tick()
            if status is FAILURE:
                self._count = count = self._count + 1
                # The child may have changed the number on the blackboard.
                if self._limit.value is not attempts:
                    attempts = self._changed_limit(attempts)
                again = count < attempts or attempts == -1
                child.status = IDLE
                if again and was_idle:
                    self.context.woken = True
                    return RUNNING
            elif status is SUCCESS:
                self._count = 0
                child.status = IDLE
                self.status = SUCCESS
                return SUCCESS
            elif status is RUNNING:
                return RUNNING
            else:
                halt_child(child)
                return SKIPPED
        self._used = self._count
        self._count = 0
        self.status = FAILURE
        return FAILURE

    def _changed_limit(self, attempts: int) -> int:
        """Return the current limit; the old one if its entry was removed."""
        try:
            return self._read_limit()
        except PortError:
            return attempts

    def failure_cause(self) -> TreeNode | None:
        return self.child if self._used else None

    def failure_reason(self) -> str:
        limit = f'(num_attempts="{self.port_text("num_attempts")}")'
        if not self._used:
            return f'{self.id}: no attempt is allowed {limit}'
        return f'{self.id}: {"the attempt" if self._used == 1 else f"all {self._used} attempts"} failed {limit}'


class KeepRunningUntilFailure(DecoratorNode):
    """RUNNING while the child succeeds (each next tick starts it again); FAILURE when it fails."""

    __slots__ = ()

    outcomes = Exchanged(success=RUNNING, skipped=RUNNING)
    example = Example(
        '<KeepRunningUntilFailure><ScriptCondition code="(n += 1) != 3"/></KeepRunningUntilFailure>',
        ticks=(RUNNING, RUNNING, FAILURE),
        before={'n': 0},
    )

    def execute(self) -> NodeStatus:
        self.status = RUNNING
        status = self._tick()
        if status is FAILURE:
            self.child.status = IDLE
            self.status = FAILURE
            return FAILURE
        if status is SUCCESS:
            self.child.status = IDLE
        return RUNNING


class RunOnce(DecoratorNode):
    """Runs the child until it completes, then never again for the life of the tree, even after a halt.

    Then returns SKIPPED, or the child's result if ``then_skip`` is false.
    """

    __slots__ = ('_result', '_skip')

    running_at_completion = None
    ports = {
        'then_skip': input_port(BOOL, default='true', description='whether to be skipped, instead of the same result')
    }
    example = Example(
        """
        <Repeat num_cycles="2">
          <Fallback><RunOnce then_skip="false"><Script code="n += 1"/></RunOnce></Fallback>
        </Repeat>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'n': 0},
        after={'n': 1},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._result: NodeStatus | None = None
        given = config.values['then_skip']
        # None: read it at each tick.
        self._skip: bool | None = given.literal if given.key is None else None

    def execute(self) -> NodeStatus:
        result = self._result
        if result is not None:
            skip = self._skip
            if skip is None:
                skip = self.get_input_or('then_skip', True)
            if skip:
                return SKIPPED
            self.status = result
            return result
        self.status = RUNNING
        status = self._tick()
        if status is SUCCESS or status is FAILURE:
            self._result = status
            self.child.status = IDLE
            self.status = status
        return status

    def failure_reason(self) -> str:
        return f'{self.id}: the child failed in its one run'


class SubTree(DecoratorNode):
    """Runs another tree, whose root is the child, in a separate blackboard scope."""

    __slots__ = ()

    kind = NodeKind.SUBTREE
    example = Example(
        '<SubTree ID="Greet" who="{name}" text="{greeting}"/>',
        ticks=(SUCCESS,),
        before={'name': 'robot'},
        after={'greeting': 'Hello robot'},
        trees="""
        <BehaviorTree ID="Greet"><Script code="text := 'Hello ' + who"/></BehaviorTree>
        """,
    )

    def execute(self) -> NodeStatus:
        if self.stored_status is IDLE:
            self.status = RUNNING
        status = self._tick()
        if status is SUCCESS or status is FAILURE:
            self.child.status = IDLE
            self.status = status
        elif status is RUNNING:
            self.status = RUNNING
        return status

    def failure_reason(self) -> str:
        return f'the tree [{self.id}] failed'


NODES: Final = (
    Inverter,
    ForceSuccess,
    ForceFailure,
    Repeat,
    RetryUntilSuccessful,
    KeepRunningUntilFailure,
    RunOnce,
    SubTree,
)
