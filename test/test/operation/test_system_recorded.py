# SPDX-License-Identifier: BSD-3-Clause
"""Would it decide otherwise now? A mission is recorded on real processes, and fed to trees in a world."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

from flexbt_common.files import resolve_file
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import BlackboardEntry, ExecutiveCommand, ExecutiveStatus, PendingDecision
from flexbt_msgs.srv import SetFault
from flexbt_testing.nodes.operator import Operator
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import wait_until

DEADLINE = 120.0
TREE = 'flexbt_demo_behaviors/navigate/navigate.xml'
GOAL = '{header: {frame_id: map}, pose: {position: {x: 2.6, y: 4.45}, orientation: {w: 1.0}}}'


def record_mission(folder: Path) -> Path:
    """Record demonstration 1, in which the planner fails for some seconds, so that the tree recovers."""
    file = folder / 'run.mcap'
    with Stack(folder) as stack, NodeRuntime.open('tester') as runtime:
        stack.start_all(onboard_executive={'journal_directory': str(folder)}, in_one=True)
        operator = Operator(runtime)
        operator.wait_for(lambda status: status.peers and all(peer.ready for peer in status.peers), 'all are ready')
        stack.start('recorder', {'use_sim_time': 'false', 'file': str(file)})
        wait_until(lambda: 'ready: hears all' in stack.output('recorder'), 'the recorder hears all', DEADLINE)
        operator.start('Navigate', autonomy=2)

        def question(status: ExecutiveStatus) -> str:
            return next((one.id for one in status.decisions if one.kind == PendingDecision.INPUT), '')

        first = operator.wait_for(question, 'the question for a goal')
        goal = BlackboardEntry(type='geometry_msgs/msg/PoseStamped', text=GOAL)
        operator.applied(ExecutiveCommand.ANSWER, decision_id=first, inputs=[goal])
        operator.wait_active('/Drive')
        client = runtime.node.create_client(SetFault, 'simulator/set_fault')
        wait_until(client.service_is_ready, 'the simulator', DEADLINE)
        fault = SetFault.Request(fault='server_fails', parameters='{server: compute_path_to_pose}', duration=2.0)
        assert runtime.call(lambda: client.call_async(fault)) is not None
        operator.wait_for(lambda status: question(status) not in ('', first), 'the next question')
        second = question(operator.status)
        operator.applied(ExecutiveCommand.DECLINE, decision_id=second)
        operator.wait_idle()
        assert stack.end('recorder', signal.SIGINT, DEADLINE).exit_code == 0
    return file


def test_a_recording_is_decided_again_by_the_same_and_by_another_tree(tmp_path: Path) -> None:
    file = record_mission(tmp_path)

    def again(exit_code: int, *words: str) -> str:
        command = [sys.executable, '-m', 'flexbt_testing.one_process.recorded', str(file), '--tolerance', '5', *words]
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ran.returncode == exit_code, ran.stdout + ran.stderr
        return ran.stdout + ran.stderr

    told = again(0)
    assert told.startswith('no difference in '), told
    assert told.count(' finished\n') == 2, told
    spin = '<Spin spin_dist="1.57" error_code_id="{spin_error_code}"/>'
    text = resolve_file(TREE).read_text()
    assert text.count(spin) == 1
    clears = '<Sequence name="ClearingActions">'
    (tmp_path / 'spin_first.xml').write_text(text.replace(spin, '').replace(clears, spin + clears))
    told = again(1, '--swap', TREE, str(tmp_path / 'spin_first.xml'))
    assert re.match(
        r'first difference at \d+\.\d\d s, tree Navigate\n'
        r'  recorded: ClearLocalCostmap-Subtree (RUNNING|SUCCESS) at .*\n'
        r'  now:      Spin RUNNING at ',
        told,
    ), told
    (tmp_path / 'broken.xml').write_text(text.replace('<FollowPath ', '<Folow '))
    assert 'node type [Folow] is not registered' in again(2, '--swap', TREE, str(tmp_path / 'broken.xml'))
