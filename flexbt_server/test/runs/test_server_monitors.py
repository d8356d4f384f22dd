# SPDX-License-Identifier: BSD-3-Clause
"""What the monitors of the BT server find is in its log and in the result, and ends the run where that is wanted."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexbt_common.calls.action_call import GoalStatus
from flexbt_msgs.action import BtExecute
from flexbt_testing.nodes.server_world import open_server_world

SPIN = '<Spin spin_dist="1.0" name="{}"/>'
BOTH = f'<Parallel success_count="2">{SPIN.format("one")}{SPIN.format("other")}</Parallel>'


@pytest.mark.parametrize('action', ['warn', 'stop'])
def test_two_owners_are_told_in_the_result(action: str, tmp_path: Path) -> None:
    required = tmp_path / 'required.yaml'
    required.write_text('Main:\n  - never one > SUCCESS\n  - never nobody\n')
    with open_server_world(monitors=True, monitor_action=action, requirements=str(required)) as world:
        world.client.load_tree(BOTH)
        both = world.client.execute('Main')
        assert 'monitor: base has two owners at once: one and other' in both.result.message
        code = BtExecute.Result.SUCCESS if action == 'warn' else BtExecute.Result.CANCELED
        assert both.result.code == code
        world.client.load_tree(f'<Sequence>{SPIN.format("one")}{SPIN.format("other")}</Sequence>', 'Sound')
        sound = world.client.execute('Sound')
        assert sound.result.message == '' and sound.wait().status is GoalStatus.SUCCEEDED
