# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool check``: what it finds in files, at which place, and with which exit code."""

from __future__ import annotations

import contextlib
import functools
import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.ports import DOUBLE, INT, STRING, PortType, input_port, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.skills.skill import Skill
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES, document, tool, without_marks
from flexbt_tools.tree_checks.check import check_trees
from flexbt_tools.tree_checks.diagnostics import REFUSED
from flexbt_tools.trees.files import read_library
from flexbt_tools.trees.outline import tree_as_json
from flexbt_tools.trees.stand_ins import OpenRegistry

THING = PortType('Thing', object)


class Make(SyncAction):
    """Writes what it is asked for."""

    ports = {
        'int': output_port(INT),
        'real': output_port(DOUBLE),
        'text': output_port(STRING),
        'thing': output_port(THING),
    }

    def tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


class Use(SyncAction):
    """Reads what it is given."""

    ports = {name: input_port(port.type, optional=True) for name, port in Make.ports.items()}

    def tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


class Drill(StatefulAction):
    """Takes its time."""

    skill = Skill.of(duration=(20.0, None))

    def on_start(self) -> NodeStatus:
        return NodeStatus.RUNNING

    on_running = on_start

    def on_halted(self) -> None:
        pass


class Change(SyncAction):
    """Makes something else of what it is given."""

    ports = {'input_thing': input_port(THING), 'output_thing': output_port(THING)}

    def tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


@functools.cache
def registry() -> NodeRegistry:
    nodes = node_registry(lambda source, error: None)
    nodes.register('Make', Make)
    nodes.register('Use', Use)
    nodes.register('Change', Change)
    nodes.register('Drill', Drill)
    return nodes


def found(directory: Path, *texts: str, shared: bool = False) -> list[str]:
    """Return the findings in files a.xml, b.xml, ...: ``file:line:column rule message``."""
    files = []
    for letter, text in zip('abcdef', texts, strict=False):
        (directory / f'{letter}.xml').write_text(text, encoding='utf-8')
        files.append(str(directory / f'{letter}.xml'))
    return [
        f'{Path(one.place.file).stem}:{one.place.line}:{one.place.column} {one.rule.name} {one.place.message}'
        for one in check_trees(files, registry(), shared=shared)
    ]


# (why, trees of a file with a ^ at the place of each finding, the beginnings of the findings)
LINTS: list[tuple[str, tuple[str, ...], list[str]]] = [
    ('clean', ('Main: <Sequence><Make int="{a}"/><Use int="{a}"/></Sequence>',), []),
    (
        'a slip in a key',
        ('Main: <Sequence><Make ^int="{path}"/><Use ^int="{pth}"/></Sequence>',),
        [
            'never-read key [path] is written, and nothing reads it',
            'never-written key [pth] is read, and nothing writes it; did you mean [path]?',
        ],
    ),
    (
        'an input of the tree',
        ('Main: <Use ^int="{a}"/>',),
        [
            'never-written key [a] is read, and nothing writes it; '
            'if the tree is given it, declare it as an input_port in a TreeNodesModel, or say --input a'
        ],
    ),
    ('what the BT server gives', ('Main: <Sequence><Use text="{goal}"/><Use text="{goals}"/></Sequence>',), []),
    (
        'a key that is not handed on',
        ('Main: <Sequence><Make int="{a}"/><SubTree ID="S"/><Use int="{a}"/></Sequence>', 'S: <Use ^int="{a}"/>'),
        [
            'never-written key [a] is read, and nothing writes it; '
            'another scope has such a key, so hand it to the sub-tree: a="{a}"'
        ],
    ),
    ('remapped', ('Main: <Sequence><Make int="{a}"/><SubTree ID="S" b="{a}"/></Sequence>', 'S: <Use int="{b}"/>'), []),
    (
        'autoremapped',
        ('Main: <Sequence><Make int="{a}"/><SubTree ID="S" _autoremap="1"/></Sequence>', 'S: <Use int="{a}"/>'),
        [],
    ),
    ('by the root', ('Main: <Sequence><Make int="{a}"/><SubTree ID="S"/></Sequence>', 'S: <Use int="{@a}"/>'), []),
    ('a constant', ('Main: <SubTree ID="S" b="3"/>', 'S: <Use int="{b}"/>'), []),
    (
        'written in a sub-tree',
        ('Main: <Sequence><SubTree ID="S" b="{a}"/><Use int="{a}"/></Sequence>', 'S: <Make int="{b}"/>'),
        [],
    ),
    (
        'a private key',
        (
            'Main: <Sequence><Make int="{_a}"/><SubTree ID="S" _autoremap="1"/><Use int="{_a}"/></Sequence>',
            'S: <Use ^int="{_a}"/>',
        ),
        [
            'never-written key [_a] is read, and nothing writes it; another scope has such a key, '
            'but keys that begin with _ are not handed to sub-trees: rename it'
        ],
    ),
    (
        'a new value that is for nobody',
        (
            'Main: <Sequence><Make thing="{a}"/><Change input_thing="{a}" ^output_thing="{b}"/>'
            '<Use thing="{a}"/></Sequence>',
        ),
        [
            'lost-write key [b] is written, and nothing reads it: <Use> after it reads [a], which is as it was before; '
            'is [b] meant there, or [a] here?'
        ],
    ),
    (
        'a new value for who runs the tree',
        ('Main: <Sequence><Make thing="{a}"/><Change input_thing="{a}" ^output_thing="{b}"/></Sequence>',),
        ['never-read key [b]'],
    ),
    (
        'a new value for all trees',
        (
            'Main: <Sequence><Make thing="{a}"/><Change input_thing="{a}" ^output_thing="{@b}"/>'
            '<Use thing="{a}"/></Sequence>',
        ),
        ['never-read key [@b]'],
    ),
    (
        'what is written anew before it is read',
        (
            'Main: <Sequence><Make thing="{a}"/><Change input_thing="{a}" ^output_thing="{b}"/><Make thing="{a}"/>'
            '<Use thing="{a}"/></Sequence>',
        ),
        ['never-read key [b]'],
    ),
    (
        'another thing, which is only made',
        ('Main: <Sequence><Make thing="{a}"/><Make ^thing="{b}"/><Use thing="{a}"/></Sequence>',),
        ['never-read key [b]'],
    ),
    (
        'a sub-tree that does not hand out what it makes',
        (
            'Main: <Sequence><Make thing="{a}"/><SubTree ID="S"/><Use thing="{a}"/></Sequence>',
            'S: <Make ^thing="{a}"/>',
        ),
        [
            'lost-write key [a] is written, and nothing reads it: <Use> after it reads the key of this name of another '
            'scope; hand it to the sub-tree: a="{a}"'
        ],
    ),
    (
        'a sub-tree that does so in another place',
        (
            'Main: <Sequence><SubTree ID="S" name="s" a="{a}"/><SubTree ID="S" name="t"/><Use thing="{a}"/></Sequence>',
            'S: <Make ^thing="{a}"/>',
        ),
        ['never-read key [a]'],
    ),
    ('scripts', ('Main: <Sequence><Script code="a := 1; b := a"/><ScriptCondition code="b == 1"/></Sequence>',), []),
    (
        'scripts that read what is not there',
        ('Main: <Sequence ^_skipIf="never > 1"><ScriptCondition ^code="1 + (-other)"/></Sequence>',),
        ['never-written key [never]', 'never-written key [other]'],
    ),
    (
        'scripts that change what is not there',
        (
            'Main: <Sequence><Script ^code="a += 1"/><Script ^code="b := 2 * b + 1"/>'
            '<Script code="c := true ? 1 : c; c += a"/></Sequence>',
        ),
        [
            'never-written key [a] is read, and nothing writes a first value to it; if the tree is given it',
            'never-written key [b] is read, and nothing writes a first value to it',
        ],
    ),
    ('conditions write', ('Main: <Sequence><AlwaysSuccess _onSuccess="a := 1"/><Use int="{a}"/></Sequence>',), []),
    (
        'a script of a sub-tree belongs to the caller',
        ('Main: <SubTree ID="S" ^_post="a := 1"/>', 'S: <Use ^int="{a}"/>'),
        ['never-read key [a]', 'never-written key [a]'],
    ),
    (
        'named keys',
        ('Main: <Sequence><SetBlackboard value="1" output_key="k"/><WasEntryUpdated entry="k"/></Sequence>',),
        [],
    ),
    (
        'a key whose name is in an entry',
        (
            'Main: <Sequence><SetBlackboard value="1" ^output_key="{a}"/><Script code="b := \'c\'"/>'
            '<SetBlackboard value="1" output_key="{b}"/></Sequence>',
        ),
        ['never-written key [a] is read, and nothing writes it'],
    ),
    (
        'keys that a behavior takes and gives',
        (
            'Main: <Sequence><Make int="{a}"/><Script code="list := \'e\'"/>'
            '<ExecuteBehavior behavior="B" ^inputs="a; b" ^outputs=" c ;; d"/><Use int="{c}"/>'
            '<ExecuteBehavior behavior="B" inputs="{list}" outputs=""/></Sequence>',
        ),
        ['never-written key [b] is read, and nothing writes it', 'never-read key [d] is written, and nothing reads it'],
    ),
    (
        'a named key that nobody writes',
        ('Main: <SkipUnlessUpdated ^entry="k"><AlwaysSuccess/></SkipUnlessUpdated>',),
        ['never-written key [k]'],
    ),
    (
        'a port of a sub-tree that it does not use',
        (
            'Main: <Sequence><Make ^int="{a}"/><SubTree ID="S" ^speeed="{a}"/></Sequence>',
            'S: <Use ^_skipIf="speed > 1"/>',
        ),
        [
            'never-read key [a]',
            'unused-port tree [S] does not use the key [speeed]; did you mean [speed]?',
            'never-written key [speed]',
        ],
    ),
    (
        'a port that a sub-tree of the sub-tree uses',
        (
            'Main: <Sequence><Make int="{a}"/><SubTree ID="S" a="{a}"/></Sequence>',
            'S: <SubTree ID="T" _autoremap="1"/>',
            'T: <Use int="{a}"/>',
        ),
        [],
    ),
    ('a port that Nav2 takes by its name', ('Main: <SubTree ID="S" goal="{goal}"/>', 'S: <GoalUpdated/>'), []),
    (
        'loaded, and never to be ticked',
        (
            'Main: <Fallback>^<IfThenElse><Use/></IfThenElse>^<Switch2 variable="1"><Use/><Use/></Switch2>'
            '^<WhileDoElse><Use/><Use/><Use/><Use/></WhileDoElse></Fallback>',
        ),
        [
            'incomplete IfThenElse has 2 to 3 children, not 1: an error as soon as the node is ticked',
            'incomplete Switch2 has 3 children, not 2',
            'incomplete WhileDoElse has 2 to 3 children, not 4',
        ],
    ),
    (
        'all that can be ticked',
        (
            'Main: <Fallback><IfThenElse><Use/><Use/></IfThenElse><WhileDoElse><Use/><Use/><Use/></WhileDoElse>'
            '<Switch2 variable="1"><Use/><Use/><Use/></Switch2></Fallback>',
        ),
        [],
    ),
    (
        'the name of another type, or of another tree',
        (
            'Main: <Sequence>^<Make name="use"/><Make name="Make 2"/><Wait name="use" wait_duration="1"/>'
            '^<SubTree ID="S" name="t"/><SubTree ID="S" name="S again"/><SubTree ID="T"/></Sequence>',
            'S: <AlwaysSuccess/>',
            'T: <AlwaysSuccess name="Sequence"/>',
        ),
        [
            'misnamed it is a [Make], and there is a node type [Use]',
            'misnamed it runs the tree [S], and there is a tree [T]',
        ],
    ),
    (
        'there twice',
        (
            'Main: <Sequence><Use int="1"/><Use int="2"/>^<Use int="2"/><Use int="2" name="again"/>'
            '<Fallback><Use/><Use/></Fallback></Sequence>',
        ),
        ['twice it is there twice in a row, with the same ports'],
    ),
    (
        'a time limit that is too short',
        (
            'Main: <Fallback>^<Timeout msec="1000"><Wait wait_duration="5"/></Timeout>'
            '^<Timeout msec="1000"><SubTree ID="S"/></Timeout>^<Timeout msec="9000"><Drill/></Timeout>'
            '^<Timeout msec="1000"><Delay delay_msec="5000"><Use/></Delay></Timeout>'
            '^<Timeout msec="1000"><Sequence><Sleep msec="600"/><Use/><Sleep msec="600"/></Sequence></Timeout>'
            '</Fallback>',
            'S: <Repeat num_cycles="2"><Sleep msec="3000"/></Repeat>',
        ),
        [
            'too-short it can never succeed: <Wait> takes 5 s, and is ended after 1 s',
            "too-short it can never succeed: <SubTree 'S'> takes 6 s, and is ended after 1 s",
            'too-short it can never succeed: <Drill> takes 20 s, and is ended after 9 s',
            'too-short it can never succeed: <Delay> takes 5 s, and is ended after 1 s',
            'too-short it can never succeed: what is in it takes 1.2 s at least, and is ended after 1 s',
        ],
    ),
    (
        'what begins after the end of a time limit',
        (
            'Main: <Timeout msec="1000"><Fallback><Use/><Sequence><Sleep msec="2000"/>^<Make/></Sequence></Fallback>'
            '</Timeout>',
        ),
        ['too-short it is never ticked: <Timeout> ends after 1 s, and what is before it takes 2 s'],
    ),
    (
        'time limits that are long enough, or that decide',
        (
            'Main: <Sequence><Timeout msec="5000"><Wait wait_duration="4"/></Timeout>'
            '<Timeout msec="1000"><Wait wait_duration="{goal}"/></Timeout><Timeout msec="0"><Sleep msec="9"/></Timeout>'
            '<Timeout msec="1000"><ReactiveFallback><Use/><Sleep msec="3600000"/></ReactiveFallback></Timeout>'
            '<Timeout msec="1000"><Sleep msec="3000" _skipIf="true"/></Timeout>'
            '<Timeout msec="1000"><KeepRunningUntilFailure><Sleep msec="3000"/></KeepRunningUntilFailure></Timeout>'
            '</Sequence>',
        ),
        [],
    ),
    ('never used', ('Main: <AlwaysSuccess/>', 'S: <AlwaysSuccess/>'), ['unused-tree tree [S] is never used']),
    (
        'a constant of the wrong type',
        ('Main: <SubTree ID="S" ^b="three" c="2.5"/>', 'S: <Sequence><Use int="{b}"/><Use real="{c}"/></Sequence>'),
        ["type-clash port [int] of <Use> reads it as int: can't convert text 'three' to int"],
    ),
    (
        'text for what cannot be text',
        ('Main: <Sequence><Make text="{a}"/><Use ^thing="{a}"/></Sequence>',),
        ['type-clash key [a] holds text, which cannot be read as Thing'],
    ),
    (
        'two types of one key',
        (
            'Main: <Sequence><Make int="{a}"/><SubTree ID="S" b="{a}"/></Sequence>',
            'S: <Sequence><Use ^real="{b}"/><Use ^thing="{b}"/></Sequence>',
        ),
        [
            'refused port [real] uses the blackboard entry [b] with the type double, but it has the type int',
            'refused port [thing] uses the blackboard entry [b] with the type Thing, but it has the type int',
        ],
    ),
    (
        'two sub-trees with one path',
        ('Main: <Parallel><SubTree ID="S" name="s"/><SubTree ID="S" ^name="s"/></Parallel>', 'S: <AlwaysSuccess/>'),
        ['refused two sub-trees have the path [s]'],
    ),
]


@pytest.mark.parametrize(('trees', 'expected'), [row[1:] for row in LINTS], ids=[row[0] for row in LINTS])
def test_what_is_found(tmp_path: Path, trees: tuple[str, ...], expected: list[str]) -> None:
    text, places = without_marks(document(*trees))
    shown = found(tmp_path, text)
    if 'unused-tree' in ''.join(expected):
        places = ['3:1']  # the tree itself
    assert len(shown) == len(expected), shown
    for line, place, beginning in zip(shown, places, expected, strict=True):
        assert line.startswith(f'a:{place} {beginning}')


def test_trees_that_share_a_blackboard_are_looked_at_together(tmp_path: Path) -> None:
    planner, follower = document('Main: <Make int="{path}"/>'), document('Main: <Use int="{path}"/>')
    assert [line.split()[1] for line in found(tmp_path, planner, follower)] == ['never-read', 'never-written']
    assert found(tmp_path, planner, follower, shared=True) == []
    clash, [place] = without_marks(document('Main: <Use ^thing="{path}"/>'))
    assert found(tmp_path, planner, clash, shared=True)[0].startswith(f'b:{place} refused port [thing]')


def test_what_a_tree_is_given_is_an_error_only_where_nothing_can_give_it(tmp_path: Path) -> None:
    """A tree that its file does not name as the main one may be the sub-tree of another file."""
    tree = 'T: <Use int="{a}"/>'
    model = '<TreeNodesModel><SubTree ID="T"><input_port name="a"/></SubTree></TreeNodesModel></root>'
    declared = document(tree, main='T').replace('</root>', model)
    inside = ('T: <SubTree ID="S"/>', 'S: <Use int="{a}"/>')
    for text, rules in (
        (document(tree, main='T'), ['never-written']),
        (document(tree, main=None), ['undeclared']),
        (document(*inside, main=None), ['never-written']),
        (declared, []),
        (declared.replace('"{a}"', '"{b}"'), ['never-written']),
    ):
        assert [line.split()[1] for line in found(tmp_path, text)] == rules, text
    file = tmp_path / 'a.xml'
    file.write_text(document('T: <ScriptCondition code="a == 1"/>', main='T'))
    codes = [tool('check', str(file), *more).code for more in ((), ('--input', 'a'), ('--ignore', 'never-written'))]
    assert codes == [1, 0, 0]


def test_errors_of_all_files_are_reported_at_once(tmp_path: Path) -> None:
    marked = [
        document('Main: <Sequence>^<Mak/><SubTree ID="FromB"/><SubTree ID="Nowhere"/></Sequence>'),
        document('FromB: <Use ^int="x"/>', main=None),
        '<root BTCPP_format="4">\n^<BehaviorTree ID="Cut">',
        document('Main: <Sequence><SubTree ID="FromB"/><SubTree ^ID="Nowhere"/></Sequence>'),
    ]
    texts, places = zip(*map(without_marks, marked), strict=True)
    assert [line.partition(';')[0] for line in found(tmp_path, *texts)] == [
        f'a:{places[0][0]} refused node type [Mak] is not registered',
        f"b:{places[1][0]} refused port [int] of type int: can't convert text 'x' to int",
        f'c:{places[2][0]} refused <BehaviorTree> is never closed',
        f'd:{places[3][0]} refused there is no tree [Nowhere]',
    ]


def test_a_file_and_what_it_includes_are_one(tmp_path: Path) -> None:
    (tmp_path / 'lib').mkdir()
    (tmp_path / 'lib' / 'b.xml').write_text(document('S: <Use int="{a}"/>', 'Spare: <AlwaysSuccess/>', main=None))
    (tmp_path / 'a.xml').write_text(
        document('Main: <SubTree ID="S"/>').replace('<Beh', '<include path="lib/b.xml"/>\n<Beh')
    )
    shown = tool('check', '--allow-unknown', str(tmp_path / 'a.xml'))
    assert shown == (0, '', '1 file: no problems found\n')
    # Also when it is checked by itself, too, under another name.
    with contextlib.chdir(tmp_path):
        shown = tool('check', '--allow-unknown', '--strict', '--ignore', 'unused-tree', './lib/../a.xml', 'lib/b.xml')
    assert (shown.code, 'warning' in shown.out) == (0, False), shown
    (tmp_path / 'lib' / 'b.xml').unlink()
    shown = tool('check', '--allow-unknown', str(tmp_path / 'a.xml'))
    assert shown.code == 1
    assert 'a.xml:2:10: error: <include>:' in shown.out
    assert 'lib/b.xml' in shown.out


@pytest.mark.parametrize(
    ('parent', 'port', 'others'),
    [('RetryUntilSuccessful', 'num_attempts', ''), ('RecoveryNode', 'number_of_retries', '<AlwaysFailure/>')],
)
def test_a_child_that_its_parent_never_ticks(parent: str, port: str, others: str, tmp_path: Path) -> None:
    never = tmp_path / 'never.xml'
    never.write_text(document(f'Main: <{parent} {port}="0">{others}<AlwaysSuccess/></{parent}>'))
    finding = f'<AlwaysSuccess>: it is never ticked: <{parent}> has {port}="0" [unreachable]'
    assert finding in tool('check', str(never)).out


def test_exit_codes_and_output(tmp_path: Path) -> None:
    clean, slip, broken = (tmp_path / name for name in ('clean.xml', 'slip.xml', 'broken.xml'))
    clean.write_text(document('Main: <AlwaysSuccess/>'))
    slip.write_text(document('Main: <Fallback><AlwaysSuccess/><AlwaysFailure/></Fallback>'))
    broken.write_text(document('Main: <Nothing/>'))
    assert tool('check', str(clean)) == (0, '', '1 file: no problems found\n')
    finding = 'it is never ticked: <AlwaysSuccess> gives only SUCCESS'
    text = f'{slip}:2:51: warning: <AlwaysFailure>: {finding} [unreachable]\n'
    assert tool('check', str(clean), str(slip)) == (0, text, '2 files: 1 warning\n')
    assert tool('check', '--strict', str(slip)) == (1, text, '1 file: 1 warning\n')
    assert tool('check', '--strict', '--ignore', 'unreachable', str(slip)).code == 0
    assert tool('check', str(slip), str(broken)).code == 1
    assert (
        tool('check', str(tmp_path / 'nowhere.xml')).out
        == f'{tmp_path}/nowhere.xml:1:1: error: cannot be read: No such file or directory\n'
    )
    assert tool('check').code == 2
    assert tool('check', '--ignore', 'everything', str(clean)).code == 2
    done = tool('check', '--json', str(slip))
    assert (done.code, done.err) == (0, '')
    assert json.loads(done.out) == {
        'findings': [
            {
                'rule': 'unreachable',
                'severity': 'warning',
                'file': str(slip),
                'line': 2,
                'column': 51,
                'end_line': 2,
                'end_column': 67,
                'node': '<AlwaysFailure>',
                'message': finding,
                'fix': 'leave the child out, or change what keeps it from being ticked',
            }
        ],
        'summary': {'files': 1, 'error': 0, 'warning': 1, 'info': 0},
    }


def test_findings_span_the_text_that_they_are_about(tmp_path: Path) -> None:
    """In each: the tree with the text between ``«`` and ``»``, which may hold what ends a tag."""
    for marked in (
        '<Sequence>«<FolowPath path="{a}"/>»</Sequence>',
        '<Wait «wait_duration="x > \'y\'"»/>',
        "<Sequence><Delay «delay_msec='\"'»>\n<AlwaysSuccess/></Delay></Sequence>",
        '<Fallback><AlwaysSuccess/>«<Wait\n name="<é>"\n wait_duration="1"/>»</Fallback>',
    ):
        text = document(f'Main: {marked}')
        file = tmp_path / 'tree.xml'
        file.write_text(text.replace('«', '').replace('»', ''))
        [found] = json.loads(tool('check', '--json', str(file)).out)['findings']
        lines = file.read_text().splitlines(keepends=True)
        starts = [sum(map(len, lines[:number])) for number in range(len(lines))]
        begin = starts[found['line'] - 1] + found['column'] - 1
        end = starts[found['end_line'] - 1] + found['end_column'] - 1
        assert file.read_text()[begin:end] == text.partition('«')[2].partition('»')[0], found


def test_errors_of_commands_are_findings_too(tmp_path: Path) -> None:
    tree, mocks = tmp_path / 'tree.xml', tmp_path / 'mocks.yaml'
    tree.write_text(document('Main: <AlwaysSuccess/>'))
    mocks.write_text('mocks: {Drive: SUCESS}')
    where = {'file': str(mocks), 'line': 1, 'column': 16, 'end_line': 1, 'end_column': 22, 'node': ''}
    what = "'SUCESS' is not a status; did you mean 'SUCCESS'?"
    done = tool('run', '--json', str(tree), '--mock', str(mocks))
    assert (done.code, done.err) == (3, f'{mocks}:1:16: {what}\n')
    assert json.loads(done.out)['findings'] == [
        {'rule': 'refused', 'severity': 'error', 'message': what, 'fix': "did you mean 'SUCCESS'?"} | where
    ]
    [found] = json.loads(tool('run', '--json', str(tree), '--set', 'x').out)['findings']
    assert (found['rule'], found['line'], found['message']) == ('usage', 0, '--set x: expected KEY=VALUE')


def test_node_types_that_are_not_installed(tmp_path: Path) -> None:
    tree, models = tmp_path / 'tree.xml', tmp_path / 'models.xml'
    tree.write_text(
        document('Main: <Sequence><Grasp object="{cup}" force="hard"/><Condition ID="Held"/><MoveToPose/></Sequence>')
    )
    done = tool('check', str(tree))
    assert done.out.endswith(
        ': error: node types [Grasp], [Held], [MoveToPose] are not registered; '
        'install their package, describe them by --models FILE, or check the rest by --allow-unknown\n'
    )
    assert done.err == '1 file: 1 error\n'
    told = json.loads(tool('check', '--json', str(tree)).out)['findings']
    assert [one['message'] for one in told] == [
        f'node type [{one}] is not registered' for one in ('Grasp', 'Held', 'MoveToPose')
    ]
    assert tool('check', '--allow-unknown', str(tree)) == (0, '', '1 file: no problems found\n')
    models.write_text(
        '<root BTCPP_format="4"><TreeNodesModel><Condition ID="Held"/><Action ID="MoveToPose"/><Action ID="Grasp">'
        '<input_port name="object" type="Cup"/><input_port name="force" type="double"/></Action>'
        '</TreeNodesModel></root>'
    )
    done = tool('check', '--models', str(models), str(tree))
    assert done.out.endswith(": error: <Grasp>: port [force] of type double: can't convert text 'hard' to double\n")
    tree.write_text(tree.read_text().replace('force="hard"', 'fore="2.5"'))
    done = tool('check', '--models', str(models), str(tree))
    assert f'did you mean [force]? its ports are: object, force (the [Grasp] of {models})' in done.out
    tree.write_text(tree.read_text().replace('fore', 'force'))
    done = tool('check', '--models', str(models), str(tree))
    assert ': error: <Grasp>: key [cup] is read, and nothing writes it' in done.out
    models.write_text(models.read_text().replace('"Held"', '"He ld"'))
    done = tool('check', '--models', str(models), str(tree))
    assert (done.code, done.out) == (3, '')
    assert done.err.startswith(f"{models}:1:40: <Condition 'He ld'>: node ID [He ld]: ")


LEAVES = """
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.engine.function_nodes import simple_action

def act(node):
    return NodeStatus.SUCCESS

def register(registry):
    for name in ('OpenDoor', {others}):
        registry.register(name, simple_action(act))
"""


def test_of_a_package_only_what_has_a_name_that_is_taken_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'leaves_of_one.py').write_text(LEAVES.format(others="'AlwaysSuccess', 'PickLock'"))
    (tmp_path / 'leaves_of_two.py').write_text(LEAVES.format(others="'SmashDoor'"))
    info = tmp_path / 'leaves_of_both-1.0.dist-info'
    info.mkdir()
    (info / 'METADATA').write_text('Metadata-Version: 2.1\nName: leaves-of-both\nVersion: 1.0\n')
    points = [f'{name} = leaves_of_{name}:register' for name in ('two', 'one')]
    (info / 'entry_points.txt').write_text('\n'.join(['[flexbt.bt_nodes]', *points]))
    monkeypatch.syspath_prepend(tmp_path)
    tree = tmp_path / 'tree.xml'
    tree.write_text(document('Main: <Fallback><OpenDoor/><PickLock/><SmashDoor/></Fallback>'))
    done = tool('check', '--ignore', 'unreachable', str(tree))
    assert (done.code, done.out) == (0, '')
    assert done.err.splitlines() == [
        'note: without the node type [AlwaysSuccess] of one = leaves_of_one:register: node ID [AlwaysSuccess] is '
        'registered already, for flexbt_core.behavior_tree.nodes.blackboard.AlwaysSuccess; choose another ID',
        'note: without the node type [OpenDoor] of two = leaves_of_two:register: node ID [OpenDoor] is registered '
        'already, for leaves_of_one.act; choose another ID',
        '1 file: no problems found',
    ]


@pytest.mark.skipif(not STOCK_TREES, reason='the trees of Nav2 are not at hand')
def test_the_trees_of_nav2_have_no_errors_and_no_warnings() -> None:
    done = tool('check', '--strict', '--remarks', '--allow-unknown', *map(str, STOCK_TREES))
    assert done.code == 0, done.out
    # The only tree that calls this code by another name than all others do.
    [slip] = [line for line in done.out.splitlines() if 'backup_code_id' in line]
    assert 'navigate_to_pose_w_replanning_and_recovery.xml:44:60: info: <BackUp>' in slip


HOSTILE: dict[str, bytes] = {
    'empty': b'',
    'not_xml': b'trees: [1, 2]',
    'not_utf8': b'<root>\xff\xfe</root>',
    'zeros': bytes(2_000_000),
    'truncated': document('Main: <Sequence><AlwaysSuccess/></Sequence>').encode()[:80],
    'doctype': b'<!DOCTYPE x [<!ENTITY a "b">]><root/>',
    'deep': document('Main: ' + '<Inverter>' * 300 + '<AlwaysSuccess/>' + '</Inverter>' * 300).encode(),
    'recursive': document('Main: <SubTree ID="Main"/>').encode(),
    'explosion': document(
        'Main: <SubTree ID="T0"/>',
        *(f'T{i}: <Sequence><SubTree ID="T{i + 1}"/><SubTree ID="T{i + 1}"/></Sequence>' for i in range(40)),
        'T40: <AlwaysSuccess/>',
    ).encode(),
    'escapes': document('Main: <Un\x9bknown name="&#x1b;]0;x&#x7; \u202e"/>').encode(),
}  # fmt: skip


@pytest.mark.parametrize('name', HOSTILE)
def test_hostile_files_are_refused_without_harm_to_the_terminal(tmp_path: Path, name: str) -> None:
    file = tmp_path / f'{name}.xml'
    file.write_bytes(HOSTILE[name])
    done = tool('check', str(file), str(tmp_path))
    assert done.code == 1
    first, *_, last = done.out.splitlines()
    assert first.startswith(f'{file}:')
    assert ': error: ' in first
    assert 'it is a directory' in last
    assert not set(done.out) & set('\x1b\x07\x9b\u202e')


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_a_damaged_file_gives_findings_and_never_a_crash(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    text = data.draw(st.sampled_from([document(*trees) for _, trees, _ in LINTS]))
    for _ in range(data.draw(st.integers(1, 3))):
        position = data.draw(st.integers(0, len(text)))
        length = data.draw(st.integers(0, 12))
        text = (
            text[:position]
            + data.draw(st.text(st.sampled_from('<>/"{}=@ &;aSMain\x00é'), max_size=6))
            + text[position + length :]
        )
    file = tmp_path_factory.getbasetemp() / 'damaged.xml'
    file.write_text(text, encoding='utf-8')
    findings = check_trees([str(file)], registry())
    count = text.count('\n') + 1
    assert all(1 <= one.place.line <= count for one in findings)
    if not any(one.rule is REFUSED for one in findings):
        library = read_library([str(file)], OpenRegistry(registry()))
        assert all(tree_as_json(library, key, expand=True)['nodes'] for key in library.tree_keys())
