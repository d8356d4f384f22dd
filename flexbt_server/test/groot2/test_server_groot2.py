# SPDX-License-Identifier: BSD-3-Clause
"""Groot2 and log files of a live BT server: what a client sees of runs; breakpoints keep nobody from stopping them."""

from __future__ import annotations

import functools
import json
import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.behavior_tree.engine.tick_control import TickCommand
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import TreeStatus
from flexbt_server.bt_server import BtServer
from flexbt_server.errors import ServerParameterError
from flexbt_server.groot2.log_file import LogWriter, read_log
from flexbt_server.groot2.protocol import RequestType, request_header
from flexbt_server.runs import run_logs
from flexbt_testing.nodes.server_world import ServerWorld, open_server_world, pose_stamped
from flexbt_testing.system.processes import free_pair
from flexbt_testing.waiting import DEADLINE, uncontended_time, wait_until

pytestmark = pytest.mark.dds('Groot2 talks by sockets of ZeroMQ')

Result = BtExecute.Result
BODY = '<Sequence><Script code="x := 1"/><AlwaysSuccess name="stop here"/><Sleep msec="1"/></Sequence>'


class Groot2:
    """A client, and the BT server that it is connected to."""

    def __init__(self, context: zmq.Context[Any], port: int, world: ServerWorld) -> None:
        client = self.client = world.client
        self.server = world.server_runtime
        self.goals = world.server.goals
        self.paused: list[bool] = []
        client.runtime.call(
            lambda: client.runtime.node.create_subscription(
                TreeStatus,
                names.TREE_STATUS,
                lambda status: self.paused.append(status.paused),
                names.transient_local_qos(16),
            )
        )
        self._requests = context.socket(zmq.REQ)
        self._requests.set(zmq.RCVTIMEO, int(DEADLINE * 1000))
        self._requests.connect(f'tcp://127.0.0.1:{port}')

    def ask(self, type: RequestType, *content: bytes) -> list[bytes]:
        self._requests.send_multipart([request_header(type), *content])
        return self._requests.recv_multipart()

    def hook(self, uid: int, **changes: Any) -> None:
        hook = {'enabled': True, 'uid': uid, 'mode': 0, 'once': False, 'desired_status': 'SKIPPED', 'position': 0}
        assert self.ask(RequestType.HOOK_INSERT, json.dumps(hook | changes).encode())[0] != b'error'

    def held(self) -> None:
        wait_until(lambda: self.paused and self.paused[-1], 'the pause')


@pytest.fixture
def groot2() -> Iterator[Groot2]:
    port = free_pair()
    with open_server_world(groot2_port=port) as world, zmq.Context() as context:
        world.client.load_tree(BODY)
        yield Groot2(context, port, world)
        context.destroy(linger=0)


def test_a_breakpoint_holds_a_run_up_until_it_is_unlocked(groot2: Groot2) -> None:
    assert groot2.client.execute().wait().status is GoalStatus.SUCCEEDED
    assert b'_uid="4"' in groot2.ask(RequestType.FULL_TREE)[1]
    groot2.hook(3)
    goal = groot2.client.execute(goals=[pose_stamped(1, 2)])
    groot2.held()
    statuses = groot2.ask(RequestType.STATUS)[1]
    assert statuses[2::3] == bytes((1, 2, 0, 0))
    boards = msgpack.unpackb(groot2.ask(RequestType.BLACKBOARD, b'Main')[1])
    assert boards['Main']['x'] == 1
    assert boards['Main']['goal']['__type'] == 'geometry_msgs/msg/PoseStamped'
    assert boards['Main']['goal']['pose']['position']['y'] == 2.0
    groot2.ask(
        RequestType.BREAKPOINT_UNLOCK,
        b'{"uid": 3, "position": 0, "desired_status": "FAILURE", "remove_when_done": true}',
    )
    assert goal.wait().status is GoalStatus.ABORTED
    assert goal.result.code == Result.FAILURE
    wait_until(lambda: not groot2.paused[-1], 'the end of the pause')


def test_a_paused_tree_stays_shown_as_paused_after_a_step_to_a_breakpoint(groot2: Groot2) -> None:
    groot2.client.load_tree(f'<KeepRunningUntilFailure>{BODY}</KeepRunningUntilFailure>')
    goal = groot2.client.execute()
    wait_until(lambda: groot2.ask(RequestType.STATUS)[0] != b'error', 'the tree')
    (running,) = groot2.goals.running.all()
    answers: list[str] = []
    running.run.control(TickCommand.PAUSE, answers.append)
    wait_until(lambda: answers, 'the pause')
    groot2.hook(1)
    running.run.control(TickCommand.STEP, answers.append)
    (server,) = (one._server for one in groot2.goals._watchers if isinstance(one, run_logs.Groot2Runs))
    wait_until(lambda: server._shown is not None and server._shown.breakpoints.held, 'the breakpoint')
    count = len(groot2.paused)
    groot2.ask(
        RequestType.BREAKPOINT_UNLOCK,
        b'{"uid": 1, "position": 0, "desired_status": "SKIPPED", "remove_when_done": true}',
    )
    wait_until(lambda: len(answers) == 2, 'the end of the step')
    wait_until(lambda: len(groot2.paused) > count and groot2.paused[-1], 'the pause, which goes on')
    goal.call.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    assert groot2.paused[count:-1] == [True] * (len(groot2.paused) - count - 1)


def test_a_cancel_lets_go_at_once_and_begins_nothing(groot2: Groot2) -> None:
    groot2.client.execute().wait()
    groot2.hook(2)
    goal = groot2.client.execute()
    groot2.held()
    begun = uncontended_time()
    goal.call.cancel()
    assert goal.wait().status is GoalStatus.CANCELED
    assert uncontended_time() - begun < 1.5
    assert goal.result.code == Result.CANCELED
    # The Script that follows the breakpoint was not run: no node after it has ever had a status.
    assert groot2.ask(RequestType.STATUS)[1][2::3] == bytes((11, 0, 0, 0))
    groot2.ask(RequestType.REMOVE_ALL_HOOKS)


def test_silence_lets_go(groot2: Groot2) -> None:
    groot2.client.execute().wait()
    groot2.hook(1)
    goal = groot2.client.execute()
    groot2.held()
    assert goal.wait().status is GoalStatus.SUCCEEDED
    groot2.ask(RequestType.REMOVE_ALL_HOOKS)


def test_the_server_ends_while_a_breakpoint_holds_a_tree_up(groot2: Groot2) -> None:
    groot2.client.execute().wait()
    groot2.hook(1)
    groot2.client.execute()
    groot2.held()
    begun = uncontended_time()
    groot2.server.close()
    assert uncontended_time() - begun < 2.0


def test_every_run_has_a_log_file(tmp_path: Path) -> None:
    """All transitions are in it, the last ones too; the oldest files go, and what is not ours or cannot go stays."""
    directory = tmp_path / 'logs'
    stays = directory / '20200101T000000.000000Z_Logged_00000000.btlog'
    stays.mkdir(parents=True)
    (directory / 'mine.btlog').write_text('mine')
    with open_server_world(btlog_directory=str(directory), btlog_keep=2) as world:
        world.client.load_tree(BODY, 'Logged')
        for _ in range(3):
            assert world.client.execute('Logged').wait().status is GoalStatus.SUCCEEDED
    (directory / 'mine.btlog').unlink()
    stays.rmdir()
    files = sorted(directory.iterdir())
    assert len(files) == 2
    for file in files:
        assert '_Logged_' in file.name
        log = read_log(file)
        assert log.left_over == 0
        last = {entry.uid: entry for entry in log.transitions}
        assert {entry.after.name for entry in last.values()} == {'IDLE'}
        assert [entry.after.name for entry in log.transitions if entry.uid == 1] == ['RUNNING', 'SUCCESS', 'IDLE']
        assert log.nodes[3] == ('stop here', 'AlwaysSuccess')
        assert abs(log.epoch - time.time()) < 600.0


def test_the_log_of_a_tree_with_a_long_name_is_written(tmp_path: Path) -> None:
    name = '導' * 90
    with open_server_world(btlog_directory=str(tmp_path)) as world:
        world.client.load_tree(BODY, name)
        assert world.client.execute(name).wait().status is GoalStatus.SUCCEEDED
    (file,) = tmp_path.iterdir()
    assert file.name[24:].split('_')[0] == name[:26] and read_log(file).transitions


def test_a_disk_that_hangs_is_told_and_holds_up_no_tree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    goes, hangs = threading.Event(), threading.Event()
    store = LogWriter._store

    def hang(*arguments: Any) -> None:
        hangs.set()
        assert goes.wait(60.0)
        store(*arguments)

    monkeypatch.setattr(LogWriter, '_store', hang)
    monkeypatch.setattr(run_logs, 'STUCK_SECONDS', 0.1)
    monkeypatch.setattr(run_logs, 'MOST_WAITING', 10)
    monkeypatch.setattr(run_logs, '_CLOSE_SECONDS', DEADLINE)  # all is written, however busy the machine is
    told = ''

    def is_told(text: str) -> bool:
        nonlocal told
        told += capfd.readouterr().err
        return text in told

    with open_server_world(btlog_directory=str(tmp_path)) as world:
        world.client.load_tree('<Repeat num_cycles="20"><Sleep msec="1"/></Repeat>', 'Long')
        for _ in range(2):
            assert world.client.execute('Long').wait().status is GoalStatus.SUCCEEDED
        assert hangs.wait(DEADLINE)
        ends = f'the log of this run ends here: the disk does not answer, and {run_logs.MOST_WAITING}'
        for text in ('the disk does not answer; the logs of trees wait', ends):
            wait_until(functools.partial(is_told, text), text)
        writers = [thread for thread in threading.enumerate() if thread.name == 'btlog']
        assert writers and all(thread.daemon for thread in writers), 'the end of the process does not wait for the disk'
        refused = re.search(r'(\S+): the log of this run ends here', told)
        goes.set()
    assert refused
    log = read_log(Path(refused[1]))
    assert log.transitions and not log.left_over, 'what had waited was written'


def test_parameters_that_cannot_work_are_refused(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    for parameters, text in (
        ({'btlog_directory': 'relative'}, 'absolute'),
        ({'btlog_directory': str(tmp_path / 'file')}, 'exist'),
        ({'groot2_port': free_pair(), 'groot2_address': 'nowhere.invalid'}, 'groot2_port'),
    ):
        with (
            NodeRuntime.open('bt_server', parameters=parameters) as runtime,
            pytest.raises(ServerParameterError, match=text),
        ):
            BtServer(runtime)
