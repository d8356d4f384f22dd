# SPDX-License-Identifier: BSD-3-Clause
"""The debugger of trees as people see it, and the commands that its lines mean."""

from __future__ import annotations

import shlex
from dataclasses import replace

import pytest

from flexbt_console.commands import effects
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import check, parse
from flexbt_console.commands.completion import candidates
from flexbt_console.commands.registry import build
from flexbt_console.commands.spec import Send
from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import (
    BreakpointKind,
    CommandKind,
    ExecutiveSnapshot,
    OperatorCommand,
    TreeBreakpoint,
    TreeHold,
)
from flexbt_console.mirror.trees import MirroredNode, MirroredNodeKind, MirroredStatus, MirroredTree
from flexbt_console.mirror.view import View
from flexbt_console.present.debugging import (
    breakpoint_lines,
    breakpoint_summary,
    debug_lines,
    held_lines,
    marks_of_nodes,
    why_lines,
)
from flexbt_console.present.style import glyphs
from flexbt_console.present.tree_lines import tree_lines
from flexbt_console.ui.keys import KEYS
from flexbt_console.ui.line.toolbar import toolbar

IDLE, RUNNING, SUCCESS, FAILURE = list(MirroredStatus)[:4]
HOLD = TreeHold('r1', 'Main', 'Drive/turn', 'ann', 90.0, 'breakpoint', ('Drive/other: it cannot',))
SNAPSHOT = ExecutiveSnapshot('e1', 1, stamp=100.0)
HELD = replace(SNAPSHOT, tree_holds=(HOLD,), tree_breakpoints=(
    TreeBreakpoint(BreakpointKind.BREAK, 'Main', 'Drive/turn', 'x > 1', operator='ann', stamp=80.0, hits=2),
    TreeBreakpoint(BreakpointKind.DUMMY, 'Main', 'wait', status=2, operator='bob', problem='no node\x1b[2J'),
))  # fmt: skip


def view_of(snapshot: ExecutiveSnapshot, *trees: MirroredTree) -> View:
    return View(LinkState.LIVE, 0.0, snapshot=snapshot, trees=trees)


def tree_of(*nodes: tuple[int, str, str, MirroredStatus, MirroredStatus]) -> MirroredTree:
    """Of parent, name, registration, status, and how it ended before."""
    kinds = {'Sequence': MirroredNodeKind.CONTROL, 'Fallback': MirroredNodeKind.CONTROL}
    made = [
        MirroredNode(uid, parent, name, registration, name, kinds.get(registration, MirroredNodeKind.ACTION))
        for uid, (parent, name, registration, _, _) in enumerate(nodes, 1)
    ]
    return MirroredTree(
        'r1', 'Main', tuple(made), tuple(one[3] for one in nodes), tuple(one[4] for one in nodes),
        (90.0,) * len(nodes), stamp=100.0, sequence=1,
    )  # fmt: skip


def command(text: str, view: View) -> OperatorCommand:
    line = parse(text.split())
    check(line)
    return build(line, view, CommandBuilder('ann'))


def test_what_is_held_is_shown_everywhere_with_who_and_since_when() -> None:
    (held,) = held_lines(HELD)
    assert 'tree Main HELD before Drive/turn for 10 s (breakpoint of ann)' in held
    assert '"tree continue" goes on; still active: Drive/other: it cannot' in held
    told = breakpoint_lines(HELD)
    assert 'break before Drive/turn if x > 1 (set by ann' in told[0] and '2 hits' in told[0]
    assert 'wait is a dummy: SUCCESS' in told[1] and 'no node\\e[2J' in told[1]
    (summary,) = breakpoint_summary(HELD)
    assert summary.startswith('2 breakpoints in trees')
    status = effects.status(parse(['status']), view_of(HELD), None).text  # type: ignore[arg-type]
    assert (
        any(line.startswith('held ') for line in status) and sum(line.startswith('debugged ') for line in status) == 2
    )
    shown = ' '.join(text for _, text in toolbar(view_of(HELD), 120, 12))
    assert 'HELD before Drive/turn' in shown and '2 breakpoints' in shown
    assert not held_lines(SNAPSHOT) and not breakpoint_summary(SNAPSHOT) and not breakpoint_lines(SNAPSHOT)


def test_lines_mean_commands_for_the_tree_that_is_shown_as_held() -> None:
    held = view_of(HELD)
    stepped = command('tree step', held)
    assert (stepped.kind, stepped.tree_run_id) == (CommandKind.TREE_STEP, 'r1@90000000')
    paused = replace(HELD, tree_holds=(replace(HOLD, path=''),))
    assert command('tree step', view_of(paused)).tree_run_id == 'r1'  # of several steps each is meant
    assert command('tree run-to turn --if x>2', held).text == 'x>2'
    forced = command('tree force turn failure', view_of(SNAPSHOT))
    assert (forced.kind, forced.path, forced.outcome) == (CommandKind.TREE_FORCE, 'turn', 'FAILURE')
    set_at = command('break turn --tree Main', view_of(SNAPSHOT))
    assert (set_at.kind, set_at.behavior, set_at.path) == (CommandKind.TREE_BREAK, 'Main', 'turn')
    assert command('tree clear', view_of(SNAPSHOT)).kind is CommandKind.TREE_CLEAR
    changed = command('tree set speed:=0.5 --at turn', held)
    assert (changed.kind, changed.text, changed.path) == (CommandKind.TREE_SET, 'speed:=0.5', 'turn')
    with pytest.raises(RefusedError, match='no tree is held'):
        command('tree continue', view_of(SNAPSHOT))
    two = replace(HELD, tree_holds=(HOLD, replace(HOLD, run_id='r2')))
    with pytest.raises(RefusedError, match=r'several trees are held.*r1.*r2'):
        command('tree continue', view_of(two))
    assert command('tree continue --run r2', view_of(two)).tree_run_id == 'r2@90000000'
    assert command('tree continue --run r3', view_of(two)).tree_run_id == 'r3'


@pytest.mark.parametrize('text', ['tree force turn', 'tree force turn RUNNING', 'break', 'tree stepp', 'step under'])
def test_what_is_written_wrong_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        command(text, view_of(HELD))


def test_second_words_and_nodes_are_completed() -> None:
    tree = tree_of((0, 'all', 'Sequence', RUNNING, IDLE), (1, 'turn', 'Spin', RUNNING, IDLE))
    view = view_of(HELD, tree)
    assert candidates('tree st', view) == ['step']
    assert candidates('tree force t', view) == ['turn']
    assert candidates('tree force turn F', view) == ['FAILURE']
    assert candidates('tree clear ', view)[:1] == ['Drive/turn']
    assert candidates('step o', view) == ['over', 'out']


def test_why_names_the_decision_that_keeps_a_node_from_running() -> None:
    tree = tree_of(
        (0, 'Main', 'Sequence', RUNNING, IDLE),
        (1, 'Drive', 'Fallback', RUNNING, IDLE),
        (2, 'Follow', 'FollowPath', RUNNING, IDLE),
        (2, 'Spin', 'Spin', IDLE, FAILURE),
        (1, 'last', 'Wait', IDLE, IDLE),
    )
    assert why_lines(tree, 4, SNAPSHOT) == [
        'Spin is not running: it had ended by FAILURE, and has been idle for 10 s',
        '  Main (Sequence) runs Drive, child 1 of 2',
        '    Drive (Fallback) runs Follow (child 1 of 2); Spin (child 2 of 2): it had ended by FAILURE, '
        'and has been idle for 10 s',
    ]
    assert why_lines(tree, 5, None)[1:] == [
        '  Main (Sequence) runs Drive (child 1 of 2); last (child 2 of 2): idle for 10 s, without a result in this run'
    ]
    assert why_lines(tree, 3, None)[0] == 'Follow is running, for 10 s'
    assert 'HELD before' in why_lines(tree, 5, HELD)[1]
    assert 'has ended' in why_lines(replace(tree, finished=True), 5, None)[1]
    assert any('gone' in line for line in why_lines(replace(tree, gone_at=1.0), 5, None))


def test_a_ring_of_nodes_ends() -> None:
    tree = tree_of((2, 'a', 'Sequence', RUNNING, IDLE), (1, 'b', 'Sequence', IDLE, IDLE))
    assert why_lines(tree, 1, None) and why_lines(tree, 2, None)


def test_marks_stay_among_the_lines_of_a_tree_that_does_not_fit() -> None:
    rows = [(0, 'all', 'Sequence', RUNNING, IDLE), *((1, f'n{n}', 'Wait', IDLE, IDLE) for n in range(100))]
    tree = tree_of(*rows)
    point = TreeBreakpoint(BreakpointKind.BREAK, 'Main', 'n77')
    held = replace(SNAPSHOT, tree_breakpoints=(point,), tree_holds=(replace(HOLD, path='n77'),))
    lines = tree_lines(tree, 60, 8, glyphs(), marks_of_nodes(held, tree))
    assert len(lines) <= 8
    assert any('n77' in line and 'HELD HERE  breakpoint' in line for line in lines)
    assert marks_of_nodes(held, replace(tree, tree='Other', run_id='r9')) == {}


def test_keys_step_and_go_on_where_something_is_held_and_offer_what_can_be_typed() -> None:
    by_action = {key.action: key for key in KEYS}
    step, going = by_action['tree_step'], by_action['tree_continue']
    held, free = view_of(HELD), view_of(SNAPSHOT)
    assert step.blocked(free) and going.blocked(free) and by_action['debug'].blocked(free)
    assert not step.blocked(held) and step.needs(held, 'ann') and not step.needs(free, 'ann')
    for key in (step, going):
        assert key.lines is not None
        (line,) = key.lines(held, 'ann')
        assert command(line, held).tree_run_id == 'r1@90000000'
    tree = tree_of((0, 'all of it', 'Sequence', RUNNING, IDLE))
    lines = debug_lines(tree, tree.nodes[0], has_marks=True)
    assert not by_action['debug'].blocked(view_of(SNAPSHOT, tree))
    commands = []
    for line in lines.values():
        parsed = parse(shlex.split(line))
        check(parsed)
        if isinstance(parsed.spec.action, Send):
            commands.append(build(parsed, held, CommandBuilder('ann')))
    assert [one.path for one in commands] == ['all of it'] * 7
    assert {one.tree_run_id.partition('@')[0] for one in commands} == {'r1'}
