# SPDX-License-Identifier: BSD-3-Clause
"""From what the operator wants and sees to the command, and what is refused before it is sent."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from flexbt_console.commands import registry
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.commands.command_line import parse
from flexbt_console.commands.operator_values import full_namespace, load_places, start_input, value_text
from flexbt_console.errors import RefusedError, UsageError
from flexbt_console.link.messages import command_message
from flexbt_console.mirror.freshness import LinkState
from flexbt_console.mirror.records import (
    ActiveState,
    AutonomyLevel,
    Behavior,
    BehaviorParameter,
    CommandKind,
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    StateKind,
    StateStructure,
    Structure,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.queue import options_texts
from flexbt_console.present.rendering import decision_line, status_lines, structure_lines
from flexbt_testing.hostile_yaml import HOSTILE_YAML

POSE = 'geometry_msgs/msg/PoseStamped'
TRANSITION = Decision('t1', DecisionKind.TRANSITION, '/Nav/Plan', 'done', ('done', 'failed'), 2)
INPUT = Decision('i1', DecisionKind.INPUT, '/Ask', input_type=POSE)
CHOICE = Decision('c1', DecisionKind.CHOICE, '/Choose', '', ('left', 'right'))
STRUCTURE = Structure(
    'r1',
    'Drive',
    (
        StateStructure('/', StateKind.MACHINE, outcomes=('finished',)),
        StateStructure('/Nav', StateKind.MACHINE, outcomes=('done', 'failed')),
        StateStructure('/Nav/Plan', outcomes=('done', 'failed')),
    ),
)
BEHAVIORS = (
    Behavior('Drive', parameters=(BehaviorParameter('speed', choices=('slow', 'fast')), BehaviorParameter('n'))),
    Behavior('Legs', parameters=(BehaviorParameter('legs', 'list', '[]'), BehaviorParameter('stops', 'dict', '{}'))),
    Behavior('Broken', error='no tree'),
)


@pytest.mark.parametrize(
    'when', ['after=9999-12-31T23:59', 'after=1900-01-01T00:00', 'after=+11000d', 'near=kitchen:1e300', 'near=hall:1e7']
)
def test_what_no_message_has_room_for_is_no_condition_of_the_queue(when: str) -> None:
    now = view()
    assert now.snapshot is not None
    shown = replace(now, snapshot=replace(now.snapshot, stamp=1.7e9))
    line = parse(['queue', 'add', 'Drive', '--when', when])
    with pytest.raises(UsageError, match='expected'):
        registry.build(line, shown, CommandBuilder('ann'))


@pytest.mark.parametrize('when', ['after=2037-12-31T23:59', 'after=1970-01-03T00:00', 'after=+3000d', 'near=hall:9e5'])
def test_a_condition_of_the_queue_can_be_sent(when: str) -> None:
    now = view()
    assert now.snapshot is not None
    shown = replace(now, snapshot=replace(now.snapshot, stamp=1.7e9))
    command = registry.build(parse(['queue', 'add', 'Drive', '--when', when]), shown, CommandBuilder('ann'))
    assert len(command_message(command, 0.0).queue_options) == 1


@pytest.mark.parametrize('moment', ['2030-01-31T08:00:00', '2030-07-31T23:59:59'])
def test_a_time_that_an_entry_of_the_queue_waits_for_is_shown_as_it_is_written(moment: str) -> None:
    line = parse(['queue', 'add', 'Drive', '--when', f'after={moment}'])
    (options,) = registry.build(line, view(), CommandBuilder('ann')).queue_options
    assert options_texts(options) == [f'after {moment}']
    assert options_texts(replace(options, not_before=120.0)) == ['after 120 s']


def view(*decisions: Decision, active: tuple[str, ...] = ('/Nav/Plan',), autonomy: int = 1) -> View:
    states = tuple(ActiveState(path) for path in active)
    snapshot = ExecutiveSnapshot(
        'e', 1, state=ExecutiveState.RUNNING, run_id='r1', active_states=states, decisions=decisions, autonomy=autonomy
    )
    places = {'kitchen': FramedPose(1.0, 2.0, 0.5), 'hall': FramedPose(3.0, 4.0)}
    return View(LinkState.LIVE, 0.1, '', snapshot, STRUCTURE, BEHAVIORS, places=places)


@pytest.fixture
def make() -> CommandBuilder:
    return CommandBuilder('ann')


def test_every_command_names_operator_run_and_a_new_id(make: CommandBuilder) -> None:
    commands = [
        make.command(view(), CommandKind.STOP),
        make.confirm(view(TRANSITION)),
        make.force(view(), '', 'failed'),
        make.answer(view(INPUT), '', 'kitchen'),
        make.decline(view(INPUT)),
        make.autonomy(view(), AutonomyLevel.FULL),
    ]
    assert {(command.operator, command.run_id) for command in commands} == {('ann', 'r1')}
    assert len({command.id for command in commands}) == len(commands)


def test_confirm_takes_the_only_decision_and_lists_several(make: CommandBuilder) -> None:
    assert make.confirm(view(TRANSITION)).decision_id == 't1'
    with pytest.raises(RefusedError, match=r't1 \(/Nav/Plan: done\), c1'):
        make.confirm(view(TRANSITION, CHOICE))
    with pytest.raises(RefusedError, match='no decision is pending'):
        make.confirm(view())
    with pytest.raises(RefusedError, match='input VALUE'):
        make.confirm(view(INPUT))
    with pytest.raises(RefusedError, match='left, right'):
        make.confirm(view(CHOICE))
    # One that is not known here is for the executive to refuse.
    assert make.confirm(view(TRANSITION), 'old').decision_id == 'old'


def test_choosing_the_wanted_outcome_confirms_and_another_forces(make: CommandBuilder) -> None:
    confirmed = make.choose(view(TRANSITION), TRANSITION, 'done')
    assert (confirmed.kind, confirmed.decision_id) == (CommandKind.CONFIRM, 't1')
    forced = make.choose(view(TRANSITION), TRANSITION, 'failed')
    assert (forced.kind, forced.path, forced.outcome, forced.decision_id) == (
        CommandKind.FORCE, '/Nav/Plan', 'failed', 't1',
    )  # fmt: skip
    with pytest.raises(RefusedError, match='done, failed'):
        make.choose(view(TRANSITION), TRANSITION, 'x')


def test_a_container_may_be_left_though_all_in_it_has_ended(make: CommandBuilder) -> None:
    """It may wait for the operator, or be locked; only the executive knows the latter."""
    waiting = Decision('t2', DecisionKind.TRANSITION, '/Nav', 'done', ('done', 'failed'), 3)
    command = make.force(view(waiting, active=()), 'Nav', 'failed')
    assert (command.path, command.decision_id) == ('/Nav', 't2')
    assert make.repeat(view(waiting, active=()), '/Nav').path == '/Nav'
    assert make.force(view(active=()), '/Nav', 'failed').path == '/Nav'
    assert any(line.startswith('>   Nav') for line in structure_lines(STRUCTURE, view(waiting, active=())))


def test_force_finds_the_state(make: CommandBuilder) -> None:
    assert make.force(view(), '', 'done').path == '/Nav/Plan'
    assert make.force(view(), 'Plan', 'done').path == '/Nav/Plan'
    assert make.force(view(), 'Nav', 'done').path == '/Nav'
    assert make.force(view(TRANSITION), '', 'failed').decision_id == 't1'
    assert make.force(view(TRANSITION), '/Nav', 'failed').decision_id == ''
    with pytest.raises(RefusedError, match='no state'):
        make.force(view(), '/Other', 'done')
    with pytest.raises(RefusedError, match='not active; active: none'):
        make.force(view(active=()), '/Nav/Plan', 'done')
    with pytest.raises(RefusedError, match="no outcome 'gone'; choose one of done, failed"):
        make.force(view(), '', 'gone')
    with pytest.raises(RefusedError, match='/A, /B'):
        make.force(view(active=('/A', '/B')), '', 'done')
    with pytest.raises(RefusedError, match='not unique'):
        make.force(view(active=('/A/X', '/B/X')), 'X', 'done')
    with pytest.raises(RefusedError, match='not pending'):
        make.force(view(), '', 'done', 'old')


def test_start_is_checked_against_the_list_of_behaviors(make: CommandBuilder) -> None:
    command = make.start(view(), 'Drive', [('speed', 'slow')], AutonomyLevel.HIGH)
    assert (command.behavior, command.arguments, command.autonomy) == ('Drive', (('speed', 'slow'),), 2)
    for name, arguments, message in (
        ('Driv', [], "did you mean 'Drive'"),
        ('Broken', [], 'no tree'),
        ('Drive', [('sped', 'slow')], 'its parameters: speed, n'),
        ('Drive', [('speed', 'mad')], 'slow, fast'),
    ):
        with pytest.raises(RefusedError, match=message):
            make.start(view(), name, arguments)


def test_what_is_typed_for_a_list_or_mapping_is_checked(make: CommandBuilder) -> None:
    arguments = [('legs', '[1, [2, a]]'), ('stops', '{home: 1}')]
    assert list(make.start(view(), 'Legs', arguments).arguments) == arguments
    for name, text, message in (
        ('legs', '{a: 1}', r"'legs': '{a: 1}' is not a valid list; expected YAML such as \[1, 2\]"),
        ('stops', '{home', "'stops': '{home' is not a valid dict: line 1: no YAML.*; expected YAML such as {name: 1}"),
        ('stops', '', "'stops': '' is not a valid dict"),
    ):
        with pytest.raises(RefusedError, match=message):
            make.start(view(), 'Legs', [(name, text)])


def test_a_whole_number_may_be_larger_than_any_float(make: CommandBuilder) -> None:
    known = Behavior('Count', parameters=(BehaviorParameter('n', 'int', maximum='10'), BehaviorParameter('m', 'int')))
    counting, huge = replace(view(), behaviors=(known,)), '1' * 400
    assert make.start(counting, 'Count', [('m', huge)]).arguments == (('m', huge),)
    with pytest.raises(RefusedError, match='is beyond its limits'):
        make.start(counting, 'Count', [('n', huge)])


def test_a_name_of_several_packages_is_refused_with_the_names_to_say(make: CommandBuilder) -> None:
    behaviors = (Behavior('a/Drive', package='a'), Behavior('b/Drive', package='b'), Behavior('Look', package='b'))
    of_two = replace(view(), behaviors=behaviors)
    for build in (make.start, make.switch):
        with pytest.raises(RefusedError, match="several packages have a behavior 'Drive'; say 'a/Drive' or 'b/Drive'"):
            build(of_two, 'Drive')
        assert build(of_two, 'b/Drive').behavior == 'b/Drive'
        assert build(of_two, 'b/Look').behavior == 'b/Look'
        with pytest.raises(RefusedError, match="no behavior 'a/Look'"):
            build(of_two, 'a/Look')


def test_parameters_of_embedded_behaviors_are_the_executives_to_judge(make: CommandBuilder) -> None:
    command = make.start(view(autonomy=3), 'Drive', [('/Inner/speed', 'any')])
    assert command.autonomy == 3  # as it is shown
    assert list(command.arguments) == [('/Inner/speed', 'any')]


def test_answers(make: CommandBuilder) -> None:
    value = make.answer(view(INPUT), '', 'kitchen').inputs[0]
    assert value.type == POSE
    assert json.loads(value.text)['pose']['position'] == {'x': 1.0, 'y': 2.0}
    for text in ('cellar', '1', '1 2 3 4', '1 2 nan', '1 x', '', '1 2; 3 4'):
        with pytest.raises(RefusedError):
            make.answer(view(INPUT), '', text)
    with pytest.raises(RefusedError, match='not pending'):
        make.answer(view(INPUT), 'old', 'kitchen')
    with pytest.raises(RefusedError, match='takes no value'):
        make.answer(view(TRANSITION), 't1', 'kitchen')
    limited = Decision('i2', DecisionKind.INPUT, '/Ask', input_type='string', input_choices=('a b', 'c'))
    assert make.answer(view(limited), '', 'a b').inputs[0].text == '"a b"'
    with pytest.raises(RefusedError, match='a b, c'):
        make.answer(view(limited), '', 'd')


@given(*[st.floats(-1e6, 1e6, allow_nan=False)] * 2, st.floats(-math.pi, math.pi))
def test_a_pose_arrives_as_it_was_written(x: float, y: float, yaw: float) -> None:
    from flexbt_common.values.entries import text_to_value

    pose = text_to_value(value_text(f'{x!r} {y!r} {yaw!r}', POSE, {}), POSE)
    assert (pose.header.frame_id, pose.pose.position.x, pose.pose.position.y) == ('map', x, y)
    q = pose.pose.orientation
    assert math.isclose(q.z**2 + q.w**2, 1.0, rel_tol=1e-9)
    assert abs(math.remainder(2.0 * math.atan2(q.z, q.w) - yaw, 2.0 * math.pi)) < 1e-9


def test_values_of_other_types() -> None:
    places = {'kitchen': FramedPose(1.0, 2.0)}
    assert len(json.loads(value_text('kitchen; 3 4', POSE + '[]', places))) == 2
    assert json.loads(value_text('[]', 'geometry_msgs/PoseStamped[]', places)) == []
    assert json.loads(value_text('kitchen', 'geometry_msgs/Pose2D', places)) == {'x': 1.0, 'y': 2.0, 'theta': 0.0}
    assert value_text('kitchen', 'string', places) == '"kitchen"'
    assert value_text('{x: 1.5}', 'geometry_msgs/Point', {}).startswith('{"x": 1.5')
    assert json.loads(value_text('[1, 2]', 'int32[]', {})) == [1, 2]
    assert value_text('anything', 'not_here_msgs/msg/Thing', {}) == 'anything'
    for text, type in (('x', 'int32'), ('{z: 1, q: 2}', 'geometry_msgs/Point'), ('300', 'uint8')):
        with pytest.raises(RefusedError, match=type):
            value_text(text, type, {})


def test_inputs_of_a_start() -> None:
    value = start_input('goal=geometry_msgs/PoseStamped:1 2', {})
    assert (value.key, value.type) == ('goal', 'geometry_msgs/PoseStamped')
    for text in ('goal', 'goal=1', '=int:1', 'goal=:1'):
        with pytest.raises(UsageError):
            start_input(text, {})


def test_places_file(tmp_path: Path) -> None:
    file = tmp_path / 'places.yaml'
    file.write_text('kitchen: {x: 1, y: 2.5, yaw: 0.1}\nhall: {x: 0, y: 0, frame: odom}\n')
    assert load_places(file) == {'kitchen': FramedPose(1.0, 2.5, 0.1), 'hall': FramedPose(0.0, 0.0, 0.0, 'odom')}
    for text, message in (
        ('a: [1, 2]', "place 'a'"),
        ('a: {x: 1}', "place 'a'"),
        ('a: {x: 1, y: yes}', 'y is True'),
        ('a: {x: .nan, y: 1}', 'x is nan'),
        ('a b: {x: 1, y: 1}', 'one word'),
        ('- a', 'expected'),
        ('a: {x: 1' + '0' * 400 + ', y: 2}', 'not a number'),
        ('a: {', 'places.yaml'),
        ('a: !!python/object/apply:os.getcwd []', 'places.yaml'),
    ):
        file.write_text(text)
        with pytest.raises(UsageError, match=message):
            load_places(file)
    with pytest.raises(UsageError, match='No such file'):
        load_places(tmp_path / 'none.yaml')


@pytest.mark.parametrize('text', HOSTILE_YAML.values(), ids=HOSTILE_YAML)
def test_a_places_file_that_is_meant_to_do_harm_is_refused_in_time(tmp_path: Path, text: str) -> None:
    file = tmp_path / 'places.yaml'
    file.write_text(text)
    began = time.process_time()
    with pytest.raises(UsageError, match=r'places\.yaml') as caught:
        load_places(file)
    assert time.process_time() - began < 1.0
    assert len(str(caught.value)) < 1000


def test_states_are_named_by_their_last_labels_and_what_goes_on_depends_on_the_state(
    make: CommandBuilder,
) -> None:
    states = tuple(StateStructure(path) for path in ('/', '/Do', '/Do/Plan', '/Else', '/Else/Plan'))
    paused = ExecutiveSnapshot('e', 1, state=ExecutiveState.PAUSED, run_id='r1')
    running = View(LinkState.LIVE, 0.1, '', paused, Structure('r1', 'B', states))
    assert make.at_path(CommandKind.LOCK, running, 'Do/Plan').path == '/Do/Plan'
    assert make.autonomy(running, AutonomyLevel.HIGH, 'Else').path == '/Else'
    with pytest.raises(RefusedError, match='not unique'):
        make.at_path(CommandKind.BREAKPOINT, running, 'Plan')
    with pytest.raises(RefusedError, match="did you mean '/Do/Plan'"):
        make.at_path(CommandKind.UNLOCK, running, 'Do/Plam')
    assert make.resume(running).kind is CommandKind.RESUME
    interrupted = View(
        LinkState.LIVE, 0.1, '', ExecutiveSnapshot('e', 1, state=ExecutiveState.INTERRUPTED, run_id='r1')
    )
    assert make.resume(interrupted).kind is CommandKind.RESUME_RUN
    assert make.command(interrupted, CommandKind.ABORT_RUN).run_id == 'r1'
    assert '"resume" continues' in '\n'.join(status_lines(interrupted))


def test_a_decision_says_why_it_is_asked() -> None:
    """By the autonomy that is required, or by a breakpoint, whatever is required."""
    low = dataclasses.replace(TRANSITION, required_autonomy=0)
    shown = '\n'.join(status_lines(view(low)))
    assert 'auto at Low' in shown and 'breakpoint' not in shown
    snapshot = view(low).snapshot
    assert snapshot is not None
    stopped = dataclasses.replace(snapshot, breakpoints=('/Nav', low.path))
    assert '/Nav/Plan wants done (breakpoint)' in decision_line(low, stopped)


def test_the_authority_is_handed_to_the_one_who_asks(make: CommandBuilder) -> None:
    def asked_by(*operators: str) -> View:
        return View(LinkState.LIVE, 0.1, '', ExecutiveSnapshot('e', 1, authority='ann', authority_requests=operators))

    for kind in (CommandKind.HAND_OVER_AUTHORITY, CommandKind.REFUSE_AUTHORITY):
        assert make.to_requester(kind, asked_by('bob')).grantee == 'bob'
        assert make.to_requester(kind, asked_by('bob', 'eve'), 'zoe').grantee == 'zoe'
        with pytest.raises(RefusedError, match='bob, eve'):
            make.to_requester(kind, asked_by('bob', 'eve'))
        with pytest.raises(RefusedError, match='nobody requests'):
            make.to_requester(kind, asked_by())


@given(st.text('ab_19/ é-', max_size=6))
def test_a_namespace_is_one_of_ros_or_refused(text: str) -> None:
    try:
        full = full_namespace(text)
    except UsageError as error:
        assert repr(text) in str(error)
        with pytest.raises(InvalidNamespaceException):
            validate_namespace('/' + text.strip('/'))
    else:
        assert validate_namespace(full)
