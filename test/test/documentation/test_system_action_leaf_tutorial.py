# SPDX-License-Identifier: BSD-3-Clause
"""The leaf of the tutorial, taken literally from its text: the BT server finds it, and it turns the robot."""

import os
import re
from pathlib import Path

from nav2_msgs.action import Spin

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.action import BtExecute
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack

PAGE = (Path(__file__).parents[3] / 'docs' / 'tutorials' / 'action_leaf.md').read_text(encoding='utf-8')


def block(name: str) -> str:
    """Return the fenced block after the name of a file."""
    found = re.search(rf'^`{name}`:\n\n```\w+\n(.*?)^```$', PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None, name
    return found[1]


def test_the_leaf_is_short() -> None:
    lines = [line for line in block('look_around/look_around.py').splitlines() if line and ' import ' not in line]
    assert len(lines) <= 25


def test_the_leaf_turns_the_robot(tmp_path: Path) -> None:
    package, trees = tmp_path / 'look_around', tmp_path / 'share' / 'look_around' / 'trees'
    index = tmp_path / 'share' / 'ament_index' / 'resource_index' / 'packages'
    about = tmp_path / 'look_around-1.0.dist-info'
    for directory in (package, trees, index, about):
        directory.mkdir(parents=True)
    (package / '__init__.py').touch()
    (index / 'look_around').touch()
    (package / 'look_around.py').write_text(block('look_around/look_around.py'), encoding='utf-8')
    (trees / 'look.xml').write_text(block('trees/look.xml'), encoding='utf-8')
    (about / 'METADATA').write_text('Metadata-Version: 2.1\nName: look_around\nVersion: 1.0\n', encoding='utf-8')
    [point] = re.findall(r"'(flexbt\.bt_nodes)': \['(.*?)'\]", PAGE)
    (about / 'entry_points.txt').write_text('[{}]\n{}\n'.format(*point), encoding='utf-8')
    before = {name: os.environ.get(name, '') for name in ('PYTHONPATH', 'AMENT_PREFIX_PATH')}
    installed = {name: os.pathsep.join([str(tmp_path), value]) for name, value in before.items()}
    with Stack(tmp_path) as stack, NodeRuntime.open('client') as runtime:
        probe = Probe(runtime)
        stack.start('simulation', {'speed_factor': '4.0'})
        stack.start('bt_server', environment=installed)
        spin = ActionLinks(runtime).link(Spin, names.SPIN)
        probe.wait(lambda: probe.pose and runtime.call(spin.is_ready), 'the robot and its navigation')
        goal = BtExecute.Goal(behavior_tree='look_around/trees/look.xml', outputs=['seconds'])
        outcome = probe.call(BtExecute, names.BT_EXECUTOR, goal)
        assert outcome.result is not None, outcome
        assert outcome.result.code == BtExecute.Result.SUCCESS, outcome
        assert float(outcome.result.outputs[0].text) > 0.5, 'at 1.82 rad/s and less'
        probe.wait(lambda: probe.pose and 0.5 < abs(probe.pose.pose.orientation.z) < 0.9, 'a turn by 90 degrees')
