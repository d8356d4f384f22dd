# SPDX-License-Identifier: BSD-3-Clause
"""Recordings for the tests of the studio: a robot that loses its path, and the log of a tree."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from ament_index_python.packages import get_package_share_path
from nav_msgs.msg import OccupancyGrid

from flexbt_common import names
from flexbt_console.recording.run_file import write_recording
from flexbt_msgs.msg import (
    ActiveState,
    ExecutiveLog,
    ExecutiveStatus,
    TreeNode,
    TreeStatus,
    TreeStatusChange,
    TreeStructure,
)
from flexbt_testing.behavior_trees.bt_tool import tool

TREE = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Drive">
    <Fallback>
      <Wait name="Look" wait_duration="1"/>
      <Wait name="Turn" wait_duration="1"/>
      <Wait name="Never" wait_duration="1"/>
    </Fallback>
  </BehaviorTree>
</root>
"""
MACHINE = """\
behavior: {name: Tour}
machine:
  outcomes: [done]
  states:
    Run: {state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: Rest}}
    Rest: {state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: done}}
"""
PATHS = ('Fallback::1', 'Look', 'Turn', 'Never')
STATUSES = {1.0: (1, 1, 0, 0), 2.0: (1, 3, 1, 0), 4.0: (2, 0, 2, 0)}
"""Statuses of the nodes from each time on, s."""


def record(file: Path) -> None:
    """Write a run of five seconds: the tree Drive in the state /Run, where Look fails after 2 s; /Rest after 4 s."""
    file.parent.mkdir(parents=True, exist_ok=True)
    nodes = [TreeNode(uid=uid, parent=int(uid > 1), name=path, path=path) for uid, path in enumerate(PATHS, 1)]
    grid = OccupancyGrid()
    grid.header.frame_id, grid.info.width, grid.info.height, grid.info.resolution = 'map', 40, 20, 0.1
    grid.data = [0] * 700 + [100] * 100
    said = [
        (10**8, names.MAP, grid),
        (10**8, names.TREE_STRUCTURE, TreeStructure(run_id='t', behavior_tree='Drive', nodes=nodes, number=1)),
    ]
    for number, (time, statuses) in enumerate(STATUSES.items(), 1):
        changes = [TreeStatusChange(uid=uid, status=one) for uid, one in enumerate(statuses, 1)]
        status = TreeStatus(run_id='t', sequence=number, structure=1, statuses=statuses, changes=changes)
        said.append((int(time * 1e9), names.TREE_STATUS, status))
    lost = ExecutiveLog(
        executive_id='e', sequence=1, severity=ExecutiveLog.ERROR, text='lost the path', path='/Run', run_id='r'
    )
    said.append((2 * 10**9, names.EXECUTIVE_LOG, lost))
    for half in range(11):
        status = ExecutiveStatus(executive_id='e', state=ExecutiveStatus.RUNNING, run_id='r', behavior='Tour')
        path = '/Run' if half < 8 else '/Rest'
        status.active_states, status.sequence, status.heartbeat_period = [ActiveState(path=path)], half + 1, 1.0
        said.append((half * 5 * 10**8, names.EXECUTIVE_STATUS, status))
    write_recording(file, sorted(said, key=lambda one: one[0]))


def log(folder: Path, file: Path, *mocks: str) -> None:
    """Write the log of a dry run of the tree in this folder."""
    words = [word for mock in mocks for word in ('--mock', mock)]
    done = tool('run', *words, '--btlog', str(file), str(folder / 'drive.xml'))
    assert done.code == 0, done.err


MISSION = """
import sys
from pathlib import Path
from flexbt_testing.one_process.world import World
from flexbt_testing.one_process.programs import Program, named_programs

file = Path(sys.argv[1])
recorder = Program('flexbt_console', 'recorder', {'file': str(file)})
with World(0, [*named_programs('', file.parent, file.parent, 'abstract'), recorder], writable=[file.parent]) as world:
    world.run(5.0)
    world.start('Navigate Split')
    world.answer('/AskGoal', 'corridor')
    world.choose('/JudgePath', 'canceled')
    world.decline('/AskGoal')
    world.run_until(world.ended('finished'))
    world.run(1.0)
    world.terminate('recorder')
    world.run(2.0)
"""


def installed_project(folder: Path) -> str:
    """Make a project with an installed tree, whose name is returned, and a recording of a mission that has used it."""
    name = 'navigate/global_planner.xml'
    (folder / 'recordings').mkdir()
    subprocess.run([sys.executable, '-c', MISSION, str(folder / 'recordings' / 'run.mcap')], check=True)
    (folder / 'navigate').mkdir()
    shutil.copy(get_package_share_path('flexbt_demo_behaviors') / name, folder / name)
    (folder / 'package.xml').write_text('<package><name>flexbt_demo_behaviors</name></package>')
    return name
