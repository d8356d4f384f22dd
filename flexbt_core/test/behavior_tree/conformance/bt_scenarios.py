# SPDX-License-Identifier: BSD-3-Clause
"""The scenarios of BehaviorTree.CPP's own tests, rewritten with scripted leaves, by theme.

The script of a leaf has a letter for each call, over and over: S success, F failure, R running, K skipped. ``RS``
stands for a leaf that is RUNNING once, then SUCCESS.

Operations, of which a text such as ``'tth'`` has one a letter: ``t`` tick exactly once, ``o`` tick once, ``h`` halt,
``s text`` writes a text to the entry my_var, ``i key number`` an integer, ``b key 1`` a bool, ``unset key`` removes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

Row = tuple[str, str, Sequence[str]] | tuple[str, str, Sequence[str], dict[str, Any]]
"""Title; the body of the tree, and after ``|`` further trees as ``ID: body``; operations; the blackboard."""


def act(name: str, script: str, more: str = '') -> str:
    """Return an action that takes time."""
    return f'<Act name="{name}" _script="{script}" {more}/>'


def cond(name: str, script: str, more: str = '') -> str:
    return f'<Cond name="{name}" _script="{script}" {more}/>'


def sync(name: str, script: str = 'S', more: str = '') -> str:
    """Return an action that is done at once, whose calls count."""
    return f'<Sync name="{name}" _script="{script}" {more}/>'


def of(tag: str, *children: str) -> str:
    """Return a node with children; ``tag`` with its attributes."""
    return f'<{tag}>{"".join(children)}</{tag.split()[0]}>'


A, B, C = (sync(name) for name in 'ABC')
TWO_CONDITIONS = cond('c1', 'S'), cond('c2', 'S')

SEQUENCES: list[Row] = [
    ('condition true', of('Sequence', cond('c', 'S'), act('a', 'RS')), 'ttt'),
    ('condition turns to false', of('Sequence', cond('c', 'SF'), act('a', 'RRS')), 'tttt'),
    ('reactive over a sequence of conditions', of('ReactiveSequence', of('Sequence', *TWO_CONDITIONS), act('a', 'RRS')),
     'tttt'),
    ('three actions, each once', of('Sequence', act('a', 'RRS'), act('b', 'RRS'), act('c', 'RRS')), 'tttttttt'),
    ('two sequences with actions', of(
        'ReactiveSequence', of('Sequence', cond('c1', 'S'), act('a', 'RS')), of('Sequence', cond('c2', 'S'), act('b',
        'RS'))
    ), 'tttt'),
    ('first condition to false', of(
        'ReactiveSequence', of('Sequence', cond('c1', 'SF'), cond('c2', 'S')), act('a', 'R')), 'ttt'),
    ('second condition to false', of(
        'ReactiveSequence', of('Sequence', cond('c1', 'S'), cond('c2', 'SF')), act('a', 'R')), 'ttt'),
    ('with memory, condition true', of('SequenceWithMemory', cond('c', 'S'), act('a', 'RS')), 'tttt'),
    ('with memory, condition turns to false', of('SequenceWithMemory', cond('c', 'SF'), act('a', 'RRS')), 'ttttt'),
    ('with memory, nested', of(
        'SequenceWithMemory', of('SequenceWithMemory', *TWO_CONDITIONS), of('SequenceWithMemory', act('a', 'RS'),
        act('b', 'RS'))), 'ttttttt'),
    ('with memory, nested, conditions to false', of(
        'SequenceWithMemory', of('SequenceWithMemory', cond('c1', 'SF'), cond('c2', 'SF')),
        of('SequenceWithMemory', act('a', 'RRF'), act('b', 'RS'))), 'tttttttt'),
    ('with memory resumes the child that failed', of(
        'SequenceWithMemory', A, sync('B', 'FFS'), sync('C', 'S')), 'ttttttt'),
    ('with memory resumes the child that failed, tick once', of(
        'SequenceWithMemory', of('Script code="a := 1"').replace('></Script>', '/>'), A, sync('B', 'FFS'), C), 'ooooo'),
    ('asynchronous, tick once and tick exactly once', of('AsyncSequence', A, B, C), 'tttto'),
]  # fmt: skip

FALLBACKS: list[Row] = [
    ('condition true', of('Fallback', cond('c', 'S'), act('a', 'RS')), 'tt'),
    ('a condition that changes is not asked again', of('Fallback', cond('c', 'FS'), act('a', 'RRS')), 'tttt'),
    ('reactive, first condition to true', of('ReactiveFallback', cond('c1', 'FS'), cond('c2', 'F'), act('a', 'R')),
        'ttt'),
    ('reactive, second condition to true', of('ReactiveFallback', cond('c1', 'F'), cond('c2', 'FS'), act('a', 'R')),
        'ttt'),
    ('condition false', of('Fallback', cond('c', 'F'), act('a', 'RF')), 'ttt'),
    ('condition turns to true', of('Fallback', cond('c', 'FS'), act('a', 'RRF')), 'tttt'),
    ('nested, all true', of('Fallback', of('Fallback', *TWO_CONDITIONS), of('Fallback', act('a', 'RS'), act('b',
        'RS'))), 'tt'),
    ('nested, first false', of(
        'Fallback', of('Fallback', cond('c1', 'F'), cond('c2', 'S')), of('Fallback', act('a', 'RS'), act('b', 'RS'))),
        'tt'),
    ('nested, both false', of(
        'Fallback', of('Fallback', cond('c1', 'F'), cond('c2', 'F')), of('Fallback', act('a', 'RS'), act('b', 'RS'))),
        'ttt'),
    ('nested, first to true', of(
        'Fallback', of('Fallback', cond('c1', 'FS'), cond('c2', 'F')), of('Fallback', act('a', 'RS'), act('b', 'RS'))),
        'ttt'),
    ('nested, second to true', of(
        'Fallback', of('Fallback', cond('c1', 'F'), cond('c2', 'FS')), of('Fallback', act('a', 'RS'), act('b', 'RS'))),
        'ttt'),
    ('nested, the first action fails', of(
        'Fallback', of('Fallback', cond('c1', 'F'), cond('c2', 'F')), of('Fallback', act('a', 'RF'), act('b', 'RRS'))),
        'ttttt'),
    ('asynchronous', of('AsyncFallback', sync('A', 'F'), sync('B', 'F'), C), 'tttto'),
]  # fmt: skip

FOUR = cond('c1', 'S'), act('a1', 'RRS'), cond('c2', 'S'), act('a2', 'RRRS')
GOOD, BAD, SLOW = act('good', 'RRS'), act('bad', 'RF'), act('slow', 'RRRS')
PARALLELS: list[Row] = [
    *((f'thresholds {ports or "by default"}', of(f'Parallel {ports}', *FOUR), 'tttttt') for ports in (
        '', 'success_count="4"', 'success_count="3"', 'success_count="-2"', 'success_count="-1"', 'success_count="2"',
        'success_count="1" failure_count="-1"', 'success_count="0"', 'success_count="2" failure_count="2"')),
    *((f'nested, conditions {left} and {right}, failures {failures}', of(
        'Parallel success_count="2"',
        of('Parallel success_count="3"', cond('c1', left), act('a1', 'RRS'), cond('c2', left), act('a2', 'RRRS')),
        of(f'Parallel success_count="1" failure_count="{failures}"', cond('c3', right), act('a3', 'RS')),
    ), 'ttttt') for left, right, failures in (('S', 'S', 1), ('F', 'S', 1), ('S', 'F', 1), ('S', 'F', 2), ('SF', 'FS',
        2))),
    ('one success is enough', of('Parallel success_count="1" failure_count="3"', GOOD, BAD, SLOW), 'tttt'),
    ('all children are ticked, one failure', of('ParallelAll max_failures="1"', BAD, GOOD, SLOW), 'ttttt'),
    ('all children are ticked, two failures', of('ParallelAll max_failures="2"', BAD, GOOD, SLOW), 'ttttt'),
    ('a child that is skipped is not ticked', of(
        'Sequence', '<Script code="test := 1"/>',
        of('Parallel failure_count="1" success_count="-1"', sync('A', 'S', '_skipIf="test == 1"'), act('s', 'RS'))),
     'ttt'),
    ('sequences', of('Parallel success_count="2" failure_count="1"', *(
        of('Sequence', cond(f'c{n}', 'SF'), act(f'a{n}', 'RRS')) for n in '12')), 'tttt'),
    ('reactive sequences', of('Parallel success_count="2" failure_count="1"', *(
        of('ReactiveSequence', cond(f'c{n}', 'SSSSF'), act(f'a{n}', 'RRS')) for n in '12')), 'tttt'),
    ('paused by a retry', of('Parallel', of(
        'Sequence', act('s1', 'RRS'), '<Script code="paused := 0"/>', act('s2', 'RS')), of(
        'Sequence', '<Script code="paused := 1; done := 0"/>',
        '<RetryUntilSuccessful _while="paused" num_attempts="-1" _onHalted="done = 1"><AlwaysFailure/>'
        '</RetryUntilSuccessful>')), 'tttttttt'),
]  # fmt: skip

REACTIVE: list[Row] = [
    ('a synchronous and an asynchronous sequence', of(
        'ReactiveSequence', of('Sequence', A, B, C), of('AsyncSequence', *(sync(name) for name in 'DEF'))), 'tttt'),
    ('retries that skip', of(
        'Sequence', '<Script code="test := 0"/>', of(
            'ReactiveSequence',
            of('RetryUntilSuccessful name="r1" num_attempts="-1" _skipIf="test"', sync('A', 'S',
            '_onSuccess="test = 1"')),
            of('RetryUntilSuccessful name="r2" num_attempts="5"', '<AlwaysFailure/>'))), 'tttttttto'),
    ('two asynchronous children', of('ReactiveSequence', of('AsyncSequence', A, B), of('AsyncSequence', C)), 't'),
    ('the first child of a sequence fails', of('ReactiveSequence', sync('A', 'F'), act('b', 'R')), 'tt'),
    ('a condition changes, the action is halted', of('ReactiveSequence', cond('c', 'SF'), act('a', 'R')), 'ttt'),
    ('every tick evaluates', of('ReactiveSequence', cond('c', 'S'), act('a', 'RRRRS')), 'ttttt'),
    ('all children succeed', of('ReactiveSequence', A, B, C), 'tt'),
    ('the first child of a fallback succeeds', of('ReactiveFallback', A, act('b', 'R')), 'tt'),
    ('the second child of a fallback succeeds', of('ReactiveFallback', sync('A', 'F'), B, C), 'tt'),
    ('all children of a fallback fail', of('ReactiveFallback', *(sync(name, 'F') for name in 'ABC')), 'tt'),
    ('back-chaining: stay warm', of(
        'ReactiveFallback', cond('warm', 'FFFS'), of('ReactiveSequence', cond('jacket', 'SSS'), act('wear', 'RRS'))),
        'ttttt'),
    ('back-chaining: stay warm, and have a jacket', of(
        'ReactiveFallback', cond('warm', 'FFFFFS'), of('ReactiveSequence', of(
            'ReactiveFallback', cond('holding', 'FFFSS'), of('ReactiveSequence', cond('near', 'FFS'), act('grab',
            'RS'))),
            act('wear', 'RRS'))), 'tttttttt'),
    ('back-chaining: a condition is lost on the way', of(
        'ReactiveFallback', cond('warm', 'F'), of('ReactiveSequence', of(
            'ReactiveFallback', cond('holding', 'FSFS'), act('grab', 'RS')), act('wear', 'RRS'))), 'ttttttt'),
    ('conditions of a tree: first to false', of('Fallback', cond('c1', 'SF'), cond('c2', 'FS'), act('a', 'RS')), 'ttt'),
    ('navigation with recovery', of(
        'Fallback name="root"', of('Sequence', of('Fallback', cond('stuck', 'F'), sync('help', 'F')), act('move',
        'RRF')),
        of('Sequence', act('back', 'RS'), act('spin', 'RF'))), 'tttttth'),
]  # fmt: skip

DECORATORS: list[Row] = [
    ('retry, three failures', of('RetryUntilSuccessful num_attempts="3"', sync('A', 'F')), 'ttttt'),
    ('retry, a success resets', of('RetryUntilSuccessful num_attempts="3"', sync('A', 'FFSFFF')), 'tttttttt'),
    ('retry, tick once', of('RetryUntilSuccessful num_attempts="3"', sync('A', 'F')), 'oo'),
    ('repeat, a failure stops', of('Repeat num_cycles="3"', sync('A', 'SFSSS')), 'tttttt'),
    ('repeat of an action that takes time', of('Repeat num_cycles="3"', act('a', 'RS')), 'tttttttt'),
    ('repeat, tick once', of('Repeat num_cycles="3"', sync('A', 'S')), 'oo'),
    ('run once', of('Repeat num_cycles="5"', of('Sequence', of('RunOnce', A), B)), 'ttttttto'),
    ('run once, without skipping', of('Repeat num_cycles="5"', of('Sequence', of('RunOnce then_skip="false"', A), B)),
        'ooo'),
    *((f'{tag} of {script}', of(tag, sync('A', script)), 'tt')
      for tag in ('ForceFailure', 'ForceSuccess', 'Inverter') for script in 'SF'),
    ('inverter in a sequence', of('Sequence', of('Inverter', sync('A', 'F')), B), 'tt'),
    ('keep running until failure', of('KeepRunningUntilFailure', sync('A', 'SSF')), 'tttt'),
    ('retry below a timeout', of('Timeout msec="60000"', of('RetryUntilSuccessful num_attempts="-1"', act('a', 'RF'))),
        'tttth'),
]  # fmt: skip

BRANCHES: list[Row] = [
    *((f'{tag}, {title}', of(tag, *children), ops) for tag in ('IfThenElse', 'WhileDoElse') for title, children,
        ops in (
        ('then', (cond('c', 'S'), A, B), 'tt'),
        ('else', (cond('c', 'F'), A, B), 'tt'),
        ('else without one', (cond('c', 'F'), A), 'tt'),
        ('then fails', (cond('c', 'S'), sync('A', 'F'), B), 'tt'),
        ('else fails', (cond('c', 'F'), A, sync('B', 'F')), 'tt'),
        ('the condition takes time', (act('c', 'RRS'), A, B), 'ttt'),
        ('the condition changes, to else', (cond('c', 'SF'), act('a', 'R'), act('b', 'RS')), 'tttt'),
        ('the condition changes, to then', (cond('c', 'FS'), act('a', 'RS'), act('b', 'R')), 'tttt'),
        ('halt', (cond('c', 'SF'), act('a', 'R'), act('b', 'R')), 'thth'),
        ('one child', (cond('c', 'S'),), 't'),
        ('four children', (cond('c', 'S'), A, B, C), 't'),
    )),
    *((f'switch, {title}', of('Switch2 name="s" variable="{my_var}" case_1="1" case_2="42"', act('a', 'RRS'), act('b',
        'RRF'),
        act('c', 'RS')), ops) for title, ops in (
        ('default', ['unset my_var', 't', 't']), ('first', ['s 1', 't', 't', 't']), ('second', ['s 42', 't', 't', 't']),
        ('nothing', ['t', 't']), ('to default', ['s 1', 't', 's 0', 't', 't']), ('to second', ['s 1', 't', 's 42', 't',
            't', 't']),
        ('halt', ['s 1', 't', 'h', 't']))),
]  # fmt: skip

SKIPPING: list[Row] = [
    ('a tree that is one leaf', sync('A', 'KSKF'), 'ttthto'),
    ('a tree that is one condition', cond('c', 'KSKF'), 'ttthto'),
    ('a sequence', of('Sequence', '<Script code="A:=1"/>',
        sync('A', 'S', '_successIf="A==2" _failureIf="A!=1" _skipIf="A==1"'), B), 'o'),
    ('all', of('Sequence', sync('A', 'S', '_skipIf="A==1"'), sync('B', 'S', '_skipIf="A &lt; 2"'),
        sync('C', 'S', '_skipIf="A>0"')), 'oo', {'A': 1}),
    ('a sub-tree', of('Sequence', A, '<Script code=" data:=1 "/>', '<SubTree ID="Sub" _skipIf="data"/>') + '|Sub:' + B,
        'o'),
    ('the only child of a reactive sequence', of('ReactiveSequence', '<AlwaysSuccess _skipIf="flag"/>'), 'oo',
        {'flag': True}),
    *((f'in a reactive sequence, {value}', of('ReactiveSequence', f'<Script code=" value:={value} "/>',
        sync('A', 'S', '_skipIf="value &lt; 25"'), act('b', 'RRS')), 'oooooo') for value in (50, 10)),
    *((f'while {value}', of('Sequence', f'<Script code="doit:={value}"/>', of('Sequence', sync('A', 'S',
        '_while="doit"'))),
        'oo') for value in '10'),
    *((f'precondition of {title}', of('Sequence', f'<Script code="{code}"/>',
        of('Precondition if="A==B" else="FAILURE"', A), of('Precondition if="A==C" else="SUCCESS"', B),
        of('Precondition if="A!=C" else="FAILURE"', C)), 'o') for title, code in (
            ('integers', 'A:=1; B:=1; C:=3'), ('reals', 'A:=1.1; B:=(1.0+0.1); C:=2.0'),
            ('texts', "A:='hello'; B:='hello'; C:='world'"))),
    ('a precondition is checked once', of('Sequence', '<Script code="A:=0; B:=0"/>',
        of('Precondition if=" A==0 " else="FAILURE"',
        act('k', 'R', '_while="B==0"'))), ['o', 'i A 1', 'o', 'i B 1', 'o', 'o']),
    ('a precondition of a child that runs several times', of('Sequence', '<Script code="A:=0; B:=0; C:=1"/>', of(
        'Repeat num_cycles="3"', of('Sequence', of('Precondition if=" A==0 " else="SUCCESS"', A),
            act('k1', 'R', '_while="C==0"'), act('k2', 'R', '_while="B==0"')))),
     ['o', 'i A 1', 'i B 1', 'i C 0', 'o', 'i A 0', 'i C 1', 'o']),
    ('success and failure if', of('Sequence', '<Script code="A:=1"/>', sync('A', 'S', '_successIf="A==1"'),
        sync('B', 'S', '_successIf="A==2"'), of('Fallback', sync('C', 'S', '_failureIf="A==1"'),
            sync('D', 'S', '_failureIf="A!=1"'))), 'o'),
    ('a chain of runs', of('Sequence', sync('A', 'S', '_skipIf="A!=1"'), sync('B', 'S',
        '_skipIf="A!=2" _onSuccess="A=1"'),
        sync('C', 'S', '_skipIf="A!=3" _onSuccess="A=2"')), 'oooo', {'A': 3}),
    ('what runs is not skipped: a decorator', of('KeepRunningUntilFailure _skipIf="check == true"', '<AlwaysSuccess/>'),
     ['b check 0', 'o', 'b check 1', 'o']),
    ('what runs is not skipped: an action', act('k', 'R', '_skipIf="check==false"'),
     ['b check 0', 'o', 'b check 1', 'o', 'b check 0', 'o']),
    ('a precondition of a sub-tree is of the caller', of(
        'Sequence', sync('out', 'S', '_write="param:b:1"'), '<Script code="value:=1"/>',
        '<SubTree ID="Sub1" name="a" param="{param}"/><SubTree ID="Sub1" name="b" param="{value}"/>'
        '<SubTree ID="Sub1" name="c" param="true"/>', A)
     + '|Sub1:' + of('Sequence', '<SubTree ID="Sub2" _skipIf="param != 1"/>') + '|Sub2:' + B, 'o'),
    ('while halts, with a script', of('Sequence', act('k', 'R', '_while="A==1" _onHalted="B=69"')), ['o', 'i A 0', 'o',
        'o'],
     {'A': 1, 'B': 0}),
    ('skipped now and then', of('Sequence', '<AlwaysSuccess _skipIf="skip"/>'),
     ['b skip 1', 'o', 'b skip 0', 'o', 'b skip 1', 'o', 'b skip 0', 'o']),
    ('post-conditions', of('Sequence', '<Script code="A:=1; B:=1; C:=1; D:=1"/>', '<AlwaysSuccess _onSuccess="B=42"/>',
        of('ForceSuccess', '<AlwaysSuccess _failureIf="A!=0" _onFailure="C=42"/>'),
        of('ForceSuccess', '<AlwaysFailure _onFailure="D=42"/>')), 'o'),
    ('post-conditions in each round', of('Sequence', '<Script code="x:=0; y:=0"/>',
        of('RetryUntilSuccessful num_attempts="5"',
        '<AlwaysFailure _onFailure="x += 1" _post="y += 1"/>')), 'oo'),
    ('halted has a post-condition of its own', of('Sequence', "<Script code=\"test := 'start'\"/>", of(
        'Parallel failure_count="1" success_count="-1"', act('s', 'R',
        "_onHalted=\"test = 'halted'\" _post=\"test = 'post'\""),
        '<AlwaysFailure/>')), 'o'),
    *((f'{attribute} raises at an action that gives {status}', of('Sequence', A, sync('s', status,
        f'{attribute}="nope = 1"')), 'th') for status in 'RSF' for attribute in ('_post', '_onSuccess', '_onHalted')),
]  # fmt: skip

ENTRIES: list[Row] = [
    *((f'updates: {title}', of('Sequence', script, '<SubTree ID="Check" _autoremap="true"/>') + '|Check:' + of(
        'Sequence', of('Fallback', '<WasEntryUpdated entry="{value}"/>', sync('none')), of(
            'ForceSuccess', of('SkipUnlessUpdated entry="{value}"', sync('A')))), 'oo', board) for title, script,
            board in (
        ('no entry', A, {}), ('an entry that is there', B, {'value': 1}), ('once', '<Script code="value:=1"/>', {}),
        ('twice', of('Sequence', '<Script code="value:=1"/>', '<Script code="value:=2"/>'), {}))),
    ('loop over integers', of('LoopInt queue="1;2;3" value="{v}"', sync('A', 'S', '_read="v"')), 'ooooo'),
    ('loop over reals', of('LoopDouble queue="1.5;2" value="{v}"', sync('A', 'S', '_read="v"')), 'oooo'),
    ('loop over texts', of('LoopString queue="x;y" value="{v}"', sync('A', 'S', '_read="v"')), 'oooo'),
    ('loop over truths', of('LoopBool queue="true;false;1" value="{v}"', sync('A', 'S', '_read="v"')), 'ooooo'),
    *((f'empty loop, {status}', of(f'LoopInt queue="" if_empty="{status}" value="{{v}}"', A), 'o')
      for status in ('SUCCESS', 'FAILURE', 'SKIPPED')),
    ('a failure stops a loop', of('LoopInt queue="1;2;3;4;5" value="{v}"', sync('A', 'SSF')), 'oooooo'),
    ('an entry of text and a script', of('Sequence', '<SetBlackboard output_key="x" value="1"/>',
        '<Script code="x:=2"/>'), 'oo'),
    ('a chain of remaps', of('Sequence', '<SetBlackboard output_key="in" value="11"/>',
        '<SubTree ID="Sub" name="a" in="{in}" out="{mid}"/>', '<SubTree ID="Sub" name="b" in="{mid}" out="{out}"/>')
     + '|Sub:<Script code="out := in"/>', 'oo'),
    ('blanks in a pointer', of('Sequence', '<SetBlackboard output_key="v" value="3"/>',
        '<SetBlackboard output_key="w" value="{v} "/>'), 'oo'),
    ('text used as a number in a sub-tree', of('Sequence', '<SetBlackboard output_key="value" value="42"/>',
        '<SubTree ID="Sub" value="{value}"/>') + '|Sub:' + of(
            'Sequence', '<ScriptCondition code="value==42"/>', '<Script code="x := value + 1"/>'), 'oo'),
    ('the topmost blackboard from two levels', of('Sequence', '<SubTree ID="One"/>', '<ScriptCondition code="@a==1"/>',
        '<ScriptCondition code="b==2"/>') + '|One:' + of('Sequence', '<Script code="@a:=1"/>', '<SubTree ID="Two"/>')
     + '|Two:' + of('Sequence', '<ScriptCondition code="@a==1"/>', '<Script code="@b:=2; c:=3"/>'), 'o'),
    ('a name of a sub-tree that begins another', '<SubTree ID="MainABC"/>|MainABC:<AlwaysSuccess/>', 'o'),
    ('siblings with one remap', of('Sequence', "<Script code=\"p := 'hello'\"/>",
        '<SubTree ID="Sub" name="a" param="{p}"/>',
        "<Script code=\"p = 'world'\"/>", '<SubTree ID="Sub" name="b" param="{p}"/>')
     + '|Sub:' + sync('say', 'S', '_read="param"'), 'o'),
    *((f'remapping, {title}', of('Sequence', "<Script code=\"thoughts := 'hello'\"/>", f'<SubTree ID="Copy" {remap}/>',
        sync('say', 'S', '_read="greetings"')) + '|Copy:<SetBlackboard output_key="out_arg" value="{in_arg}"/>', 'o')
      for title, remap in (('good', 'in_arg="{thoughts}" out_arg="{greetings}"'), ('no input', 'out_arg="{greetings}"'),
                           ('no output', 'in_arg="{thoughts}"'))),
    ('remapped, a constant, and by itself', of('Sequence', "<Script code=\"mine := 'Hello'\"/>",
        '<SubTree ID="Sub" name="a" param="{mine}"/>', '<SubTree ID="Sub" name="b" param="World"/>',
        "<Script code=\"param := 'Auto'\"/>", '<SubTree ID="Sub" name="c" _autoremap="1"/>')
     + '|Sub:' + sync('say', 'S', '_read="param"'), 'o'),
    ('all three in one', of('Sequence', "<Script code=\"mine := 'Hello'; param3 := 'Auto'\"/>",
        '<SubTree ID="Sub" _autoremap="1" param1="{mine}" param2="Straight"/>')
     + '|Sub:' + sync('say', 'S', '_read="param1;param2;param3"'), 'o'),
    ('a script writes through a remap', of('Sequence', '<Script code="value:=0"/>',
        '<SubTree ID="Sub" value="{value}"/>')
     + '|Sub:<Script code="value:=1"/>', 'o'),
    ('by itself over four levels', of('Sequence', '<SetBlackboard output_key="message" value="hello world"/>',
        '<SubTree ID="T2" _autoremap="true"/>', sync('say', 'S', '_read="reply"'))
     + '|T2:<SubTree ID="T3" _autoremap="true"/>|T3:<SubTree ID="Talker" _autoremap="true"/>|Talker:'
     + of('Sequence', sync('talk', 'S', '_read="message"'), "<Script code=\"reply := 'done'\"/>"), 'o', {'ros': 'x'}),
    ('an entry of the host through four levels', '<SubTree ID="T2" ros="{ros}"/>|T2:<SubTree ID="T3" ros="{ros}"/>|T3:'
     '<SubTree ID="Talker" ros="{ros}"/>|Talker:' + sync('talk', 'S', '_read="ros"'), 'o', {'ros': 'x'}),
    ('an autoremap that is off and one that is on', of('Sequence',
        "<Script code=\"variable := 'test'; var := 'test'\"/>",
        '<SubTree ID="Inner" name="a" _autoremap="false" variable="{var}"/>',
        '<SubTree ID="Inner" name="b" _autoremap="true"/>')
     + '|Inner:' + of('Sequence', sync('A', 'S', "_skipIf=\"variable != 'test'\"")), 'o'),
    ('an entry made in a sub-tree', of('Sequence', '<SubTree ID="Init" test="{test}"/>', sync('check', 'S',
        '_read="test"'))
     + '|Init:<SetBlackboard output_key="test" value="true"/>', 'o'),
    ('constants and remaps through two levels', '<SubTree ID="S2" msg2="bar"/>|S1:' + sync('p', 'S',
        '_read="msg1;msg2"')
     + '|S2:' + of('Sequence', '<SubTree ID="S1" name="a" msg1="foo1" _autoremap="true"/>',
                   '<SubTree ID="S1" name="b" msg1="foo2" _autoremap="true"/>'), 'o'),
    ('private entries are not remapped', of('Sequence', '<SubTree ID="Sub" _autoremap="true"/>',
        sync('p', 'S', '_read="public_value;_private_value"')) + '|Sub:' + of('Sequence',
        '<SetBlackboard output_key="public_value" value="hello"/>',
        '<SetBlackboard output_key="_private_value" value="world"/>'),
     'o'),
    ('a script over several lines', '<Script code="a := 1;&#10; b := a + 1&#10;"/>', 'o'),
    ('a comparison with a negative number',
        '<Precondition if="A == -1" else="FAILURE"><AlwaysSuccess/></Precondition>', 'o',
     {'A': -1}),
    ('a truth of a leaf equals a number', of('Sequence', sync('w', 'S', '_write="flag:b:0"'),
        '<ScriptCondition code="flag == 0"/>', sync('A', 'S', '_skipIf="flag == 0"')), 'o'),
]  # fmt: skip

LOADING: list[Row] = [
    (title, body, 'o') for title, body in {
        'an unknown node': '<Nope/>', 'an empty tree': '', 'two roots': '<AlwaysSuccess/><AlwaysFailure/>',
        'an unknown sub-tree': '<SubTree ID="Nope"/>', 'a wrong port': '<AlwaysSuccess nope="1"/>',
        'a decorator without a child': '<Inverter/>', 'a control without children': '<Sequence/>',
        'a leaf with a child': of('AlwaysSuccess', '<AlwaysSuccess/>'),
        '50 deep': '<Inverter>' * 50 + A + '</Inverter>' * 50,
        'explicit forms': '<Control ID="Sequence"><Action ID="AlwaysSuccess"/><Decorator ID="Inverter">'
                          '<Condition ID="Cond"/></Decorator></Control>',
        'a sub-tree of the name of a node': A + '|Sync:<AlwaysSuccess/>',
        'trees in any order': '<SubTree ID="Z"/>|Z:<SubTree ID="B"/>|B:<AlwaysFailure/>',
        'a bad number in a port': '<Repeat num_cycles="three"><AlwaysSuccess/></Repeat>',
        'a bad script': '<Script code="a := "/>',
        'a literal for an output': '<LoopInt queue="1" value="x"><AlwaysSuccess/></LoopInt>',
    }.items()
]  # fmt: skip

THEMES = {
    'sequences': SEQUENCES, 'fallbacks': FALLBACKS, 'parallel': PARALLELS, 'reactive': REACTIVE,
        'decorators': DECORATORS,
    'branches': BRANCHES, 'skipping': SKIPPING, 'entries': ENTRIES, 'loading': LOADING,
}  # fmt: skip
