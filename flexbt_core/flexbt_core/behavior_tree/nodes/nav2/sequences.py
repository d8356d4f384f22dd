# SPDX-License-Identifier: BSD-3-Clause
"""The sequences that Nav2 has in its branch main: NonblockingSequence and PersistentSequence."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree.engine import Control
from flexbt_core.behavior_tree.model import (
    FAILURE,
    INT,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Example,
    NodeStatus,
    inout_port,
)


class NonblockingSequence(Control):
    """Ticks all its children at every tick. SUCCESS when all succeed in one tick; FAILURE as soon as one fails.

    Children that have succeeded are ticked again, without a reset, while others are RUNNING. A child that is skipped is
    an error.
    """

    __slots__ = ()

    nav2_branch = 'main'
    runs_several = True
    example = Example(
        '<NonblockingSequence><Sleep msec="100"/><Script code="n += 1"/></NonblockingSequence>',
        ticks=(RUNNING, SUCCESS),
        before={'n': 0},
        after={'n': 2},
    )

    def tick(self) -> NodeStatus:
        result = SUCCESS
        for index in range(len(self.children)):
            status = self.tick_child(index)
            if status is FAILURE:
                self.reset_children()
                return FAILURE
            if status is SKIPPED:
                raise self.fault(f'the child [{self.children[index].path}] was skipped; {self.id} has no rule for that')
            if status is RUNNING:
                result = RUNNING
        if result is SUCCESS:
            self.reset_children()
        return result


class PersistentSequence(Control):
    """A Sequence that keeps its position on the blackboard, so that a halt, and even another run, goes on from there.

    SUCCESS and SKIPPED of a child advance ``current_child_idx``; the end and a FAILURE set it to 0. The entry has to be
    there before the first tick, such as by ``<Script code="current_child_idx := 0"/>``.
    """

    __slots__ = ()

    nav2_branch = 'main'
    ports = {'current_child_idx': inout_port(INT, description='{key} of the position, from 0')}
    example = Example(
        """
        <PersistentSequence current_child_idx="{position}"><AlwaysSuccess/><Sleep msec="100"/></PersistentSequence>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'position': 0},
        after={'position': 0},
    )

    def tick(self) -> NodeStatus:
        current: int = self.get_input('current_child_idx')
        if current < 0:
            raise ValueError(f'port [current_child_idx] has to be a position from 0 on, not {current}')
        self.status = RUNNING
        while current < len(self.children):
            status = self.tick_child(current)
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                return self._finish(FAILURE)
            current += 1
            self.set_output('current_child_idx', current)
        return self._finish(SUCCESS)

    def _finish(self, status: NodeStatus) -> NodeStatus:
        self.reset_children()
        self.set_output('current_child_idx', 0)
        return status


NODES: Final = (NonblockingSequence, PersistentSequence)
