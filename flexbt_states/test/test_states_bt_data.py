# SPDX-License-Identifier: BSD-3-Clause
"""The states that load trees and that read and write the blackboard."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import pytest
from nav_msgs.msg import Path

from flexbt_common.values.entries import from_entry, to_entry
from flexbt_msgs.action import BtGetData, BtLoad, BtSetData
from flexbt_msgs.msg import BtLoadError, BtLoadReport
from flexbt_states import BtGetDataState, BtLoaderState, BtLoadState, BtSetDataState
from flexbt_states.errors import StateParameterError
from flexbt_testing.nodes.scripted_action_server import ends
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import wait_until


@pytest.fixture
def tree_file(tmp_path: FilePath) -> str:
    file = tmp_path / 'tree.xml'
    file.write_text('<root BTCPP_format="4"/>')
    return str(file)


def test_files_are_loaded_on_every_visit(bench: StateBench, tree_file: str) -> None:
    server = bench.serve(BtLoad, 'bt_loader', ends(BtLoad.Result(code=BtLoad.Result.SUCCESS)))
    state = BtLoaderState(filepaths=[tree_file], xml='<root/>')
    for _ in range(2):
        assert bench.run_state(lambda: BtLoaderState(filepaths=[tree_file], xml='<root/>')).wait() == 'done'
    assert [(list(goal.files), goal.xml) for goal in server.goals] == [([tree_file], '<root/>')] * 2
    assert BtLoadState is type(state)


def test_every_reason_of_a_refused_file_reaches_the_operator(bench: StateBench, tree_file: str) -> None:
    errors = [
        BtLoadError(file='a.xml', line=3, column=5, node='Foo', message='unknown node'),
        BtLoadError(file='a.xml', line=9, column=1, message='no main tree'),
    ]
    result = BtLoad.Result(
        code=BtLoad.Result.FAILURE,
        message='1 file refused',
        reports=[BtLoadReport(file='a.xml', code=BtLoadReport.REFUSED, errors=errors)],
    )
    bench.serve(BtLoad, 'bt_loader', ends(result, 'abort'))
    run = bench.run_state(lambda: BtLoaderState(filepaths=[tree_file]))
    assert run.wait() == 'failed'
    assert 'a.xml:3:5: Foo: unknown node' in run.errors()
    assert 'a.xml:9:1: no main tree' in run.errors()


FAILURES = [('succeed', 0), ('abort', 0), ('abort', 1), ('succeed', 2), ('succeed', 4), ('abort', 2), ('succeed', 99)]


@pytest.mark.parametrize(('how', 'code'), FAILURES)
@pytest.mark.parametrize('kind', ['load', 'get', 'set'])
def test_nothing_but_success_counts_as_done(bench: StateBench, tree_file: str, kind: str, how: str, code: int) -> None:
    if kind == 'load':
        bench.serve(BtLoad, 'bt_loader', ends(BtLoad.Result(code=code, message='why'), how))
        run = bench.run_state(lambda: BtLoaderState(filepaths=[tree_file]))
    elif kind == 'get':
        bench.serve(BtGetData, 'bt_get_data', ends(BtGetData.Result(code=code, message='why'), how))
        run = bench.run_state(lambda: BtGetDataState(request_id='x', request_msg_type='string'), {'data': ''})
    else:
        bench.serve(BtSetData, 'bt_set_data', ends(BtSetData.Result(code=code, message='why'), how))
        run = bench.run_state(lambda: BtSetDataState(goal_id='x', goal_msg_type='string'), {'goal': ''})
    assert run.wait() == 'failed'
    assert run.errors()


def test_without_a_server_the_states_fail_soon(bench: StateBench, tree_file: str) -> None:
    runs = [
        bench.run_state(lambda: BtLoaderState(filepaths=[tree_file])),
        bench.run_state(lambda: BtGetDataState(request_id='x', request_msg_type='string'), {'data': ''}),
        bench.run_state(lambda: BtSetDataState(goal_id='x', goal_msg_type='string'), {'goal': ''}),
    ]
    assert [run.wait() for run in runs] == ['failed'] * 3
    assert [name in run.errors() for run, name in zip(runs, ['bt_loader', 'bt_get_data', 'bt_set_data'], strict=True)]


def test_an_answer_that_does_not_come_in_time_is_failed(bench: StateBench) -> None:
    async def script(goal_handle: Any) -> Any:
        await released
        goal_handle.abort()
        return BtGetData.Result()

    server = bench.serve(BtGetData, 'bt_get_data', script)
    released = server.future()
    run = bench.run_state(lambda: BtGetDataState(request_id='x', request_msg_type='string', timeout=0.1), {'data': ''})
    wait_until(lambda: server.cancels, 'cancel')
    server.resolve(released)
    assert run.wait() == 'failed'
    assert '0.1 s' in run.errors()


def test_values_are_read_with_their_types(bench: StateBench) -> None:
    entries = [to_entry('path', Path()), to_entry('n', 3)]
    server = bench.serve(
        BtGetData, 'bt_get_data', ends(BtGetData.Result(code=BtGetData.Result.SUCCESS, entries=entries))
    )
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: BtGetDataState(
            request_id='path', request_msg_type='nav_msgs/msg/Path', outputs={'n': 'uint8'}, blackboard='b'
        ),
        {'data': None, 'n': None},
        outputs=['data', 'n'],
        read=read,
    )
    assert run.wait() == 'done', run.lines
    assert read == {'data': Path(), 'n': 3}
    assert (server.goals[0].blackboard, sorted(server.goals[0].keys)) == ('b', ['n', 'path'])


@pytest.mark.parametrize(
    ('entries', 'words'),
    [
        ([], "did not send 'n'"),
        ([to_entry('n', 300)], 'uint8'),
        ([to_entry('n', 'three')], 'uint8'),
        ([to_entry('m', 3)], "did not send 'n'"),
    ],
)
def test_a_value_of_another_type_is_not_taken(bench: StateBench, entries: list[Any], words: str) -> None:
    bench.serve(BtGetData, 'bt_get_data', ends(BtGetData.Result(code=BtGetData.Result.SUCCESS, entries=entries)))
    run = bench.run_state(lambda: BtGetDataState(outputs={'n': 'uint8'}), {'n': 0})
    assert run.wait() == 'failed'
    assert words in run.errors()


def test_values_are_written_with_their_types(bench: StateBench) -> None:
    server = bench.serve(BtSetData, 'bt_set_data', ends(BtSetData.Result(code=BtSetData.Result.SUCCESS)))
    run = bench.run_state(
        lambda: BtSetDataState(goal_id='path', goal_msg_type='nav_msgs/Path', inputs={'n': 'uint8'}, blackboard='b'),
        {'goal': Path(), 'n': 3},
    )
    assert run.wait() == 'done', run.lines
    written = {entry.key: (entry.type, from_entry(entry)) for entry in server.goals[0].entries}
    assert written == {'path': ('nav_msgs/msg/Path', Path()), 'n': ('uint8', 3)}
    assert server.goals[0].blackboard == 'b'


def test_a_value_that_does_not_fit_is_not_written(bench: StateBench) -> None:
    server = bench.serve(BtSetData, 'bt_set_data', ends(BtSetData.Result(code=BtSetData.Result.SUCCESS)))
    run = bench.run_state(lambda: BtSetDataState(inputs={'n': 'uint8'}), {'n': 300})
    assert run.wait() == 'failed'
    assert '300' in run.errors()
    assert server.goals == []


@pytest.mark.parametrize(
    ('make', 'words'),
    [
        (lambda: BtLoaderState(), 'empty'),
        (lambda: BtLoaderState(filepaths='a.xml'), 'not a list'),
        (lambda: BtLoaderState(filepaths=['flexbt_msgs/none.xml']), 'no such file'),
        (lambda: BtLoaderState(filepaths=['/none/at/all.xml']), 'no such file'),
        (lambda: BtLoaderState(xml='<root/>', timeout=-1), 'timeout'),
        (lambda: BtLoaderState(xml=5), 'xml'),  # type: ignore[arg-type]
        (lambda: BtGetDataState(), 'no key to read'),
        (lambda: BtGetDataState(request_id=5), 'request_id'),  # type: ignore[arg-type]
        (lambda: BtGetDataState(outputs={5: 'string'}), '5 is not text'),  # type: ignore[dict-item]
        (lambda: BtGetDataState(outputs={'x': 'string'}, blackboard=5), 'blackboard'),  # type: ignore[arg-type]
        (lambda: BtGetDataState(request_id='x'), 'request_msg_type'),
        (lambda: BtGetDataState(request_id='x', request_msg_type='nope/msg/Nope'), 'nope'),
        (lambda: BtGetDataState(request_id='x', request_msg_type='string', outputs={'x': 'string'}), 'request_id'),
        (lambda: BtSetDataState(), 'no key to write'),
        (lambda: BtSetDataState(inputs={'x': 'string'}, blackboard=5), 'blackboard'),  # type: ignore[arg-type]
        (lambda: BtSetDataState(goal_id='x', goal_msg_type='Path'), 'goal_msg_type'),
        (lambda: BtSetDataState(goal_id='x', goal_msg_type='string', inputs={'goal': 'string'}), 'goal_id'),
    ],
)
def test_what_cannot_work_is_refused_when_the_state_is_made(make: Any, words: str) -> None:
    with pytest.raises(StateParameterError) as refusal:
        make()
    assert words in str(refusal.value)
