# SPDX-License-Identifier: BSD-3-Clause
"""What an engineer writes is read as it is meant, and told back in the same words; what cannot be, with its place."""

from __future__ import annotations

import pytest

from flexbt_core.monitors.requirement_text import (
    RequirementError,
    machine_vocabulary,
    parse_requirement,
    problems_with,
    read_requirements,
)
from flexbt_core.monitors.requirements import (
    After,
    Apart,
    AtMost,
    Before,
    Has,
    IsA,
    Never,
    Possible,
    Requirement,
    While,
    Within,
    Written,
)
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.model.definition import Child
from flexbt_testing.state_machines.bench import Scripted, machine

TEXTS: dict[str, Requirement] = {
    'never /A > failed': Never('/A > failed'),
    '/A at most 3 times': AtMost('/A', 3),
    '/B only after /A > done': Before('/B', '/A > done'),
    '/B only after /A > done, each time anew': Before('/B', '/A > done', again=True),
    '/A at most 1 time in 0.5 s': AtMost('/A', 1, 0.5),
    '/B only after /A > done, 3 times': Before('/B', '/A > done', times=3),
    '/B only after /A > done, 3 times, each time anew': Before('/B', '/A > done', again=True, times=3),
    'after /A > done comes /B or =ended': After('/A > done', ('/B', '=ended')),
    'after /A > done, /B within 2.5 s': Within('/A > done', '/B', 2.5),
    'after /A > done, /B within 1234567.125 s': Within('/A > done', '/B', 1234567.125),
    '/A at most 1 time in 0.00001 s': AtMost('/A', 1, 1e-5),
    'after /A > done, /B before the end': Within('/A > done', '/B'),
    'after /A > failed, /A before the end, up to 3 times': Within('/A > failed', '/A', times=3),
    '/A never while /B': Apart('/A', '/B'),
    'Drive to dock works only while Is clear holds': While('Drive to dock', 'Is clear'),
    'Spin works only while GoalUpdated fails': While('Spin', 'GoalUpdated', holds=False),
    '=ended only with x and y written': Written('=ended', ('x', 'y')),
    '=ended is always still possible': Possible('=ended'),
    'dock is a Dock': IsA('dock', 'Dock'),
    'never Door is a Jar': Never('Door is a Jar'),
    'Drive to dock has path={path} and server_name=a and b': Has(
        'Drive to dock', (('path', '{path}'), ('server_name', 'a and b'))
    ),
    '/A > done has autonomy=High': Has('/A > done', (('autonomy', 'High'),)),
}


@pytest.mark.parametrize(('text', 'required'), TEXTS.items())
def test_a_text_is_read_and_told_back(text: str, required: Requirement) -> None:
    assert parse_requirement(text, 'here').requirement == required
    assert str(required) == text


def test_spaces_and_units_are_free() -> None:
    assert parse_requirement('  after  /A>done ,  /B within 1500 ms ', '').requirement == Within('/A > done', '/B', 1.5)
    assert parse_requirement('after /A, /B within 2 min', '').requirement == Within('/A', '/B', 120.0)


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('/A should work', 'is not a requirement; write one of "never A"'),
        ('', 'is not a requirement'),
        ('/A at most 0 times', 'write "never" for none'),
        ('after /A, /B within 0 s', 'a time is above 0'),
        ('/A at most 2 times in 0 s', 'a time is above 0'),
        ('/A only after /B, 0 times', 'a number of times is 1 at least'),
        (f'never {"a" * 10_000_000}', 'at most 500 characters'),
    ],
)
def test_what_is_no_requirement_is_told_with_place_and_remedy(text: str, why: str) -> None:
    with pytest.raises(RequirementError, match=f'^mission.yaml:3: .*{why}'):
        parse_requirement(text, 'mission.yaml:3')


def test_all_that_is_wrong_in_a_file_is_told_with_its_line() -> None:
    with pytest.raises(RequirementError) as caught:
        read_requirements('Inspect:\n  - never /A\n  - /A should\n  - 3 times\nOther: 4\n', 'm.yaml')
    assert [one.partition(': ')[0] for one in caught.value.problems] == ['m.yaml:3', 'm.yaml:4', 'm.yaml:5']
    assert [len(found) for found in read_requirements('Inspect:\n  - never /A\nOther: []\n', 'm.yaml').values()] == [
        1,
        0,
    ]


@pytest.mark.parametrize(
    ('text', 'why'),
    [
        ('never /Aa > done', "Test has no event '/Aa > done'; did you mean '/A > done'?"),
        ('after /A comes /B', "'/A' is not a state left by an outcome: write '/A > OUTCOME'"),
        ('a works only while b holds', 'this can be required of a tree only'),
        ('=ended only with path written', "the userdata of Test has no key 'path'"),
        ('/A never while /C', "Test has no state '/C'"),
        ('/A never while /A', "Test has one '/A' only"),
        ('after /A > done, =gone before the end', "Test has no event '=gone'"),
        ('never /A > failed', ''),
        ('/Aa is an Scripted', "Test has nothing called '/Aa'; did you mean '/A'?"),
        ('/B > failed has autonomy=Low', "Test has nothing called '/B > failed'"),
        ('/A is a Scripted', ''),
    ],
)
def test_what_is_not_there_is_told(text: str, why: str) -> None:
    made = machine(
        Child('A', Scripted('done', 'failed'), {'done': 'B', 'failed': 'ended'}, {}),
        Child('B', Scripted(), {'done': 'ended'}, {}),
    )
    found = problems_with([parse_requirement(text, '--require')], machine_vocabulary(define(made)), 'Test')
    assert len(found) == bool(why) and all(one.startswith('--require: ') and why in one for one in found)
