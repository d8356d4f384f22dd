# SPDX-License-Identifier: BSD-3-Clause
"""BtLoad on a live server: all or nothing, a report per file, refusals with place and reason, in time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common.calls.action_call import GoalStatus
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_msgs.msg import BtLoadReport
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.server_world import ServerWorld, document, open_server_world
from flexbt_testing.waiting import DEADLINE, processor_time, wait_until

Result = BtLoad.Result
MUCH = 1_000_000


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServerWorld]:
    """Yield a server that may read tmp_path/trees, and a package 'fixture_trees' whose share is tmp_path/share."""
    prefix = tmp_path / 'prefix'
    index = prefix / 'share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    (index / 'fixture_trees').touch()
    (prefix / 'share/fixture_trees').mkdir()
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix), prepend=':')
    (tmp_path / 'trees').mkdir()
    with open_server_world(allowed_directories=[str(tmp_path / 'trees')]) as opened:
        yield opened


def write(path: Path, text: str) -> str:
    path.write_text(text)
    return str(path)


def test_files_and_text_are_loaded_and_reported(world: ServerWorld, tmp_path: Path) -> None:
    write(tmp_path / 'prefix/share/fixture_trees/a.xml', document('<AlwaysSuccess/>', 'A'))
    absolute = write(tmp_path / 'trees/b.xml', document('<SubTree ID="A"/>', 'B'))
    result = world.client.load('fixture_trees/a.xml', absolute, xml=document('<SubTree ID="B"/>', 'C'))
    assert result.code == Result.SUCCESS, result.message
    assert [(report.file, report.code, list(report.trees)) for report in result.reports] == [
        ('fixture_trees/a.xml', BtLoadReport.LOADED, ['A']),
        (absolute, BtLoadReport.LOADED, ['B']),
        ('<xml>', BtLoadReport.LOADED, ['C']),
    ]
    assert world.client.execute('C').result.code == BtExecute.Result.SUCCESS
    again = world.client.load('fixture_trees/a.xml')
    assert again.reports[0].code == BtLoadReport.UNCHANGED


def test_one_bad_file_refuses_all_and_what_was_loaded_still_works(world: ServerWorld, tmp_path: Path) -> None:
    good = write(tmp_path / 'trees/good.xml', document('<AlwaysSuccess/>', 'Good'))
    assert world.client.load(good).code == Result.SUCCESS
    write(tmp_path / 'trees/good.xml', document('<AlwaysFailure/>', 'Good'))
    bad = write(
        tmp_path / 'trees/bad.xml',
        '<root BTCPP_format="4">\n <BehaviorTree ID="X">\n  <Nowhere/>\n </BehaviorTree>\n</root>',
    )
    goal = SentGoal(world.client.loader, BtLoad.Goal(files=[good, bad]))
    assert goal.wait().status is GoalStatus.ABORTED
    assert goal.result.code == Result.FAILURE
    one, two = goal.result.reports
    assert (one.code, two.code) == (BtLoadReport.VALID, BtLoadReport.REFUSED)
    error = two.errors[0]
    assert (error.file, error.line, error.column > 0) == (bad, 3, True)
    assert 'Nowhere' in error.message
    assert 'Nowhere' in goal.result.message
    unknown = world.client.execute('X').result
    assert unknown.code == BtExecute.Result.ERROR


def test_an_include_that_cannot_be_read_is_refused_at_its_place_with_all_other_errors(
    world: ServerWorld, tmp_path: Path
) -> None:
    text = document('<Nowhere/>', 'A').replace('<BehaviorTree', '\n<include path="gone.xml"/>\n<BehaviorTree')
    file = write(tmp_path / 'trees/a.xml', text)
    [report] = world.client.load(file).reports
    assert [(error.file, error.line) for error in report.errors] == [(file, 2), (file, 3)]
    assert "'gone.xml' cannot be included" in report.errors[0].message
    assert 'no such file' in report.errors[0].message


def test_an_error_in_an_included_file_names_that_file(world: ServerWorld, tmp_path: Path) -> None:
    inner = write(tmp_path / 'trees/inner.xml', document('\n\n<Nowhere/>', 'B'))
    text = document('<SubTree ID="B"/>', 'A').replace('<BehaviorTree', f'<include path="{inner}"/><BehaviorTree')
    outer = write(tmp_path / 'trees/outer.xml', text)
    for reports in (world.client.load(outer).reports, world.client.load(xml=text).reports):
        [error] = [error for report in reports for error in report.errors]
        assert (error.file, error.line) == (inner, 3)
    [report] = world.client.load(xml=document('<Nowhere/>')).reports
    assert [(report.file, error.file) for error in report.errors] == [('<xml>', '<xml>')]


@pytest.mark.parametrize(
    ('text', 'fragment'),
    [
        ('', ''),
        ('<root BTCPP_format="4"><BehaviorTree', ''),
        ('<!DOCTYPE r [<!ENTITY a "b">]><root BTCPP_format="4"/>', ''),
        ('<!DOCTYPE root SYSTEM "file:///etc/passwd"><root BTCPP_format="4"/>', ''),
        ('<root BTCPP_format="4">' + '<Sequence>' * 300 + '</Sequence>' * 300 + '</root>', ''),
        (document('<FollowPath bogus="1"/>'), 'bogus'),
        (document('<SubTree ID="Main"/>'), 'recursion'),
        (document('<SubTree ID="Missing"/>'), 'Missing'),
        (document('<Spin spin_dist="much"/>'), 'much'),
        (document('<Sequence/>'), 'Sequence'),
        ('x' * 10_000_000, ''),
        (document('<Sequence>' + '<AlwaysSuccess/>' * 300_000 + '</Sequence>'), ''),
    ],
    ids=[
        'empty', 'broken', 'entity', 'dtd', 'deep', 'port',
        'recursion', 'subtree', 'number', 'childless', '10MB', 'many',
    ],
)  # fmt: skip
def test_bad_and_hostile_files_are_refused_in_time(
    world: ServerWorld, tmp_path: Path, text: str, fragment: str
) -> None:
    file = write(tmp_path / 'trees/hostile.xml', text)
    wait_until(world.client.loader.is_ready)
    began = processor_time()
    result = world.client.load(file)
    assert processor_time() - began < 1.0
    assert result.code == Result.FAILURE
    assert result.reports[0].errors[0].file == file
    assert all(error.line >= 1 for error in result.reports[0].errors if len(text) < MUCH)
    told = ' '.join(error.message for error in result.reports[0].errors)
    assert fragment.lower() in told.lower()
    assert world.client.execute('Main').result.code == BtExecute.Result.ERROR


@pytest.mark.parametrize(
    ('file', 'fragment'),
    [
        ('/etc/hostname', 'allowed'),
        ('fixture_trees/../../secret.xml', '..'),
        ('no_such_package/a.xml', 'no_such_package'),
        ('fixture_trees/none.xml', 'none.xml'),
        ('', 'file'),
        ('fixture_trees', 'fixture_trees'),
    ],
)
def test_files_outside_are_refused(world: ServerWorld, file: str, fragment: str) -> None:
    result = world.client.load(file)
    assert result.code == Result.FAILURE
    assert fragment in result.reports[0].errors[0].message + result.message


def test_a_link_that_leads_out_is_not_followed(world: ServerWorld, tmp_path: Path) -> None:
    write(tmp_path / 'secret.xml', document('<AlwaysSuccess/>'))
    (tmp_path / 'trees/link.xml').symlink_to(tmp_path / 'secret.xml')
    assert world.client.load(str(tmp_path / 'trees/link.xml')).code == Result.FAILURE


def test_a_goal_with_nothing_to_load_is_a_failure(world: ServerWorld) -> None:
    assert world.client.load().code == Result.FAILURE


def test_an_edited_file_is_loaded_again_and_a_running_tree_keeps_its_own(world: ServerWorld, tmp_path: Path) -> None:
    world.navigation.hold.add('spin')
    spin = world.navigation.actions['spin']
    file = write(tmp_path / 'trees/edited.xml', document('<Sequence><Spin/><AlwaysSuccess/></Sequence>', 'Edited'))
    assert world.client.load(file).code == Result.SUCCESS
    running = world.client.execute('Edited')
    wait_until(lambda: spin.running)
    write(tmp_path / 'trees/edited.xml', document('<AlwaysFailure/>', 'Edited'))
    assert world.client.load(file).reports[0].code == BtLoadReport.LOADED
    other = world.client.execute('Edited', blackboard='other')
    assert other.result.code == BtExecute.Result.FAILURE
    spin.end(0)
    assert running.result.code == BtExecute.Result.SUCCESS


@pytest.mark.parametrize('shared', [False, True], ids=['alone', 'with a tree that stays'])
def test_what_is_loaded_last_counts_also_when_it_was_loaded_before(
    world: ServerWorld, tmp_path: Path, shared: bool
) -> None:
    good, bad = document('<AlwaysSuccess/>', 'Twice'), document('<AlwaysFailure/>', 'Twice')
    if shared:
        good = good.replace('</root>', '<BehaviorTree ID="Other"><AlwaysSuccess/></BehaviorTree></root>')
    file = write(tmp_path / 'trees/good.xml', good)
    for _ in range(2):
        for load, code in (
            ({'xml': good}, BtExecute.Result.SUCCESS),
            ({'xml': bad}, BtExecute.Result.FAILURE),
            ({'file': file}, BtExecute.Result.SUCCESS),
            ({'xml': bad}, BtExecute.Result.FAILURE),
        ):
            files = [load.pop('file')] if 'file' in load else []
            assert world.client.load(*files, **load).code == Result.SUCCESS
            assert world.client.execute('Twice').result.code == code


def test_texts_whose_trees_were_all_replaced_are_not_kept(world: ServerWorld) -> None:
    store = world.server.load._store
    for number in range(30):
        world.client.load_tree(f'<Sequence name="{number}"><AlwaysSuccess/></Sequence>', f'Text{number % 3}')
    assert len(store.library.documents) == 3
    assert set(store.library.documents) == set(store._loaded)
    assert [world.client.execute(f'Text{index}').result.code for index in range(3)] == [BtExecute.Result.SUCCESS] * 3


def test_loads_and_runs_at_the_same_time_do_not_disturb_each_other(world: ServerWorld, tmp_path: Path) -> None:
    file = write(tmp_path / 'trees/busy.xml', document('<AlwaysSuccess/>', 'Busy'))
    assert world.client.load(file).code == Result.SUCCESS
    big = document('<Sequence>' + '<AlwaysSuccess/>' * 3000 + '</Sequence>', 'Big')
    goals = []
    for number in range(10):
        goals.append(SentGoal(world.client.loader, BtLoad.Goal(xml=f'{big}<!-- {number} -->')))
        goals.append(world.client.execute('Busy', blackboard=str(number)))
    for goal in goals:
        assert goal.wait(DEADLINE).status is GoalStatus.SUCCEEDED


def test_preload_and_a_preload_that_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path / 'pre.xml', document('<AlwaysSuccess/>', 'Pre'))
    with open_server_world(allowed_directories=[str(tmp_path)], preload=[file], default_tree='Pre') as world:
        assert world.client.execute('').result.code == BtExecute.Result.SUCCESS
    write(tmp_path / 'pre.xml', '<root>')
    with (
        pytest.raises(Exception, match=r'preload.*pre\.xml'),
        open_server_world(allowed_directories=[str(tmp_path)], preload=[file]),
    ):
        pass
