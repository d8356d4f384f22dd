# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool prove`` and ``behavior_tool prove`` as a user calls them."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import pwd
import runpy
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

import pytest

from flexbt_console.mirror.trees import MirroredStatus
from flexbt_console.recording.player import RunPlayer
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine
from flexbt_formal.exploration.explorer import ExplorationLimits
from flexbt_formal.exploration.machine_system import MachineBounds
from flexbt_formal.proofs.behavior_proof import prove_behavior
from flexbt_formal.proofs.proof_report import ProgressLine
from flexbt_formal.proofs.saved_test import File
from flexbt_server.node_types import node_registry
from flexbt_states import BtExecuteState, BtLoaderState
from flexbt_testing.behavior_trees.bt_tool import document, tool
from flexbt_tools.behaviors.built_behavior import used_trees
from flexbt_tools.cli.behavior_tool import main as behavior_tool
from flexbt_tools.errors import UsageError
from flexbt_tools.trees.stand_ins import OpenRegistry


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))


def behavior(*words: str) -> tuple[int, str, str]:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = behavior_tool(words)
    return code, out.getvalue(), err.getvalue()


def saved_tests(file: Path) -> list[Callable[[], None]]:
    """Return the tests in a file that the program under test has written."""
    return [value for name, value in runpy.run_path(str(file)).items() if name.startswith('test_')]


def test_the_demonstration_holds_and_says_of_what() -> None:
    code, out, _ = behavior('prove', 'Navigate Split', '--json')
    assert code == 0
    proofs = json.loads(out)['proofs']
    assert [one['name'] for one in proofs][-1] == 'machine of Navigate Split' and len(proofs) == 4
    assert all(one['complete'] and not one['wrong'] and not one['never'] for one in proofs)
    assert 'at most 1 ignored cancel' in proofs[-1]['bounds'] and proofs[-1]['ends'].keys() >= {'finished', 'failed'}


def test_what_is_wrong_in_a_tree_is_told_and_saved_as_a_test(tmp_path: Path) -> None:
    tree = tmp_path / 'race.xml'
    tree.write_text(
        document('Main: <Parallel success_count="2"><Spin/><Sequence><Wait/><BackUp/></Sequence></Parallel>')
    )
    test = tmp_path / 'test_race.py'
    done = tool('prove', str(tree), '--save-test', str(test))
    assert done.code == 1
    assert 'base has two owners at once' in done.out and 'the shortest way to it (2 steps)' in done.out
    assert 'remedy: let one of them end before the other begins' in done.out
    (saved,) = saved_tests(test)
    with pytest.raises(AssertionError, match='two owners'):
        saved()
    tree.write_text(document('Main: <Sequence><Spin/><Wait/><BackUp/></Sequence>'))
    saved()  # what was wrong has been put right


@pytest.mark.parametrize(('together', 'default', 'ends'), [
    ('Fallback', '', {'SUCCESS', 'FAILURE'}),
    ('Fallback', '{usual}', {'SUCCESS', 'FAILURE'}),
    ('Sequence', 'Usual', {'SUCCESS'}),
])  # fmt: skip
def test_what_selects_a_plugin_fails_where_it_may_have_no_default(
    tmp_path: Path, together: str, default: str, ends: set[str]
) -> None:
    kinds = ('controller', 'planner', 'smoother', 'goal_checker', 'progress_checker', 'path_handler')
    selectors = ''.join(
        f'<{kind.title().replace("_", "")}Selector selected_{kind}="{{chosen}}" default_{kind}="{default}"/>'
        for kind in kinds
    )
    tree = tmp_path / 'select.xml'
    tree.write_text(document(f'Main: <{together}>{selectors}</{together}>'))
    proofs = json.loads(tool('prove', str(tree), '--json').out)['proofs']
    assert proofs[0]['complete'] and proofs[0]['ends'].keys() == ends
    tree.write_text(document(f'Main: <Fallback>{selectors}<Wait/></Fallback>'))
    assert ('it is never ticked' in tool('check', str(tree)).out) == ('FAILURE' not in ends)


SPLIT = """machine:
  outcomes: [finished, failed]
  states:
    Load:
      state: BtLoaderState
      parameters: {{filepaths: [{folder}/plan.xml, {folder}/drive.xml]}}
      transitions: {{done: Plan, failed: failed}}
    Plan:
      state: BtExecuteState
      parameters: {{bt_file: Plan}}
      transitions: {{done: Drive, canceled: failed, failed: {unplanned}}}
    Drive:
      state: BtExecuteState
      parameters: {{bt_file: Drive}}
      transitions: {{done: finished, canceled: failed, failed: failed}}
"""


def test_what_trees_hand_to_each_other_is_there_on_all_ways_of_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, saved = tmp_path / 'split.yaml', tmp_path / 'tests' / 'test_split.py'
    saved.parent.mkdir()
    plan = 'Plan: <ComputePathToPose goal="{{goal}}" path="{{{0}}}"/>'
    (tmp_path / 'plan.xml').write_text(document(plan.format('path'), main=None))
    (tmp_path / 'drive.xml').write_text(document('Drive: <FollowPath path="{path}"/>', main=None))

    def prove(unplanned: str, *words: str) -> tuple[int, str]:
        machine.write_text(SPLIT.format(folder=tmp_path, unplanned=unplanned))
        monkeypatch.chdir(tmp_path)
        return behavior('prove', 'split.yaml', *words)[:2]

    assert prove('failed')[0] == 0
    code, out = prove('Drive', '--save-test', str(saved))  # without a plan
    wrong = '/Drive begins, and its tree reads [path] of the shared blackboard, which nothing has written on this way'
    assert code == 1 and wrong in out
    monkeypatch.chdir('/')  # the test finds its files from wherever it is run
    (test,) = saved_tests(saved)
    with pytest.raises(AssertionError, match='nothing has written'):
        test()
    machine.write_text(SPLIT.format(folder=tmp_path, unplanned='failed'))
    test()
    (tmp_path / 'plan.xml').write_text(document(plan.format('paht'), main=None))
    code, out = prove('failed')
    assert code == 1 and wrong in out
    assert prove('failed', '--given', 'path')[0] == 0
    (tmp_path / 'plan.xml').write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Plan"><Inverter/></BehaviorTree></root>'
    )
    assert prove('failed') == (3, '')  # of what is refused nothing is proved


def split(folder: Path, plan: str, unplanned: str = 'failed') -> str:
    """Return the file of a machine that drives along what the tree ``plan`` has written."""
    (folder / 'plan.xml').write_text(document(f'Plan: {plan}', main=None))
    (folder / 'drive.xml').write_text(document('Drive: <FollowPath path="{path}"/>', main=None))
    machine = folder / 'split.yaml'
    machine.write_text(SPLIT.format(folder=folder, unplanned=unplanned))
    return str(machine)


@pytest.mark.parametrize(('board', 'wrong'), [('', ['[path] of the shared blackboard']), ('other', [])])
def test_trees_that_write_the_same_side_by_side_are_told(tmp_path: Path, board: str, wrong: list[str]) -> None:
    plan = '<ComputePathToPose goal="{goal}" path="{path}"/>'
    trees = {'Plan': plan, 'Again': plan, 'Drive': '<FollowPath path="{path}"/>'}
    for name, body in trees.items():
        (tmp_path / f'{name}.xml').write_text(document(f'{name}: {body}', main=None))
    add = OperatableStateMachine.add
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    both = ConcurrencyContainer(
        outcomes=['done', 'failed'],
        conditions=[
            ('done', [('Plan', 'done'), ('Again', 'done')]),
            *(('failed', [(label, outcome)]) for label in ('Plan', 'Again') for outcome in ('failed', 'canceled')),
        ],
    )
    with both:
        add('Plan', BtExecuteState(bt_file='Plan'))
        add('Again', BtExecuteState(bt_file='Again', blackboard=board))
    with machine:
        files = [str(tmp_path / f'{name}.xml') for name in trees]
        add('Load', BtLoaderState(filepaths=files), {'done': 'Both', 'failed': 'failed'})
        add('Both', both, {'done': 'Drive', 'failed': 'failed'})
        add('Drive', BtExecuteState(bt_file='Drive'), {'done': 'finished', 'canceled': 'failed', 'failed': 'failed'})
    made = define(machine)
    used = used_trees(made, (), OpenRegistry(node_registry(lambda source, error: None)))
    proof = prove_behavior('race', made, used, MachineBounds(), ExplorationLimits(60, 1000))
    assert [found.violation.where for report in proof.reports for found in report.counterexamples] == wrong


@pytest.mark.parametrize(
    ('between', 'is_lost'),
    [
        ('<UnsetBlackboard key="path"/>', True),
        ('<UnsetBlackboard key="{which}"/>', True),
        ('<UnsetBlackboard key="other"/>', False),
        ('<UnsetBlackboard key="@path"/>', False),
        ('<SubTree ID="Inner" _autoremap="true"/>', False),
        ('<Sequence><UnsetBlackboard key="path"/><ComputePathToPose goal="{goal}" path="{path}"/></Sequence>', False),
    ],
)
def test_what_a_tree_removes_is_written_no_more(tmp_path: Path, between: str, is_lost: bool) -> None:
    machine = split(tmp_path, '<ComputePathToPose goal="{goal}" path="{path}"/>')
    inner = 'Inner: <Sequence><UnsetBlackboard key="path"/><UnsetBlackboard key="{which}"/></Sequence>'
    (tmp_path / 'between.xml').write_text(document(f'Between: {between}', inner, main=None))
    text = Path(machine).read_text().replace('done: Drive', 'done: Between').replace('[', f'[{tmp_path}/between.xml, ')
    text = text.replace(f'outcomes: [{tmp_path}/between.xml, ', 'outcomes: [')
    state = '    Between:\n      state: BtExecuteState\n      parameters: {bt_file: Between}\n'
    transitions = '      transitions: {done: Drive, canceled: failed, failed: failed}\n'
    Path(machine).write_text(f'{text}{state}{transitions}')
    out = behavior('prove', machine, '--given', 'which')[1]
    assert ('/Drive begins, and its tree reads [path]' in out) is is_lost, out


def test_what_a_tree_writes_that_was_not_followed_to_its_end_is_not_known(tmp_path: Path) -> None:
    plan = (
        '<Sequence><Repeat num_cycles="30"><Wait/></Repeat><ComputePathToPose goal="{goal}" path="{path}"/></Sequence>'
    )
    code, out, _ = behavior('prove', split(tmp_path, plan), '--situations', '25')
    assert code == 5 and 'WRONG' not in out
    assert 'not known, and taken as written: [path] after trees that were not followed to their end' in out


def test_a_time_limit_is_told_as_it_was_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each tree and the machine have a share of it."""
    monkeypatch.setattr('flexbt_formal.exploration.explorer.time.process_time', count().__next__)
    plan = '<ComputePathToPose goal="{goal}" path="{path}"/>'
    code, out, _ = behavior('prove', split(tmp_path, plan), '--seconds', '3', '--anew')
    assert (code, out.count('NOT followed to the end (the time limit of 3 s)')) == (5, 3), out
    two = tmp_path / 'two.xml'
    two.write_text(document('A: <Wait/>', 'B: <Wait/>', main=None))
    assert tool('prove', str(two), '--seconds', '3', '--anew').out.count('the time limit of 3 s') == 2


def test_a_tree_that_was_refused_has_written_nothing(tmp_path: Path) -> None:
    plan = '<Sequence><Script code="path := 1"/><Wait/></Sequence>'
    code, out, _ = behavior('prove', split(tmp_path, plan, 'Drive'))
    assert code == 1 and out.count('WRONG') == 1 and '/Drive begins, and its tree reads [path]' in out


def test_what_a_state_writes_before_its_tree_runs_is_there_for_its_scripts(tmp_path: Path) -> None:
    """And so is what the model of a tree declares as its input; another state has to write it, too."""
    body = '<Sequence><Script code="twice := duration * 2"/><Wait wait_duration="{twice}"/></Sequence>'
    tree, machine = tmp_path / 'rest.xml', tmp_path / 'rest.yaml'
    tree.write_text(document(f'Rest: {body}', main=None))
    rest = 'state: BtExecuteState, parameters: {bt_file: Rest'
    ways = '{canceled: failed, failed: failed, done: '
    machine.write_text(
        'machine:\n  outcomes: [finished, failed]\n  userdata: {duration: 2.0}\n  states:\n'
        f'    Load: {{state: BtLoaderState, parameters: {{filepaths: [{tree}]}}, '
        'transitions: {done: Rest, failed: failed}}\n'
        f'    Rest: {{{rest}, inputs: {{duration: double}}}}, transitions: {ways}finished}}}}\n'
    )
    code, out, _ = behavior('prove', str(machine))
    assert code == 0, out
    machine.write_text(
        machine.read_text().replace('done: finished', 'done: Again')
        + f'    Again: {{{rest}, blackboard: other}}, transitions: {ways}finished}}}}\n'
    )
    code, out, _ = behavior('prove', str(machine))
    assert code == 1 and "/Again begins, and its tree reads [duration] of the blackboard 'other'" in out
    assert tool('prove', str(tree)).code == 1
    model = '<TreeNodesModel><SubTree ID="Rest"><input_port name="duration"/></SubTree></TreeNodesModel></root>'
    tree.write_text(tree.read_text().replace('</root>', model))
    assert tool('prove', str(tree)).code == 0


def test_what_is_given_from_outside_is_given_to_the_trees(tmp_path: Path) -> None:
    path = '<Fallback><ComputePathToPose goal="{goal}" path="{path}"/><AlwaysSuccess/></Fallback>'
    machine = split(tmp_path, f'<Sequence>{path}<FollowPath path="{{path}}"/></Sequence>')
    assert behavior('prove', machine)[0] == 1
    assert behavior('prove', machine, '--given', 'path')[0] == 0
    both = f'<Sequence>{path}<FollowPath path="{{path}}"/><Parallel><Spin/><BackUp/></Parallel></Sequence>'
    saved = tmp_path / 'test_split.py'
    assert behavior('prove', split(tmp_path, both), '--given', 'path', '--save-test', str(saved))[0] == 1
    (test,) = saved_tests(saved)
    with pytest.raises(AssertionError, match='two owners'):
        test()


def test_no_test_reads_the_standard_input_again() -> None:
    with pytest.raises(UsageError, match='standard input'):
        File('-').expression('test_main.py')


def test_what_is_wrong_in_a_tree_of_a_behavior_is_saved_too(tmp_path: Path) -> None:
    machine, saved = tmp_path / 'split.yaml', tmp_path / 'test_split.py'
    (tmp_path / 'plan.xml').write_text(document('Plan: <ComputePathToPose goal="{goal}" path="{path}"/>', main=None))
    drive = tmp_path / 'drive.xml'
    both = '<FollowPath path="{path}"/><Spin/>'
    drive.write_text(document(f'Drive: <Parallel success_count="2">{both}</Parallel>', main=None))
    machine.write_text(SPLIT.format(folder=tmp_path, unplanned='failed'))
    assert behavior('prove', str(machine), '--save-test', str(saved))[0] == 1
    assert "wrong with the tree 'Drive'. Each" in saved.read_text()
    (test,) = saved_tests(saved)
    with pytest.raises(AssertionError, match='base has two owners'):
        test()
    drive.write_text(document(f'Drive: <Sequence>{both}</Sequence>', main=None))
    test()


def test_a_tree_of_a_package_is_proved_and_saved_by_its_name(tmp_path: Path) -> None:
    tree, saved = 'package://flexbt_demo_behaviors/navigate/recovery.xml', tmp_path / 'test_recovery.py'
    assert tool('prove', tree, '--require', 'never =SUCCESS', '--save-test', str(saved)).code == 1
    (test,) = saved_tests(saved)
    with pytest.raises(AssertionError, match='=SUCCESS happens'):
        test()
    assert "no installed package 'nowhere'" in tool('prove', 'package://nowhere/x.xml').err


def test_what_is_wrong_is_drawn_and_is_shown_by_the_replay_of_the_console(tmp_path: Path) -> None:
    tree = tmp_path / 'race.xml'
    tree.write_text(
        document('Main: <Parallel success_count="2"><Spin/><Sequence><Wait/><BackUp/></Sequence></Parallel>')
    )
    picture, recording = tmp_path / 'race.svg', tmp_path / 'race.mcap'
    words = ('prove', str(tree), '--draw', str(picture), '--save-recording', str(recording))
    assert tool(*words).code == 1
    texts = [one.text or '' for one in ElementTree.parse(picture).iter('{http://www.w3.org/2000/svg}text')]  # noqa: S314
    assert {'operator', 'tree', 'Wait::4', '1. start', '2. result: SUCCESS'} <= set(texts)
    player = RunPlayer(recording)
    seen = []
    while player.time < player.duration:
        seen.append([node for node, status in _statuses(player) if status is MirroredStatus.RUNNING])
        player.go_to(player.next_said(1))
    assert ['Parallel', 'Spin', 'Wait'] in [[one for one in running if one != 'Sequence'] for running in seen]
    assert {'Spin', 'BackUp'} <= {node for node, status in _statuses(player) if status is MirroredStatus.RUNNING}
    assert player.mirror.log(1)[0].text == 'WRONG: base has two owners at once: Spin::2 and BackUp::5'
    assert 'File exists' in tool(*words).err  # no recording is written over


def test_what_is_wrong_in_a_machine_is_shown_with_what_the_operator_is_asked(tmp_path: Path) -> None:
    machine, recording = tmp_path / 'loop.yaml', tmp_path / 'loop.mcap'
    machine.write_text(
        'machine:\n  outcomes: [finished]\n  states:\n'
        '    Go:\n      state: OperatorDecisionState\n      parameters: {outcomes: [go]}\n'
        '      transitions: {go: Stay}\n'
        '    Stay:\n      state: LogState\n      parameters: {text: here}\n      transitions: {done: Stay}\n',
        encoding='utf-8',
    )
    code, _, err = behavior('prove', str(machine), '--save-recording', str(recording))
    assert code == 1, err
    player = RunPlayer(recording)
    player.go_to(player.find('1. start'))
    view = player.mirror.view()
    assert view.structure is not None and [state.path for state in view.structure.states] == ['/', '/Go', '/Stay']
    assert (view.active_paths, [one.outcomes for one in view.decisions]) == (('/Go',), [('go',)])
    player.go_to(player.find('WRONG: '))
    assert 'transitions without waiting' in player.mirror.log(1)[0].text


def _statuses(player: Any) -> list[tuple[str, MirroredStatus]]:
    (run,) = player.mirror.view().trees
    return [(node.name, status) for node, status in zip(run.nodes, run.statuses, strict=True)]


def test_what_no_steps_show_is_no_test_that_cannot_fail(tmp_path: Path) -> None:
    tree = tmp_path / 'endless.xml'
    again = '<KeepRunningUntilFailure><Delay delay_msec="5"><AlwaysSuccess/></Delay></KeepRunningUntilFailure>'
    tree.write_text(document(f'Main: <Sequence><Wait/>{again}</Sequence>'))
    saved = tmp_path / 'test_endless.py'
    done = tool('prove', str(tree), '--save-test', str(saved))
    assert done.code == 1 and 'only a stop ends it' in done.out
    assert 'def test_' not in saved.read_text() and '# No steps show this' in saved.read_text()


def test_what_is_not_installed_is_told_and_is_no_fault_of_the_tree(tmp_path: Path) -> None:
    tree = tmp_path / 'typing_error.xml'
    tree.write_text(document('Main: <SubTree ID="Turn"/>', 'Turn: <Sequence><Spinn/><Wait/></Sequence>'))
    done = tool('prove', str(tree))
    assert done.code == 0 and 'not installed here, so any result is possible' in done.out and ': Spinn' in done.out
    tree.write_text(document('Main: <Whenever><Wait/></Whenever>'))
    done = tool('prove', str(tree))
    assert done.code == 3 and '<Whenever>: this decorator is not installed here' in done.err and 'WRONG' not in done.out


def test_a_limit_is_told_and_never_called_a_proof(tmp_path: Path) -> None:
    tree = tmp_path / 'long.xml'
    tree.write_text(document('Main: <Repeat num_cycles="500"><Delay delay_msec="5"><Wait/></Delay></Repeat>'))
    done = tool('prove', str(tree), '--situations', '50')
    assert done.code == 5
    assert 'NOT followed to the end (the limit of 50 configurations)' in done.out and 'proved' not in done.out


@pytest.mark.parametrize(
    'words', [['--seconds', '0'], ['--seconds', 'soon'], ['--situations', '-1'], ['--tree', 'Mian'], ['--given']]
)
def test_wrong_usage(tmp_path: Path, words: list[str]) -> None:
    tree = tmp_path / 'main.xml'
    tree.write_text(document('Main: <AlwaysSuccess/>'))
    assert tool('prove', str(tree), *words).code == 2


def test_a_proof_is_kept_until_something_changes(tmp_path: Path) -> None:
    tree = tmp_path / 'main.xml'
    tree.write_text(document('Main: <Parallel success_count="2"><Spin/><BackUp/></Parallel>'))

    def proved(*words: str) -> tuple[bool, dict[str, object]]:
        (proof,) = json.loads(tool('prove', str(tree), '--json', *words).out)['proofs']
        is_kept = any('found before' in note for note in proof['notes'])
        return is_kept, {name: value for name, value in proof.items() if name not in ('notes', 'seconds')}

    was_kept, first = proved()
    assert not was_kept and first['wrong']
    assert proved() == (True, first)
    assert proved('--anew') == (False, first)
    assert not proved('--faults', '0')[0] and not proved('--given', 'path')[0]
    for file in (tmp_path / 'cache' / 'flexbt' / 'proofs').iterdir():
        file.write_text('{"name": ')
    assert proved() == (False, first)
    tree.write_text(document('Main: <Sequence><Spin/><BackUp/></Sequence>'))
    was_kept, mended = proved()
    assert not was_kept and not mended['wrong']
    told, told_again = (tool('prove', str(tree), '--require', 'Spin is a BackUp').out.splitlines() for _ in range(2))
    assert [line for line in told_again if 'found before' not in line] == told


def test_no_other_picture_than_a_diagram_is_promised(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        behavior_tool(['prove', 'Navigate', '--draw', 'way.png'])
    assert "'way.png' is none of the pictures made here: .svg, .mmd, .mermaid" in capsys.readouterr().err


def test_without_a_home_a_proof_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_account(number: int) -> NoReturn:
        raise KeyError(number)  # as for the number of a user that /etc/passwd does not have

    for name in ('HOME', 'XDG_CACHE_HOME'):
        monkeypatch.delenv(name)
    monkeypatch.setattr(pwd, 'getpwuid', no_account)
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'main.xml').write_text(document('Main: <Spin/>'))
    proved = [tool('prove', 'main.xml') for _ in range(2)]
    assert [one.code for one in proved] == [0, 0] and 'found before' not in proved[1].out
    assert [file.name for file in tmp_path.iterdir()] == ['main.xml']


def test_a_proof_is_not_kept_when_a_model_changes_a_port(tmp_path: Path) -> None:
    tree, models = tmp_path / 'main.xml', tmp_path / 'models.xml'
    find = '<Fallback><Find at="{x}"/><AlwaysSuccess/></Fallback>'
    tree.write_text(document(f'Main: <Sequence>{find}<Use at="{{x}}"/></Sequence>'))
    for port, wrong in (('input_port', []), ('output_port', ['DATA'])):
        ports = f'<Action ID="Find"><{port} name="at" type="int"/></Action>'
        ports += '<Action ID="Use"><input_port name="at" type="int" default="1"/></Action>'
        models.write_text(f'<root BTCPP_format="4"><TreeNodesModel>{ports}</TreeNodesModel></root>')
        (proof,) = json.loads(tool('prove', str(tree), '--models', str(models), '--json').out)['proofs']
        assert [one['property'] for one in proof['wrong']] == wrong, port


OF_MINE = """\
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.model.status import NodeStatus

from .rule import RESULT

class Judge(Decorator):
    def tick(self):
        status = self.tick_child()
        return status if status is NodeStatus.RUNNING else NodeStatus[RESULT]

def register(registry):
    registry.register('Judge', Judge)
"""


def test_a_proof_is_not_kept_when_what_the_class_of_a_node_uses_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    package, info = tmp_path / 'nodes_of_mine', tmp_path / 'nodes_of_mine-1.0.dist-info'
    package.mkdir()
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: nodes-of-mine\nVersion: 1.0\n')
    (info / 'entry_points.txt').write_text('[flexbt.bt_nodes]\nmine = nodes_of_mine:register\n')
    (package / '__init__.py').write_text(OF_MINE)
    tree = tmp_path / 'main.xml'
    tree.write_text(document('Main: <Judge><Spin/></Judge>'))
    for number, result in enumerate(('SUCCESS', 'FAILURE')):
        # Within a second, Python takes the compiled file of a file of the same size.
        (package / 'rule.py').write_text(f'RESULT = {result!r}  # {number * "longer"}')
        for module in ('nodes_of_mine.rule', 'nodes_of_mine'):
            monkeypatch.delitem(sys.modules, module, raising=False)
        importlib.invalidate_caches()
        assert f'  it can end: {result}, stopped\n' in tool('prove', str(tree)).out


def test_errors_of_proofs_are_findings_at_the_nodes(tmp_path: Path) -> None:
    tree = tmp_path / 'main.xml'
    tree.write_text(
        document(
            'Main: <Sequence><Fallback><ComputePathToPose goal="{goal}" path="{path}"/><AlwaysSuccess/></Fallback>'
            '<SubTree ID="X" name="x" path="{path}"/></Sequence>',
            'X: <Parallel success_count="2"><FollowPath path="{path}"/><Spin spin_dist="6.28"/></Parallel>',
        )
    )
    findings = json.loads(tool('prove', str(tree), '--json').out)['findings']
    where = {one['rule']: tree.read_text().splitlines()[one['line'] - 1][one['column'] - 1 :] for one in findings}
    assert {one['severity'] for one in findings} == {'error'} and all(one['fix'] for one in findings)
    assert where['data'].startswith('<FollowPath') and where['one-owner'].startswith('<FollowPath')


def test_a_counterexample_is_told_step_by_step_with_the_statuses_of_the_nodes(tmp_path: Path) -> None:
    tree = tmp_path / 'look.xml'
    tree.write_text(
        document(
            'Main: <Sequence><Fallback><Wait/><Spin/></Fallback><Inverter><Spin name="back"/></Inverter></Sequence>'
        )
    )
    asked = ('prove', str(tree), '--json', '--require', 'never =FAILURE')
    for proof in [
        *json.loads(tool(*asked).out)['proofs'],
        *json.loads(tool(*asked).out)['proofs'],
    ]:  # also from the cache
        (found,) = [one for one in proof['wrong'] if one['property'] == 'REQUIREMENT']
        told = [line.strip() for line in found['way']]
        assert [line for step in found['steps'][1:] for line in step['lines']] == [
            line for line in told[1:] if line[0] not in '!123456789'
        ]
        first, *_, last = [step['statuses'] for step in found['steps'][1:]]
        assert {path.partition('::')[0] for path, status in first.items() if status == 'RUNNING'} == {
            'Sequence',
            'Fallback',
            'Wait',
        }
        assert last[next(path for path in last if path.startswith('Sequence'))] == 'FAILURE'
    other = tmp_path / 'other.xml'
    other.write_text(tree.read_text().replace('<Spin/>', '<BackUp/>'))
    (compared,) = json.loads(tool('prove', str(other), '--json', '--against', str(tree)).out)['comparisons']
    (difference,) = compared['differences']
    told = [step['step'] for step in difference['steps'][1:]]
    assert [line.partition(' ')[2].split('::')[0] for line in difference['way'] if line[0] != ' '] == [
        step.replace('Wait::3', 'Wait') for step in told
    ]
    assert any('BackUp' in line for line in difference['steps'][-1]['lines'])
    assert 'BackUp' in {path.partition('::')[0] for path in difference['steps'][-1]['statuses']}
    machine = tmp_path / 'wait.yaml'
    machine.write_text(
        'machine: {outcomes: [done], states: {Wait: {state: WaitState, parameters: {wait_time: 1.0}, '
        'transitions: {done: done}}}}'
    )
    proofs = json.loads(behavior('prove', str(machine), '--json', '--require', 'never =done')[1])['proofs']
    assert [step['statuses'] for step in proofs[-1]['wrong'][0]['steps']] == [{}, {'/Wait': 'RUNNING'}, {}]


def test_what_is_required_is_proved_told_and_saved(tmp_path: Path) -> None:
    tree, required, saved = tmp_path / 'inspect.xml', tmp_path / 'site.yaml', tmp_path / 'test_inspect.py'
    tree.write_text(document('Main: <Sequence><Wait name="drive"/><Spin name="look"/></Sequence>'))
    required.write_text('Main:\n  - look only after drive > SUCCESS\n  - after drive, look before the end\nOther: []\n')
    done = tool('prove', str(tree), '--requirements', str(required), '--save-test', str(saved))
    assert done.code == 1 and done.out.count('WRONG') == 1 and f'{required}: not proved here: Other' in done.err
    assert 'it ends, and look has not come after drive; required is: after drive, look before the end' in done.out
    (test,) = saved_tests(saved)
    with pytest.raises(AssertionError, match='look has not come'):
        test()
    required.write_text('Main:\n  - never lok\n')
    done = tool('prove', str(tree), '--requirements', str(required))
    assert (
        done.code == 3
        and f"{required}:2: \"never lok\": tree Main has no event 'lok'; did you mean 'look'?" in done.err
    )
    done = tool('prove', str(tree), '--require', 'look well')
    assert done.code == 2 and '--require: "look well" is not a requirement; write one of' in done.err


def test_what_is_required_of_a_behavior_is_about_its_machine() -> None:
    code, out, _ = behavior('prove', 'Navigate Split', '--require', 'never =failed', '--seconds', '30', '--faults', '0')
    assert code == 1 and '=failed happens; required is: never =failed' in out
    code, _, err = behavior('prove', 'Navigate Split', '--require', 'never /AskGaol')
    assert code == 3 and "Navigate Split has no event '/AskGaol'; did you mean '/AskGoal'?" in err


def model(folder: Path, chance: str) -> str:
    """Return the model of the guide: up to three tries."""
    halt = '<bt_halt target="open"><bt_return_halted/></bt_halt>'
    success, failure = ('<bt_return_status status="SUCCESS"/>', '<bt_return_status status="FAILURE"/>')
    files = {
        'main.xml': '<roaml><parameters><max_time value="20" unit="s"/></parameters><behavior_tree>'
        '<input type="bt.cpp-xml" src="tree.xml"/><input type="bt-plugin-ascxml" src="grasp.ascxml"/></behavior_tree>'
        '<properties><input type="jani" src="properties.jani"/></properties></roaml>',
        'tree.xml': '<root BTCPP_format="4"><BehaviorTree ID="Fetch"><RetryUntilSuccessful num_attempts="3">'
        '<Action ID="Grasp"/></RetryUntilSuccessful></BehaviorTree></root>',
        'grasp.ascxml': f'<ascxml name="Grasp" version="1.0" initial="open"><state id="open"><bt_tick>'
        f'<target id="open" prob="{chance}">{success}</target><target id="open">{failure}</target></bt_tick>{halt}'
        '</state></ascxml>',
        'properties.jani': '{"properties": [{"name": "fetched", "expression": {"op": "Pmin", "exp": {"op": "F", "exp":'
        ' {"op": "=", "left": "bt_1000_response__status", "right": 1}}}}]}',
    }
    for name, text in files.items():
        (folder / name).write_text(text)
    return str(folder / 'main.xml')


def test_a_model_is_known_by_its_main_file(tmp_path: Path) -> None:
    main = model(tmp_path, '0.7')
    done = tool('prove', main)
    assert done.code == 1
    assert 'fetched: CAN FAIL, probability 0.973' in done.out and 'Grasp::2 gives FAILURE' in done.out
    document = json.loads(tool('prove', main, '--json').out)
    (found,) = document['properties']
    assert found['value'] == pytest.approx(0.973) and found['exact'] and found['way']
    assert [one['message'] for one in document['findings']] == ['fetched: CAN FAIL, probability 0.973']
    assert tool('prove', main, '--property', 'fetch').code == 2
    for words in (['--save-test', 'x'], ['--against', main]):
        assert 'is for files of trees' in tool('prove', main, *words).err
    assert '--property is for models' in tool('prove', str(tmp_path / 'tree.xml'), '--property', 'fetched').err
    done = tool('prove', main, '--method', 'statistical', '--error', '0.05')
    assert done.code == 1 and ' random runs (seed 0), within 0.0' in done.out
    done = tool('prove', model(tmp_path, '1.7'))
    assert done.code == 3 and 'grasp.ascxml:1:' in done.err and 'the probability 1.7' in done.err


def test_a_version_beside_the_one_before(tmp_path: Path) -> None:
    old, new = tmp_path / 'old.xml', tmp_path / 'new.xml'
    old.write_text(document('Main: <RetryUntilSuccessful num_attempts="2"><Spin/></RetryUntilSuccessful>'))
    new.write_text(
        document('Main: <Sequence><RetryUntilSuccessful num_attempts="2"><Spin/></RetryUntilSuccessful></Sequence>')
    )
    same = tool('prove', str(new), '--against', str(old))
    assert same.code == 0 and 'tree Main, against before: does the same (' in same.out
    new.write_text(document('Main: <Spin/>'))
    assert tool('prove', str(new)).code == 0  # nothing is wrong with it by itself
    done = tool('prove', str(new), '--against', str(old))
    assert done.code == 1 and 'DIFFERS' in done.out
    assert (
        '2. result Spin FAILURE\n    before:\n           Spin begins\n    now:\n           the tree ends: FAILURE'
        in done.out
    )
    plain = json.loads(tool('prove', str(new), '--against', str(old), '--json').out)
    assert plain['comparisons'][0]['differences'][0]['now'] == ['the tree ends: FAILURE']
    new.write_text(document('Mian: <Spin/>', main=None))
    other = tool('prove', str(new), '--against', str(old))
    assert other.code == 1
    assert 'tree Mian: DIFFERS: it is there only now' in other.out
    assert 'tree Main: DIFFERS: it is there only before' in other.out


@pytest.mark.parametrize(
    ('before', 'now', 'seen'),
    [
        ('<IsBatteryLow min_battery="0.2"/>', '<IsBatteryLow min_battery="0.95"/>', 'min_battery="0.95"'),
        ('<IsBatteryLow min_battery="0.2"/>', '<IsBatteryLow min_battery="0.2" battery_topic="/other"/>',
         'battery_topic="/other"'),
        ('<WouldAPlannerRecoveryHelp error_code="{a}"/>', '<WouldAPlannerRecoveryHelp error_code="{b}"/>',
         'error_code="{b}"'),
        ('<PipelineSequence><DistanceController distance="1.0"><Wait/></DistanceController><Spin/></PipelineSequence>',
         '<PipelineSequence><DistanceController distance="2.0"><Wait/></DistanceController><Spin/></PipelineSequence>',
         'distance="2.0"'),
    ],
    ids=['charge', 'topic', 'code', 'distance'],
)  # fmt: skip
def test_inputs_of_conditions_and_decorators_are_compared(tmp_path: Path, before: str, now: str, seen: str) -> None:
    old, new = tmp_path / 'old.xml', tmp_path / 'new.xml'
    old.write_text(document(f'Main: {before}'))
    new.write_text(document(f'Main: {now}'))
    done = tool('prove', str(new), '--against', str(old))
    assert done.code == 1 and seen in done.out
    assert tool('prove', str(new), '--against', str(new)).code == 0


@pytest.mark.parametrize(
    ('before', 'now', 'is_same'),
    [
        ('level &lt; 0', 'level &lt; 0 || level &gt; 20', False),
        ('level &gt; 20', 'level &gt; 30', False),
        ('level &gt; 20', '!(level &lt;= 20)', True),
        ('error &gt; 20', 'error &gt;= 21', True),
    ],
    ids=['constant of one', 'other constant', 'same constant', 'whole number'],
)
def test_the_constants_of_one_version_are_tried_in_both(tmp_path: Path, before: str, now: str, is_same: bool) -> None:
    old, new = tmp_path / 'old.xml', tmp_path / 'new.xml'
    for file, skipped in ((old, before), (new, now)):
        spin = f'<ForceSuccess><Spin error_code_id="{{error}}"/></ForceSuccess><Wait _skipIf="{skipped}"/>'
        file.write_text(document(f'Main: <Sequence>{spin}</Sequence>'))
    done = tool('prove', str(new), '--against', str(old), '--given', 'level')
    assert ('does the same (' in done.out) is is_same, done.out


@pytest.mark.parametrize(
    ('tree', 'code', 'told'),
    [
        ('<ForceFailure><Wait/></ForceFailure>', 6, 'WRONG: =SUCCESS is never reached'),
        ('<Fallback><ForceSuccess><Wait/></ForceSuccess><Spin/></Fallback>', 6, 'WRONG: Spin::4 is never reached'),
        ('<Wait/>', 0, 'nothing wrong'),
    ],
    ids=['success', 'node', 'none'],
)
def test_what_can_never_come_about_has_an_exit_code_of_its_own(tmp_path: Path, tree: str, code: int, told: str) -> None:
    file = tmp_path / 'main.xml'
    file.write_text(document(f'Main: {tree}'))
    done = tool('prove', str(file))
    assert done.code == code and told in done.out


RECOVERING = """
<RecoveryNode number_of_retries="2"><FollowPath path="{path}"/>
  <CONTROL><GoalUpdated/><Sequence><Spin spin_dist="1.570"/><Wait/></Sequence></CONTROL>
</RecoveryNode>
"""


@pytest.mark.parametrize(
    ('control', 'require', 'code', 'told'),
    [
        ('ReactiveFallback', 'Spin works only while GoalUpdated fails', 0, 'nothing wrong'),
        ('ReactiveFallback', 'Spin has spin_dist=1.57', 0, 'nothing wrong'),
        (
            'ReactiveFallback',
            'Spin works only while GoalUpdated holds',
            1,
            'GoalUpdated was not asked, or does not hold',
        ),
        # A change that is asked for once is not heard, whatever is required.
        ('Fallback', 'Spin has spin_dist=1.57', 1, 'GoalUpdated::4 is asked only before something works'),
        ('Fallback', 'Spin works only while GoalUpdated fails', 1, 'GoalUpdated was not asked, or holds'),
    ],
)
def test_a_change_is_heard_while_something_works(
    tmp_path: Path, control: str, require: str, code: int, told: str
) -> None:
    file = tmp_path / 'main.xml'
    file.write_text(document(f'Main: {RECOVERING.replace("CONTROL", control)}'))
    done = tool('prove', str(file), '--given', 'path', '--require', require)
    assert (done.code, told in done.out) == (code, True), done.out


def test_what_a_state_was_made_with_can_be_required(tmp_path: Path) -> None:
    file = machine_of(tmp_path, '<Wait/>', '{done: Then, canceled: failed, failed: failed}')
    tree = f'/Go has tree={tmp_path}/go.xml'
    assert behavior('prove', file, '--require', tree, '--require', '/Then has wait_time=1')[0] == 0
    code, out, _ = behavior('prove', file, '--require', '/Then has wait_time=2')
    assert code == 1 and "/Then has wait_time='1.0'; required is: /Then has wait_time=2" in out


def machine_of(folder: Path, tree: str, transitions: str) -> str:
    (folder / 'go.xml').write_text(document(f'Go: {tree}', main='Go'))
    file = folder / 'machine.yaml'
    file.write_text(
        'machine:\n  outcomes: [finished, failed]\n  states:\n'
        f'    Go: {{state: BtExecuteState, parameters: {{bt_file: {folder}/go.xml}}, transitions: {transitions}}}\n'
        '    Then: {state: WaitState, parameters: {wait_time: 1.0}, transitions: {done: finished}}\n'
    )
    return str(file)


@pytest.mark.parametrize(
    ('tree', 'transitions', 'code', 'told'),
    [
        # Nobody cancels a goal by itself: it is no way out of attempts that go on for ever.
        ('<Wait/>', '{done: Then, canceled: failed, failed: Go}', 1, 'when the server of BT server is gone for good'),
        # The operator, who is asked each time, is one.
        ('<Wait/>', '{done: Then, canceled: failed, failed: Go}, autonomy: {failed: full}', 0, 'nothing wrong'),
        ('<ForceFailure><Wait/></ForceFailure>', '{done: Then, canceled: failed, failed: failed}', 6,
         'WRONG: /Then is never reached'),
        ('<Wait/>', '{done: Then, canceled: failed, failed: failed}', 0, 'nothing wrong'),
    ],
    ids=['endless', 'asked', 'unreachable', 'sound'],
)  # fmt: skip
def test_attempts_for_ever_and_states_that_are_never_reached(
    tmp_path: Path, tree: str, transitions: str, code: int, told: str
) -> None:
    found, out, err = behavior('prove', machine_of(tmp_path, tree, transitions))
    assert (found, told in out) == (code, True), out + err


def test_a_behavior_beside_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str, plan: str, unplanned: str) -> str:
        folder = tmp_path / name
        folder.mkdir()
        return split(folder, plan, unplanned)

    old = version('old', '<ComputePathToPose goal="{goal}" path="{path}"/>', 'failed')
    new = version('new', '<Wait/>', 'Plan')
    assert behavior('prove', old, '--against', old)[0] == 0
    told: list[str] = []
    monkeypatch.setattr(ProgressLine, 'show', lambda self, name, *counts: told.append(name))
    code, out, _ = behavior('prove', new, '--against', old)
    assert {f'{one}, against before' for one in ('tree Plan', 'tree Drive', 'the machine')} <= {*told}
    assert code == 1 and 'tree Plan, against before: ' in out and 'tree Drive, against before: does the same' in out
    assert '/Plan > failed -> =failed' in out and '/Plan > failed -> /Plan' in out
