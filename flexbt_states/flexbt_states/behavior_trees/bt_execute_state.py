# SPDX-License-Identifier: BSD-3-Clause
"""State that runs a behavior tree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from flexbt_common import names
from flexbt_core.state_machine import EventState, Progress, UserData
from flexbt_states.support import checked_timeout, checked_topic, checked_tree, checked_types

from .bt_server_use import BtUse
from .tree_execution import TreeExecution


class BtExecuteState(EventState):
    """
    Run a behavior tree on the BT server until it ends.

    -- bt_topic     string      Name of the action of the BT server
    -- bt_file      string      Tree identifier, or package/relative/path.xml; empty for the server's default tree
    -- inputs       dict        Blackboard keys to write before the first tick, with their types
    -- outputs      dict        Blackboard keys to read after success, with their types
    -- blackboard   string      Name of the blackboard to run on; empty for the shared one
    -- timeout      float       Seconds on the node's clock after which the tree is canceled; None for no limit

    ># KEY                      Each key of inputs: a value of the declared type.
    #> KEY                      Each key of outputs: a value of the declared type.

    <= done                     The tree succeeded, and its outputs are there.
    <= canceled                 The tree was canceled by somebody else, or replaced by another goal.
    <= failed                   The tree failed, could not run, or took too long; the operator is told why.
    """

    def __init__(
        self,
        bt_topic: str = names.BT_EXECUTOR,
        bt_file: str = '',
        inputs: Mapping[str, str] | None = None,
        outputs: Mapping[str, str] | None = None,
        blackboard: str = '',
        timeout: float | None = None,
    ) -> None:
        self._inputs = checked_types(self, 'inputs', inputs)
        wanted = checked_types(self, 'outputs', outputs)
        super().__init__(
            outcomes=['done', 'canceled', 'failed'],
            input_keys=list(self._inputs),
            output_keys=list(wanted),
            desired_rate=None,
        )
        self._execution = TreeExecution(
            self,
            checked_topic(self, 'bt_topic', bt_topic),
            checked_tree(self, 'bt_file', bt_file),
            wanted,
            {},
            blackboard,
            checked_timeout(self, 'timeout', timeout),
        )

    @property
    def bt_use(self) -> BtUse:
        return self._execution.use(self._inputs)

    def on_start(self) -> None:
        self._execution.prepare()

    def on_enter(self, userdata: UserData) -> None:
        self._execution.start([], [(key, userdata[key], type) for key, type in self._inputs.items()])

    def execute(self, userdata: UserData) -> str | None:
        return self._execution.outcome(userdata)

    def on_pause(self) -> None:
        self._execution.set_paused(True)

    def on_resume(self, userdata: UserData) -> None:
        self._execution.set_paused(False)

    def on_exit(self, userdata: UserData) -> None:
        self._execution.leave()

    def halting(self) -> str | None:
        return self._execution.halting()

    def activity(self) -> Sequence[str]:
        return self._execution.activity()

    def progress(self) -> Progress | None:
        return self._execution.progress()
