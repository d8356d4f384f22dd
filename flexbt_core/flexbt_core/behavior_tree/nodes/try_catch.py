# SPDX-License-Identifier: BSD-3-Clause
"""TryCatch: a sequence that cleans up after itself."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree.engine import ControlNode, NodeConfig, halt_child
from flexbt_core.behavior_tree.model import (
    BOOL,
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Example,
    NodeStatus,
    input_port,
)


class TryCatch(ControlNode):
    """Runs all children but the last as a Sequence; when one fails, the last, the clean-up, and is FAILURE after that.

    Whatever the clean-up gives, the node fails: it is there to repair, not to succeed instead. With ``catch_on_halt`` a
    halt of the sequence ticks the clean-up as well, once; if that does not complete it in one tick, it is halted.
    SKIPPED when all children of the sequence were skipped.
    """

    __slots__ = ('_catching', '_index', '_skipped')

    ports = {
        'catch_on_halt': input_port(BOOL, default='false', description='whether a halt ticks the last child, too'),
    }
    children_bounds = (2, None)
    example = Example(
        """
        <TryCatch><Sequence><AlwaysSuccess/><AlwaysFailure/></Sequence><Script code="repaired := true"/></TryCatch>
        """,
        ticks=(FAILURE,),
        after={'repaired': True},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._index = 0
        self._skipped = 0
        self._catching = False

    def execute(self) -> NodeStatus:
        if self.status is IDLE:
            self._skipped = 0
            self._catching = False
        self.status = RUNNING
        if not self._catching:
            status = self._try()
            if status is not FAILURE:
                return status
        status = self._ticks[-1]()
        if status is RUNNING:
            return RUNNING
        self.reset_children()
        self._catching = False
        self.status = FAILURE
        return FAILURE

    def _try(self) -> NodeStatus:
        """Goes on with the sequence. After FAILURE it is over, and the clean-up has its turn."""
        ticks = self._ticks
        index = self._index
        last = len(ticks) - 1
        while index < last:
            status = ticks[index]()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                self._failed = index
                self._index = 0
                self._catching = True
                self.reset_children()
                return FAILURE
            if status is SKIPPED:
                self._skipped += 1
            # Kept at each step, so that a child that raises is the one with which the node goes on.
            self._index = index = index + 1
        all_skipped = self._skipped == last
        self._index = self._skipped = 0
        self.reset_children()
        if all_skipped:
            return SKIPPED
        self.status = SUCCESS
        return SUCCESS

    def failure_reason(self) -> str:
        return f'{super().failure_reason()}; [{self.children[-1].path}] has cleaned up'

    def halt(self) -> None:
        if self.status is RUNNING and not self._catching:
            self.stop_by(self._catch_the_halt)
        self._index = self._skipped = 0
        self._catching = False
        super().halt()

    def _catch_the_halt(self) -> None:
        if self.get_input_or('catch_on_halt', False):
            for child in self.children[:-1]:
                halt_child(child)
            self._ticks[-1]()


NODES: Final = (TryCatch,)
