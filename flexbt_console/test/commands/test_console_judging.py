# SPDX-License-Identifier: BSD-3-Clause
"""What a person is asked to judge is shown, and no answer is sent to what is not: in every user interface."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from std_msgs.msg import Header

from flexbt_common.values.decision_subject import subject_message
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import parse
from flexbt_console.commands.registry import build
from flexbt_console.commands.spec import Show
from flexbt_console.errors import NotShownError, RefusedError, UsageError
from flexbt_console.link.messages import record_of
from flexbt_console.mirror.mirror import Mirror, Transit
from flexbt_console.mirror.records import (
    SYNTHESIZED,
    ActiveState,
    Behavior,
    BehaviorList,
    CommandKind,
    Decision,
    DecisionKind,
    DriveProgress,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    Peer,
    Subjects,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.json_form import map_json
from flexbt_console.present.maps import map_lines, where_text
from flexbt_console.present.rendering import behaviors_lines, status_lines
from flexbt_console.present.style import glyphs
from flexbt_console.ui.answers import Bound, choose, interpret
from flexbt_console.ui.line.toolbar import toolbar
from flexbt_console.ui.screen.decision_bar import decision_lines
from flexbt_console.ui.web.picture import parts_of
from flexbt_core.clock.clock import ManualClock
from flexbt_msgs.msg import DecisionSubjects

JUDGE = Decision(
    'r-1', DecisionKind.CHOICE, '/JudgePath', 'done', ('done', 'canceled'), subject=('path', 'goal'), subject_number=2
)
VALUE = Decision('i-1', DecisionKind.INPUT, '/AskHow', input_type='string', subject=('picture',), subject_number=1)
WHERE = Decision('i-2', DecisionKind.INPUT, '/AskGoal', input_type='geometry_msgs/msg/PoseStamped')
PLAN = ((0.0, 0.0), (9.0, 9.0))


def pose_at(x: float, y: float, frame: str = 'map') -> PoseStamped:
    pose = PoseStamped()
    pose.header.frame_id, pose.pose.position.x, pose.pose.position.y = frame, x, y
    return pose


def subjects(number: int = 2, **values: Any) -> Subjects:
    """Return what the decision is about, as it comes over the link."""
    shown = values or {'path': Path(poses=[pose_at(0.0, 0.0), pose_at(3.0, 4.0)]), 'goal': pose_at(5.0, 4.0)}
    message = DecisionSubjects(executive_id='e', subjects=[subject_message('r-1', number, shown)])
    return record_of(message)


@pytest.fixture
def mirror() -> Mirror:
    """Of a robot that drove along another path before."""
    mirror = Mirror(ManualClock(), {'kitchen': FramedPose(3.0, 4.0)})
    show(mirror, JUDGE)
    mirror.receive_plan(PLAN)
    return mirror


def show(mirror: Mirror, *decisions: Decision, **more: Any) -> None:
    before = mirror.view().snapshot
    snapshot = ExecutiveSnapshot(
        'e', before.sequence + 1 if before else 1, state=ExecutiveState.RUNNING, run_id='r', decisions=decisions
    )
    mirror.receive_snapshot(replace(snapshot, **more), Transit(0.0, 0.0))


def told_everywhere(view: View) -> dict[str, str]:
    """Return the text of the decision, by user interface."""
    page = parts_of(view, 'ann')['decisions'][0]
    return {
        'line mode': '\n'.join(status_lines(view)),
        'map': '\n'.join(map_lines(view, (60, 20))),
        'prompt': '\n'.join(text for _, text in toolbar(view, 80, 24)),
        'screen': '\n'.join(decision_lines(view, '', 80, glyphs())),
        'page': '\n'.join(page['reasons']),
    }


def test_until_the_path_has_come_no_other_one_is_drawn_and_that_is_told(mirror: Mirror) -> None:
    view = mirror.view()
    for where, told in told_everywhere(view).items():
        assert 'path, goal NOT RECEIVED' in told, where
    assert (view.drawn.plan, view.drawn.goal, view.surroundings.plan) == ((), None, PLAN)
    assert map_json(view)['plan'] == () and map_json(view)['lacks'] == 'path, goal'
    page = parts_of(view, 'ann')['decisions'][0]
    assert (page['lacks'], page['drawn']) == ('path, goal', {'plan': [], 'goal': None})


def test_what_has_come_is_drawn_in_the_place_of_the_plan(mirror: Mirror) -> None:
    mirror.receive_subjects(subjects())
    view = mirror.view()
    assert (view.drawn.plan, view.drawn.goal) == (((0.0, 0.0), (3.0, 4.0)), (5.0, 4.0))
    for where, told in told_everywhere(view).items():
        assert 'NOT RECEIVED' not in told, where
        assert ('plan 5.0 m' if where == 'map' else 'path: 5.0 m to kitchen; goal: x 5.00 y 4.00') in told, where
    page = parts_of(view, 'ann')['decisions'][0]
    assert page['drawn'] == {'plan': [[0.0, 0.0], [3.0, 4.0]], 'goal': (5.0, 4.0)} and page['lacks'] == ''
    show(mirror)  # it is answered: the robot drives
    assert mirror.view().drawn.plan == PLAN


@pytest.mark.parametrize('frame', ['base_link', 'odom'])
def test_what_is_in_another_frame_is_told_with_it_and_not_drawn(mirror: Mirror, frame: str) -> None:
    goal = pose_at(3.0, 4.0, frame)
    path = Path(header=Header(frame_id=frame), poses=[pose_at(0.0, 0.0), pose_at(3.0, 4.0)])
    told = f'path: 5.0 m to x 3.00 y 4.00 in {frame}; goal: x 3.00 y 4.00 in {frame}'
    for one in (path, [pose_at(0.0, 0.0, frame), goal]):
        mirror.receive_subjects(subjects(path=one, goal=goal))
        view = mirror.view()
        assert (view.drawn.plan, view.drawn.goal) == ((), None)
        assert told in '\n'.join(status_lines(view))
    show(mirror, JUDGE, robot_pose=FramedPose(0.0, 0.0, frame=frame))  # of a robot without a map
    assert (mirror.view().drawn.plan, mirror.view().drawn.goal) == (((0.0, 0.0), (3.0, 4.0)), (3.0, 4.0))


@pytest.mark.parametrize(
    'subjects',
    [subjects(number=1), replace(subjects(), executive_id='before')],
    ids=['of a value before', 'of another'],
)
def test_what_belongs_to_something_else_counts_for_nothing(mirror: Mirror, subjects: Subjects) -> None:
    mirror.receive_subjects(subjects)
    assert mirror.view().lacks(JUDGE) == 'path, goal'


@pytest.mark.parametrize(
    'asked', [WHERE, replace(JUDGE, subject_number=0), replace(JUDGE, subject=('charge',))], ids=lambda one: one.id
)
def test_a_plan_that_is_not_what_is_asked_about_is_drawn_only_while_it_is_followed(
    mirror: Mirror, asked: Decision
) -> None:
    mirror.receive_subjects(subjects(charge=0.5))
    show(mirror, asked)
    view = mirror.view()
    assert (view.drawn.plan, view.drawn.goal, view.surroundings.plan) == ((), None, PLAN)
    assert 'plan' not in told_everywhere(view)['map'] and map_json(view)['plan'] == ()
    assert parts_of(view, 'ann')['decisions'][0]['drawn'] == {'plan': [], 'goal': None}
    show(mirror, asked, active_states=(ActiveState('/Drive', progress=DriveProgress(distance=3.0)),))
    assert mirror.view().drawn.plan == PLAN
    assert parts_of(mirror.view(), 'ann')['decisions'][0]['drawn'] is None  # it would be sent with each new plan


def test_what_is_not_drawn_is_told(mirror: Mirror) -> None:
    mirror.receive_subjects(subjects(charge=0.5, note='a\x1b[2J\nb'))
    view = mirror.view()
    assert 'about charge: 0.5; note: ' in '\n'.join(status_lines(view))
    assert '\x1b' not in '\n'.join(status_lines(view))


def test_a_path_without_poses_is_no_other_path(mirror: Mirror) -> None:
    mirror.receive_subjects(subjects(path=Path()))
    view = mirror.view()
    assert (view.drawn.plan, view.drawn.goal) == ((), None)
    assert 'about path: no poses' in '\n'.join(status_lines(view))


def test_a_path_without_place_and_a_type_that_is_not_installed_are_told() -> None:
    nowhere = subjects(path=Path(poses=[pose_at(float('nan'), 0.0), pose_at(0.0, 0.0)])).subjects[0]
    assert (nowhere.values[0].points, nowhere.values[0].text) == ((), 'it has a point that is nowhere')
    message = DecisionSubjects(executive_id='e', subjects=[subject_message('r-1', 2, {'goal': pose_at(0.0, 0.0)})])
    message.subjects[0].entries[0].type = 'robot_msgs/msg/Picture'
    unknown = record_of(message).subjects[0].values[0]
    assert (unknown.pose, unknown.type) == (None, 'robot_msgs/msg/Picture') and unknown.text


Answer = Callable[[View, CommandBuilder, bool], Any]
ANSWERS: dict[str, Answer] = {
    'confirm': lambda view, make, unseen: line(f'confirm{" --unseen" if unseen else ""}', view, make),
    'confirm ID': lambda view, make, unseen: line(f'confirm r-1{" --unseen" if unseen else ""}', view, make),
    'force': lambda view, make, unseen: line(f'force canceled{" --unseen" if unseen else ""}', view, make),
    'typed confirm': lambda view, make, unseen: typed(f'confirm{" --unseen" if unseen else ""}', view, make),
    'typed force': lambda view, make, unseen: typed(f'force done{" --unseen" if unseen else ""}', view, make),
    'picked': lambda view, make, unseen: choose('done', view, make, JUDGE, unseen=unseen).command,
    'picked other': lambda view, make, unseen: choose('canceled', view, make, JUDGE, unseen=unseen).command,
}


def line(text: str, view: View, make: CommandBuilder) -> Any:
    return build(parse(shlex.split(text)), view, make)


def typed(text: str, view: View, make: CommandBuilder) -> Any:
    return interpret(text, view, make, Bound('r-1')).command


@pytest.mark.parametrize('way', ANSWERS)
def test_no_answer_goes_to_what_is_not_shown_unless_the_operator_insists(mirror: Mirror, way: str) -> None:
    make, give = CommandBuilder('ann'), ANSWERS[way]
    with pytest.raises(NotShownError, match=r'\(path, goal\); nothing was sent.* --unseen'):
        give(mirror.view(), make, False)
    assert give(mirror.view(), make, True).kind in (CommandKind.CONFIRM, CommandKind.FORCE)
    mirror.receive_subjects(subjects())
    assert give(mirror.view(), make, False).kind in (CommandKind.CONFIRM, CommandKind.FORCE)


def test_a_value_is_not_given_for_what_is_not_shown(mirror: Mirror) -> None:
    show(mirror, VALUE)
    make = CommandBuilder('ann')
    with pytest.raises(NotShownError, match='picture'):
        line('input red', mirror.view(), make)
    assert line('input --unseen red', mirror.view(), make).kind is CommandKind.ANSWER
    assert line('decline', mirror.view(), make).kind is CommandKind.DECLINE  # it judges nothing


@pytest.mark.parametrize('is_prompt', [False, True], ids=['line mode', 'prompt'])
def test_an_answer_that_names_a_request_never_goes_to_another_one(mirror: Mirror, is_prompt: bool) -> None:
    other = Decision('i-3', DecisionKind.INPUT, '/AskName', input_type='string')
    show(mirror, other, replace(other, id='i-4'))
    make = CommandBuilder('ann')

    def given(text: str) -> Any:
        view = mirror.view()
        return interpret(text, view, make, Bound('i-3')).command if is_prompt else line(text, view, make)

    assert (given('input i-4 stay away').decision_id, given('input i-4 --decline').decision_id) == ('i-4', 'i-4')
    with pytest.raises(UsageError, match='usage: input'):
        given('input i-4')
    show(mirror, other)  # the other one is withdrawn
    for text in ('input i-4 stay away', 'input i-4', 'input i-4 --decline', 'decline i-4', 'input --decision i-4 stay'):
        with pytest.raises(RefusedError, match="'i-4' is not pending"):
            given(text)
    for text in ('stay away', 'i-am away', 'i-', '1 2 3', '"i-4 is gone"', '--decision i-3 i-4 is gone'):
        answer = given(f'input {text}')
        told = text.removeprefix('--decision i-3 ').strip('"')
        assert (answer.decision_id, answer.inputs[0].text) == ('i-3', f'"{told}"')


MACHINE = '# look\nmachine:\n  outcomes: [finished]\n'


@pytest.mark.parametrize('word', ['start', 'switch', 'queue add'])
def test_a_machine_that_was_synthesized_is_shown_before_it_is_started(mirror: Mirror, word: str) -> None:
    make, kind = CommandBuilder('ann'), CommandKind[word.upper().replace(' ', '_')]
    for known, why in (
        (None, 'the robot has not sent its list of behaviors'),
        (Behavior('Look there', SYNTHESIZED), "'Look there' was synthesized, and its machine was not received"),
    ):
        if known is not None:
            mirror.receive_behaviors(BehaviorList('e', (known, Behavior('Patrol', 'demo'))))
            assert 'machine NOT RECEIVED' in '\n'.join(behaviors_lines((known,)))
            assert parts_of(mirror.view(), 'ann')['behaviors'][0]['lacks_machine']
            assert line(f'{word} Patrol', mirror.view(), make).kind is kind
        for give in (line, typed):
            with pytest.raises(NotShownError, match=f'{why}.*nothing was sent.* --unseen'):
                give(f'{word} Look there', mirror.view(), make)
            assert give(f'{word} Look there --unseen', mirror.view(), make).kind is kind
    made = Behavior('Look there', SYNTHESIZED, machine=MACHINE)
    mirror.receive_behaviors(BehaviorList('e', (made,)))
    assert line(f'{word} Look there', mirror.view(), make).kind is kind
    assert parts_of(mirror.view(), 'ann')['behaviors'][0]['machine'] == MACHINE.rstrip()
    one = parse(['behaviors', 'Look', 'there'])
    assert isinstance(one.spec.action, Show)
    assert one.spec.action.show(one, mirror.view(), mirror).text[1:] == [f'    {row}' for row in MACHINE.splitlines()]
    assert behaviors_lines((made,))[1:] == ['    machine of 3 lines: behaviors Look there']


def test_short_answers_at_the_prompt_are_refused_with_what_to_type(mirror: Mirror) -> None:
    for text in ('1', 'done', 'canceled'):
        with pytest.raises(NotShownError, match='--unseen'):
            typed(text, mirror.view(), CommandBuilder('ann'))


def test_a_pose_that_nobody_tells_is_unknown_and_what_that_means_is_told(mirror: Mirror) -> None:
    show(mirror, pose_problem='nobody publishes /pose')
    view = mirror.view()
    text = 'pose unknown: nobody publishes /pose; motion is not watched'
    assert text in where_text(view)
    assert f'robot     {text}' in status_lines(view)
    assert any(text in row for _, row in toolbar(view, 80, 24))
    assert parts_of(view, 'ann')['where'] == text
    show(mirror, robot_pose=FramedPose(1.0, 2.0), pose_problem='nobody publishes /pose any more')
    assert 'pose old: nobody publishes /pose any more' in where_text(mirror.view())


def test_a_node_that_nobody_expects_is_not_missed(mirror: Mirror) -> None:
    unexpected = Peer('/simulator', False, ready=False, problem='it was not seen yet; start it', expected=False)
    show(mirror, peers=(unexpected, Peer('/bt_server', True)))
    view = mirror.view()
    assert view.snapshot is not None and view.snapshot.missed_peers == ()
    told = '\n'.join(status_lines(view))
    assert '/simulator not seen' in told and 'MISSING' not in told
    show(mirror, peers=(replace(unexpected, expected=True),))
    assert '/simulator not found: it was not seen yet; start it' in '\n'.join(status_lines(mirror.view()))
