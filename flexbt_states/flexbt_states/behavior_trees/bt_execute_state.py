# SPDX-License-Identifier: BSD-3-Clause
"""State that runs a behavior tree."""

from __future__ import annotations

from collections.abc import Mapping

from flexbt_common import names
from flexbt_core.state_machine import UserData
from flexbt_states.support import checked_types

from .tree_state import TreeState


class BtExecuteState(TreeState):
    """
    Run a behavior tree on the BT server until it ends.

    When the tree fails or is canceled, those keys are given that are on the blackboard: on one that trees share, also
    what a tree before has left there.

    -- bt_topic     string      Name of the action of the BT server
    -- bt_file      string      Tree identifier, or package/relative/path.xml; empty for the server's default tree
    -- inputs       dict        Blackboard keys to write before the first tick, with their types
    -- outputs      dict        Blackboard keys to read at the end, with their types
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
        written, read = checked_types(self, 'inputs', inputs), checked_types(self, 'outputs', outputs)
        super().__init__(bt_topic, bt_file, written, read, blackboard, timeout)

    def on_enter(self, userdata: UserData) -> None:
        self._run_tree(userdata)
