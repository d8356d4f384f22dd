# SPDX-License-Identifier: BSD-3-Clause
"""Pre- and post-conditions, and the nodes Script, ScriptCondition and Precondition. Rules of BehaviorTree.CPP 4.10."""

from __future__ import annotations

import random
from typing import Any
from xml.sax.saxutils import quoteattr

import pytest

from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import NodeManifest, TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, ScriptError, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeKind, NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.nodes.nav2.controls import PauseResumeController
from flexbt_core.behavior_tree.nodes.nav2.decorators import DistanceController, Position, SpeedController
from flexbt_core.behavior_tree.nodes.nav2.registration import register_nav2
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_testing.behavior_trees.steps import NAMES, check, first_failure, make


def leaf(script: str, number: int = 0, **conditions: str) -> str:
    """Return a step of ``flexbt_testing.behavior_trees.steps`` with pre- and post-conditions."""
    return f'<Step name="{script}_{number}"{_attributes(conditions)}/>'


def node(tag: str, *children: str, **attributes: str) -> str:
    return f'<{tag}{_attributes(attributes)}>{"".join(children)}</{tag}>'


def _attributes(attributes: dict[str, str]) -> str:
    return ''.join(f' {name.rstrip("_")}={quoteattr(value)}' for name, value in attributes.items())


def run(*children: str) -> str:
    return node('Sequence', *children)


def script(code: str) -> str:
    return node('Script', code=code)


# What happens to a tree, in the notation of flexbt_testing.behavior_trees.steps.
# Many are the cases of BehaviorTree.CPP's own tests.
VECTORS: dict[str, list[tuple[str, str]]] = {
    'the first pre-condition that is true decides': [
        (leaf('S', _failureIf='x == 1', _successIf='x == 1', _skipIf='x == 1', _while='x == 1'), 'x=1 F | x=2 K'),
        (leaf('F', _successIf='x == 1', _skipIf='x == 1', _while='x == 1'), 'x=1 S | x=2 K'),
        (leaf('F', _skipIf='x == 1', _while='x == 2'), 'x=1 K | x=2 F 0F | x=3 K'),
        (run(script('A := 1'), leaf('F', 0, _successIf='A == 1'), leaf('S', 1, _successIf='A == 2'),
             node('Fallback', leaf('S', 2, _failureIf='A == 1'), leaf('S', 3, _failureIf='A != 1'))), 'S 1S 3S'),
        (run(script('A := 1'), leaf('S', 0, _successIf='A == 2', _failureIf='A != 1', _skipIf='A == 1'), leaf('S', 1)),
         'S 1S'),
    ],
    'the others are not even asked': [
        (leaf('S', _failureIf='x == 1', _successIf='missing'), 'x=1 F | x=2 error'),
    ],
    'while the node is RUNNING only _while is asked': [
        (leaf('RRS', _failureIf='x == 1', _successIf='x == 1', _skipIf='x == 1'), 'x=0 R 0R | x=1 R 0R | S 0S | F'),
        (leaf('RRS', _while='x == 1'), 'x=1 R 0R | x=0 K 0! | K | x=1 R 0R | S 0S'),
        (node('KeepRunningUntilFailure', leaf('S'), _skipIf='x == true'), 'x=0 R 0S | x=1 R 0S'),
        (leaf('R', _skipIf='x == false'), 'x=0 K | x=1 R 0R | x=0 R 0R'),
        (run(leaf('R', 0, _while='x'), leaf('S', 1)), 'x=1 R 0R | x=0 S 0! 1S'),
        # A node that was skipped, but stays RUNNING itself, is asked no more until its parent resets it.
        (run(leaf('K'), leaf('K', 1)), 'K 0K 1K'),
        (node('Sequence', leaf('KS'), _skipIf='x'), 'x=0 K 0K | x=1 S 0S | K'),
        (node('Inverter', leaf('KS'), _skipIf='x'), 'x=0 K 0K | x=1 F 0S | K'),
    ],
    'skipped children': [
        (run(leaf('S', 0, _skipIf='A == 1'), leaf('S', 1, _skipIf='A < 2'), leaf('S', 2, _skipIf='A > 0')), 'A=1 K'),
        (run(leaf('S', 0, _skipIf='A != 1'), leaf('S', 1, _skipIf='A != 2', _onSuccess='A = 1'),
             leaf('S', 2, _skipIf='A != 3', _onSuccess='A = 2')), 'A=3 S 2S | S 1S | S 0S'),
        (run(leaf('S', _skipIf='skip')), 'skip=1 K | skip=0 S 0S | skip=1 K | skip=0 S 0S'),
        (node('ReactiveSequence', leaf('S', _skipIf='flag')), 'flag=1 K | K'),
        (node('ReactiveSequence', script('v := 50'), leaf('S', 0, _skipIf='v < 25'), leaf('RS', 1)),
         'R 0S 1R | S 0S 1S'),
        (node('ReactiveSequence', script('v := 10'), leaf('S', 0, _skipIf='v < 25'), leaf('RS', 1)), 'R 1R | S 1S'),
        (run(script('doit := true'), run(leaf('S', _while='doit'))), 'S 0S'),
        (run(script('doit := false'), run(leaf('S', _while='doit'))), 'S'),
    ],
    'a number is true or false, or neither': [
        (leaf('S', _skipIf='x'), 'x=1 K | x=0 S 0S | x=2 error | x=-1 error'),
        (leaf('S', _skipIf='x'), 'x=0.5 K | x=2.5 K | x=0.0 S 0S | x=-0.5 error'),
        (leaf('S', _skipIf='-0.5'), 'error'),
        (leaf('S', _skipIf="'true'"), 'error'),
        (leaf('S', _while='missing'), 'error | halt | error'),
        (run(leaf('S', 1), leaf('S', 0, _skipIf='missing')), 'error 1S | halt | missing=0 S 1S 0S'),
    ],
    'Precondition': [
        (run(script('A := 1; B := 1; C := 3'), node('Precondition', leaf('S'), if_='A==B', else_='FAILURE'),
             node('Precondition', leaf('S', 1), if_='A==C', else_='SUCCESS'),
             node('Precondition', leaf('S', 2), if_='A!=C', else_='FAILURE')), 'S 0S 2S'),
        (run(script('A := 1.1; B := (1.0+0.1)'), node('Precondition', leaf('S'), if_='A==B')), 'S 0S'),
        (run(script("A := 'hello'; B := 'world'"), node('Precondition', leaf('S'), if_=' A==B ', else_='SKIPPED'),
             node('Precondition', leaf('S', 1), if_=' A!=B ')), 'S 1S'),
        # Not asked again while the child runs, nor, which may surprise, after it was halted or skipped.
        (node('Precondition', leaf('RRS'), if_='x'), 'x=1 R 0R | x=0 R 0R | S 0S | F | halt | F'),
        (node('Precondition', leaf('R'), if_='x'), 'x=1 R 0R | x=0 halt 0! | R 0R'),
        (node('Precondition', leaf('KS'), if_='x', else_='RUNNING'), 'x=1 K 0K | x=0 S 0S | R | R'),
        (node('Precondition', leaf('S'), if_='x', else_='IDLE'), 'x=1 S 0S | x=0 error'),
        (node('Precondition', leaf('S'), if_='x', else_='{e}'), "x=0 e='SKIPPED' K | e='SUCCESS' S"),
        # The child may be skipped by a condition of its own.
        (run(node('Precondition', leaf('R', 0, _while='b == 0'), if_='a == 0')),
         'a=0 b=0 R 0R | a=1 R 0R | b=1 K 0!'),
    ],
    'ScriptCondition': [
        (node('ScriptCondition', code='x > 2 && x < 5'), 'x=3 S | x=7 F | x=1 F'),
        (node('ScriptCondition', code="x == 'go'"), "x='go' S | x='no' F"),
        (node('ScriptCondition', code='1; 0'), 'F'),
    ],
    'Script': [
        (run(script(''), script('A:=5;\nB:=6'), node('ScriptCondition', code='A + B == 11')), 'S'),
        (script('x = 1'), 'error | x=0 S | S'),
        (run(script('A := 0'), leaf('S', _failureIf='A != -1')), 'F'),
    ],
}  # fmt: skip


@pytest.mark.parametrize(
    ('body', 'expected'),
    [row for rows in VECTORS.values() for row in rows],
    ids=[f'{what}-{number}' for what, rows in VECTORS.items() for number in range(len(rows))],
)
def test_what_a_tree_does(body: str, expected: str) -> None:
    check(body, expected)


# -- post-conditions -------------------------------------------------------------------------------------------------


def board_after(body: str, steps: str, **entries: Any) -> dict[str, Any]:
    """Return the entries that are not those at the beginning, after ticks (t) and halts (h)."""
    tree, _ = make(body)
    for key, value in entries.items():
        tree.blackboard.set(key, value)
    for step in steps:
        tree.halt() if step == 'h' else tree.tick_once()
    return tree.blackboard.snapshot()


ALL = {'_onSuccess': "s += 's'", '_onFailure': "s += 'f'", '_post': "s += 'p'", '_onHalted': "s += 'h'"}


@pytest.mark.parametrize(
    ('leaf_script', 'conditions', 'steps', 'expected'),
    [
        ('S', {}, 't', 'sp'),
        ('F', {}, 't', 'fp'),
        ('K', {}, 't', ''),
        ('RS', {}, 't', ''),
        ('RS', {}, 'tt', 'sp'),
        # A pre-condition decides.
        ('F', {'_successIf': '1'}, 't', 'sp'),
        ('S', {'_failureIf': '1'}, 't', 'fp'),
        ('S', {'_skipIf': '1'}, 't', ''),
        ('S', {'_while': '0'}, 't', ''),
        # Halted: as the root it is told twice, RUNNING or not, and a node that _while ends is told once.
        ('R', {}, 'th', 'hh'),
        ('S', {}, 'h', 'hh'),
        ('R', {'_while': "s == ''"}, 'tt', ''),
        ('R', {'_while': "(s += 'w') == 'w'"}, 'tt', 'wwh'),
    ],
)
def test_scripts_of_the_completion(leaf_script: str, conditions: dict[str, str], steps: str, expected: str) -> None:
    assert board_after(leaf(leaf_script, 0, **conditions, **ALL), steps, s='')['s'] == expected


def test_a_child_that_is_halted_by_its_parent_is_told_once() -> None:
    body = run(script("t := 'start'"), node('Parallel', leaf('R', 0, _onHalted="t += 'h'", _post="t += 'p'"),
                                            leaf('F', 1), failure_count='1'))  # fmt: skip
    assert board_after(body, 't')['t'] == 'starth'


def test_post_conditions_of_every_round_of_a_retry() -> None:
    body = run(
        script('x := 0; y := 0'),
        node('RetryUntilSuccessful', leaf('F', _onFailure='x += 1', _post='y += 1'), num_attempts='5'),
    )
    assert board_after(body, 't') == {'x': 5, 'y': 5}


@pytest.mark.parametrize('observed', [False, True])
def test_scripts_of_the_completion_run_once(observed: bool) -> None:
    tree, _ = make(leaf('KRS', _successIf='n > 3', _post='n += 1'))
    if observed:
        tree.observe(lambda *transition: None)
    tree.blackboard.set('n', 0)
    counts = []
    for _ in range(8):
        tree.tick_once()
        counts.append(tree.blackboard.get('n'))
        if counts[-1] == 1:
            tree.blackboard.set('n', 2)
    assert counts == [0, 0, 1, 2, 2, 3, 3, 3]
    tree.blackboard.set('n', 9)
    tree.halt()
    tree.tick_once()
    tree.tick_once()
    assert tree.blackboard.get('n') == 11


def test_a_loop_that_a_pre_condition_has_completed_and_nobody_reset_has_no_constant_queue() -> None:
    loop = node('LoopInt', leaf('S'), queue='1;2', value='{v}', _failureIf='x')
    check(node('IfThenElse', loop, leaf('S', 1)), 'x=1 F | x=0 S 1S | R 0S')
    shared = node('LoopInt', leaf('S'), queue='{q}', value='{v}', _failureIf='x')
    check(node('IfThenElse', shared, leaf('S', 1)), "x=1 q='1' F | x=0 R 0S | S 1S")


def test_a_node_that_another_decorator_wraps_completes_first() -> None:
    body = node(
        'ForceSuccess', leaf('S', _failureIf='1', _onFailure="s += 'leaf '"), _onSuccess="s += 'force '", _post='n := 1'
    )
    assert board_after(body, 't', s='') == {'s': 'leaf force ', 'n': 1}


def test_conditions_of_a_sub_tree_are_those_of_the_caller() -> None:
    text = """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Sequence>
      <Script code="value := true; text := 'a'"/>
      <SubTree ID="Sub" p="{value}" _onSuccess="text += 's'"/>
      <SubTree ID="Sub" p="true" _post="text += 'p'"/>
      <SubTree ID="Sub" p="{value}" _skipIf="value" _post="text += 'never'"/>
      </Sequence></BehaviorTree>
      <BehaviorTree ID="Sub"><Sequence>
        <Script code="p = p; own := 2; @top := 3" _skipIf="p != true" _onSuccess="own += 1"/>
      </Sequence></BehaviorTree></root>"""
    registry = builtin_registry()
    tree = Tree(TreeLibrary([load_xml(text, 'f', registry)]), 'Main')
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert tree.blackboard.snapshot() == {'value': 1.0, 'text': 'asp', 'top': 3}
    assert [subtree.blackboard.snapshot() for subtree in tree.subtrees[1:]] == [{'own': 3}, {'p': 'true', 'own': 3}, {}]


# -- errors ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('body', 'place', 'words'),
    [
        (script('x := 1;\ny := x + z'), 'Script::1', '(line 2, column 10 of the script [x := 1;\ny := x + z])'),
        (leaf('S', _skipIf='z == 1'), 'S_0', '_skipIf: the blackboard has no entry [z] (column 1 of'),
        (leaf('S', _post='z = 1'), 'S_0', '_post: the blackboard has no entry [z]; create it by [:=]'),
        (run(node('Inverter', leaf('F', _onFailure="'a' + 1"))), 'F_0', '_onFailure: operator [+] does not apply'),
        (node('ScriptCondition', code="'a'"), 'ScriptCondition::1', "the text 'a' is neither true nor false"),
        (node('Precondition', leaf('S'), if_='2'), 'Precondition::1', 'of the integers only 0 and 1'),
        (
            node('Parallel', leaf('R', _onHalted='z = 1'), leaf('S', 1), success_count='1'),
            'R_0',
            '_onHalted: the black',
        ),
    ],
)
def test_a_script_that_fails_names_node_attribute_and_place(body: str, place: str, words: str) -> None:
    tree, _ = make(body)
    with pytest.raises(NodeExecutionError) as caught:
        tree.tick_once()
    assert caught.value.node_path == place
    assert words in str(caught.value)
    assert isinstance(caught.value.cause, ScriptError)
    assert caught.value.cause.is_absent is ('has no entry [z]' in str(caught.value))


@pytest.mark.parametrize('observed', [False, True])
def test_a_node_whose_post_condition_fails_has_not_completed(observed: bool) -> None:
    tree, calls = make(run(leaf('RS', _post='z = 1')))
    if observed:
        tree.observe(lambda node, before, after: calls.append(f'{NAMES[after] if after else "I"}{node.uid}'))
    tree.tick_once()
    with pytest.raises(NodeExecutionError, match='_post'):
        tree.tick_once()
    assert tree.nodes[1].status is NodeStatus.RUNNING
    tree.halt()
    assert calls == (['R1', '0R', 'R2', '0S', '0!', 'I2', 'I1'] if observed else ['0R', '0S', '0!'])
    tree.blackboard.set('z', 0)
    assert tree.tick_once() is NodeStatus.RUNNING


class ByDistance(DistanceController):
    """The robot stands still."""

    def position(self) -> Position | None:
        return 0.0, 0.0


class BySpeed(SpeedController):
    def speed(self) -> float:
        return 0.0


OF_HOSTS = (ByDistance, BySpeed, PauseResumeController)
WITH_CHILDREN = builtin_registry()
register_nav2(WITH_CHILDREN, 'main')
WITH_CHILDREN.register_classes(OF_HOSTS)
NODES_WITH_CHILDREN = [one for one in WITH_CHILDREN if one.kind in (NodeKind.CONTROL, NodeKind.DECORATOR)]
PORTS = {'queue': '1;0', 'entry': '{n}', 'if': 'n < 3', 'then_skip': 'false', 'if_empty': 'FAILURE'}


EVERY_NODE_WITH_CHILDREN = pytest.mark.parametrize('manifest', NODES_WITH_CHILDREN, ids=lambda manifest: manifest.id)


def with_children(manifest: NodeManifest, *scripts: str, **conditions: str) -> str:
    """Return the XML of a node over leaves with these scripts."""
    ports = {name: PORTS.get(name, '{n}') for name, port in manifest.ports.items() if port.required or name in PORTS}
    return node(manifest.id, *map(leaf, scripts, range(len(scripts))), **ports, **conditions)


def fewest(manifest: NodeManifest) -> int:
    """Return how many children a node needs for a tick."""
    least, _ = getattr(manifest.node_class, 'tickable_with', None) or manifest.children
    return least


@EVERY_NODE_WITH_CHILDREN
@pytest.mark.parametrize('script', ['S', 'F', 'RS'])
def test_a_node_that_a_pre_condition_has_completed_may_be_ticked_before_it_is_reset(
    script: str, manifest: NodeManifest
) -> None:
    top = with_children(manifest, *[script] * fewest(manifest), _failureIf='n == 1')
    tree, _ = make(node('Fallback', top, leaf('R', 9)), branch='main', extra=OF_HOSTS)
    tree.blackboard.set('n', 1)
    tree.tick_once()
    for _ in range(3):
        tree.nodes[1].execute()


CHILD_FIRST = ('Switch', 'SkipUnlessUpdated', 'WaitValueUpdate', 'Precondition', 'PipelineSequence', 'Nonblocking')


@EVERY_NODE_WITH_CHILDREN
def test_a_node_is_running_while_its_first_child_begins_where_it_is_so_in_btcpp_and_nav2(
    manifest: NodeManifest,
) -> None:
    tree, _ = make(with_children(manifest, *'R' * fewest(manifest)), branch='main', extra=OF_HOSTS)
    tree.blackboard.set('n', 0)
    running: list[TreeNode] = []
    tree.observe(lambda node, before, after: running.append(node) if after is NodeStatus.RUNNING else None)
    tree.tick_exactly_once()
    assert (running[0] is tree.root) is not manifest.id.startswith(CHILD_FIRST)


@EVERY_NODE_WITH_CHILDREN
def test_a_node_with_post_conditions_has_the_same_statuses_when_nobody_looks(manifest: NodeManifest) -> None:
    outcomes = set()
    for seed in range(40):
        draw = random.Random(seed)
        least, most = manifest.children
        count = draw.randint(least, least + 3 if most is None else most)
        scripts = [''.join(draw.choice('SFRK') for _ in range(draw.randint(1, 3))) for _ in range(count)]
        body = with_children(manifest, *scripts, _post='z = 1')
        seen, unseen = (make(body, branch='main', extra=OF_HOSTS)[0] for _ in range(2))
        seen.observe(lambda *_: None)
        for _ in range(6):
            n, z, halts = draw.randint(1, 3), draw.choice(('set', 'unset')), draw.random() < 0.3
            results = [_tick(tree, n, z, halts) for tree in (seen, unseen)]
            assert results[0] == results[1], body
            outcomes.add(results[0][0])
    assert 'error' in outcomes or not outcomes & {'SUCCESS', 'FAILURE'}


def _tick(tree: Tree, n: int, z: str, halts: bool) -> tuple[str, list[NodeStatus]]:
    """Return the result, or ``error``, and the statuses of all nodes then."""
    tree.blackboard.set('n', n)
    tree.blackboard.set('z', 0)
    if z == 'unset':
        tree.blackboard.unset('z')
    try:
        result = tree.tick_exactly_once().name
    except NodeExecutionError:
        result = 'error'
    statuses = [node.status for node in tree.nodes]
    if halts:
        tree.halt()
    return result, statuses


def test_all_scripts_of_a_file_that_cannot_be_parsed_are_reported_with_their_places() -> None:
    text = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <Script code="a := 1; b := " _skipIf="x &amp;&amp; "/>
  <Precondition else="NO" if='
    a == $'><AlwaysSuccess _post="" name="leaf"/></Precondition>
</Sequence></BehaviorTree></root>"""
    with pytest.raises(TreeLoadError) as caught:
        load_xml(text, 'f.xml', builtin_registry())
    assert [(error.line, error.column, error.message[:22]) for error in caught.value.errors] == [
        (2, 30, 'script of [code]: a va'),
        (2, 54, 'script of [_skipIf]: a'),
        (3, 17, 'port [else] of type BT'),
        (4, 10, "script of [if]: '$' me"),
        (4, 35, 'script of [_post]: the'),
    ]
    assert caught.value.errors[-1].node == "<AlwaysSuccess 'leaf'>"


def test_a_halt_goes_on_when_a_script_of_it_fails() -> None:
    tree, calls = make(
        node(
            'Parallel',
            leaf('R', 0, _onHalted='z = 1'),
            leaf('R', 1, _onHalted='n += 1'),
            leaf('R', 2, _onHalted='z = 1'),
        )
    )
    tree.blackboard.set('n', 0)
    tree.tick_once()
    calls.clear()
    with pytest.raises(NodeExecutionError, match=r'R_0.*_onHalted') as caught:
        tree.halt()
    assert calls == ['0!', '1!', '2!']
    assert all(node.status is NodeStatus.IDLE for node in tree.nodes)
    assert any('R_2' in note for note in caught.value.__notes__)


def test_why_a_tree_failed_because_of_a_condition() -> None:
    assert first_failure(run(leaf('S', _failureIf='1 < 2')))[:2] == ('S_0', 'Step: [1 < 2] of _failureIf holds')
    assert first_failure(node('ScriptCondition', code='1 > 2', name='c'))[:2] == (
        'c',
        'ScriptCondition: [1 > 2] does not hold',
    )
    body = node('Precondition', leaf('S'), if_='1 > 2', name='p')
    assert first_failure(body)[:2] == ('p', 'Precondition: [1 > 2] does not hold')
    assert first_failure(node('Precondition', leaf('F'), if_='1', name='p'))[2] == ['p', 'F_0']
    # A control that fails by itself in another run is not blamed on the condition of the run before.
    body = node('Sequence', leaf('F'), _failureIf='x', name='s')
    tree, _ = make(body)
    for x, chain in ((1, ('s',)), (0, ('s', 'F_0')), (1, ('s',))):
        tree.blackboard.set('x', x)
        tree.tick_once()
        assert tree.failure is not None
        assert tree.failure.chain == chain


# -- scripts on the blackboard ---------------------------------------------------------------------------------------


def pointed(text: str | None, body: str = '<Script code="{code}"/>') -> Tree:
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    library = TreeLibrary([load_xml(xml, 'f.xml', builtin_registry())])
    board = Blackboard()
    if text is not None:
        board.set('code', text)
        board.set('n', 1)
    return Tree(library, 'Main', blackboard=board)


def test_a_script_may_be_on_the_blackboard_and_change() -> None:
    tree = pointed('x := 1')
    tree.tick_once()
    tree.tick_once()
    tree.blackboard.set('code', 'x = 2')
    tree.tick_once()
    assert tree.blackboard.get('x') == 2
    tree.blackboard.set('code', 'x = ')
    with pytest.raises(NodeExecutionError, match=r'Script::1.*a value is missing here.*\(column 5'):
        tree.tick_once()


@pytest.mark.parametrize('code', ['n == 1', 'n == 2', 'n := 0', 'n', 'n + 1', "'a'", 'z'])
def test_a_condition_on_the_blackboard_holds_as_one_in_the_file_does(code: str) -> None:
    def ticked(given: str) -> list[str]:
        bodies = node('ScriptCondition', code=given), node('Precondition', '<AlwaysSuccess/>', if_=given)
        results = []
        for body in bodies:
            try:
                results.append(pointed(code, body).tick_once().name)
            except NodeExecutionError as error:
                results.append(error.reason)
        return results

    assert ticked('{code}') == ticked(code)


def test_a_script_on_the_blackboard_has_to_be_there_when_the_tree_is_made() -> None:
    with pytest.raises(TreeLoadError, match=r'f.xml:1:\d+: <Script>: port \[code\]: the entry was never written'):
        pointed(None)
    with pytest.raises(TreeLoadError, match=r'f.xml:1:\d+: <Script>: a value is missing here'):
        pointed('1 +')


# -- enums, depth ----------------------------------------------------------------------------------------------------


def test_enum_constants_in_scripts_and_conditions() -> None:
    body = run(
        script('device := BATTERY; other := CONTROLLER; level := 20'),
        leaf('S', 0, _skipIf='device != BATTERY || level > 25'),
        leaf('S', 1, _while='device == CONTROLLER'),
        leaf('S', 2, _failureIf="device == 'CONTROLLER'"),
    )
    tree, calls = make(body, enums={'BATTERY': 1, 'CONTROLLER': 2})
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert calls == ['0S', '2S']
    assert tree.blackboard.snapshot() == {'device': 1.0, 'other': 2.0, 'level': 20}


class Through(Decorator):
    def tick(self) -> NodeStatus:
        return self.tick_child()


def test_a_deep_chain_of_nodes_with_conditions_ticks_and_halts() -> None:
    registry = builtin_registry()
    registry.register('Through', Through)
    depth, trees = 100, 30
    head, tail = '<Through _skipIf="n &lt; 0" _onSuccess="n += 1" _onHalted="h += 1">' * depth, '</Through>' * depth
    bodies = [
        f'<BehaviorTree ID="T{number}">{head}'
        + (
            f'<SubTree ID="T{number + 1}" _autoremap="1" _while="1"/>'
            if number + 1 < trees
            else '<Sleep msec="100000"/>'
        )
        + f'{tail}</BehaviorTree>'
        for number in range(trees)
    ]
    tree = Tree(TreeLibrary([load_xml(f'<root BTCPP_format="4">{"".join(bodies)}</root>', 'f', registry)]), 'T0')
    tree.blackboard.set('n', 0)
    tree.blackboard.set('h', 0)
    for _ in range(3):
        assert tree.tick_once() is NodeStatus.RUNNING
    tree.halt()
    assert tree.blackboard.get('h') == 2 * depth * trees
