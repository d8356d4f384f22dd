# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors: manifests, typed parameters."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from flexbt_onboard.behaviors.behavior import (
    Behavior,
    BehaviorInput,
    BehaviorManifest,
    BehaviorParameter,
    ParameterValue,
    parameter_text,
)
from flexbt_onboard.errors import ManifestError, ParameterError


class Patrol(Behavior):
    manifest = BehaviorManifest(
        'Patrol',
        parameters=[
            BehaviorParameter('rounds', 3),
            BehaviorParameter('speed', 0.2),
            BehaviorParameter('quiet', False),
            BehaviorParameter('legs', [1, 2]),
            BehaviorParameter('side', 'left', choices=['left', 'right']),
        ],
    )


def test_parameters_are_attributes_with_their_defaults() -> None:
    patrol = Patrol()
    assert (patrol.rounds, patrol.speed, patrol.quiet, patrol.side) == (3, 0.2, False, 'left')  # type: ignore[attr-defined]
    assert [parameter.type for parameter in patrol.parameters.values()] == ['int', 'float', 'bool', 'list', 'string']


@pytest.mark.parametrize(
    ('name', 'text', 'value'),
    [
        ('rounds', '7', 7),
        ('rounds', ' -7 ', -7),
        ('speed', '1', 1.0),
        ('speed', '1e-3', 0.001),
        ('speed', 'inf', math.inf),
        ('quiet', 'True', True),
        ('quiet', '0', False),
        ('legs', '[a, {b: 1}]', ['a', {'b': 1}]),
        ('quiet', 'off', False),
        ('side', 'right', 'right'),
    ],
)
def test_arguments_are_converted_to_the_type_of_the_parameter(name: str, text: str, value: Any) -> None:
    patrol = Patrol()
    patrol.set_arguments([(name, text)])
    assert getattr(patrol, name) == value
    assert type(getattr(patrol, name)) is type(value)


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('rounds', '7.0', ['rounds', "'7.0'", 'int']),
        ('rounds', 'True', ['rounds', "'True'", 'int']),
        ('rounds', '', ['rounds', 'int']),
        ('speed', 'fast', ['speed', "'fast'", 'float']),
        ('speed', 'nan', ['speed', "'nan'", 'float']),
        ('quiet', '2', ['quiet', "'2'", 'bool']),
        ('legs', '{a: 1}', ['legs', "'{a: 1}'", 'list', 'write a list in YAML, such as [1, 2]']),
        ('legs', '[1', ['legs', "'[1'", 'list', 'no YAML']),
        ('side', 'up', ['side', "'up'", 'left, right']),
        ('size', '1', ['Patrol', 'size', 'rounds, speed, quiet, legs, side']),
    ],
)
def test_a_wrong_argument_is_named_with_parameter_type_and_text(name: str, text: str, words: list[str]) -> None:
    patrol = Patrol()
    with pytest.raises(ParameterError) as refusal:
        patrol.set_arguments([('rounds', '5'), (name, text)] if name != 'rounds' else [(name, text)])
    assert all(word in str(refusal.value) for word in words)
    assert patrol.rounds == 3, 'all arguments, or none'  # type: ignore[attr-defined]


def test_an_argument_given_twice_is_refused() -> None:
    with pytest.raises(ParameterError, match="'rounds' is given twice"):
        Patrol().set_arguments([('rounds', '1'), ('rounds', '2')])


SHARED = {'x': 1.0}
SCALARS = st.one_of(st.booleans(), st.integers(), st.floats(allow_nan=False), st.text())


@given(st.one_of(SCALARS, st.lists(SCALARS | st.lists(SCALARS)), st.dictionaries(st.integers() | st.text(), SCALARS)))
@example(['two\x85lines'])
@example([SHARED, SHARED])
def test_a_value_survives_the_way_through_its_text(value: ParameterValue) -> None:
    back = BehaviorParameter('value', value).from_text(parameter_text(value))
    assert back == value
    assert type(back) is type(value)


def test_a_number_larger_than_any_float_is_outside_of_limits() -> None:
    with pytest.raises(ParameterError, match=r"^parameter 'rounds': 9+\.\.\.9+ is outside of its limits 1 to 5$"):
        BehaviorParameter('rounds', 1, minimum=1, maximum=5).from_text('9' * 400)


def test_a_limit_is_told_with_all_its_digits() -> None:
    with pytest.raises(ParameterError, match=r'1234568 is outside of its limits 0\.1234567 to 1234567$'):
        BehaviorParameter('rounds', 1, minimum=0.1234567, maximum=1234567).from_text('1234568')


def test_what_is_no_number_is_outside_of_limits() -> None:
    """As a program, or YAML that embeds the behavior, may give it."""
    with pytest.raises(ParameterError, match='nan is outside of its limits -inf to 1'):
        BehaviorParameter('speed', 0.5, maximum=1.0).checked(float('nan'))


def test_set_parameter_takes_an_int_for_a_float_and_nothing_else() -> None:
    patrol = Patrol()
    patrol.set_parameter('speed', 2)
    assert patrol.speed == 2.0  # type: ignore[attr-defined]
    with pytest.raises(ParameterError, match='not a value of type int'):
        patrol.set_parameter('rounds', True)


@pytest.mark.parametrize(
    'make',
    [
        lambda: BehaviorParameter('two words', 1),
        lambda: BehaviorParameter('class', 1),
        lambda: BehaviorParameter('_hidden', 1),
        lambda: BehaviorParameter('items', (1, 2)),  # type: ignore[arg-type]
        lambda: BehaviorParameter('items', [object()]),
        lambda: BehaviorParameter('items', {(1, 2): 3}),
        lambda: BehaviorParameter('side', 'up', choices=['left']),
        lambda: BehaviorParameter('side', 'left', choices=['left', 1]),
        lambda: BehaviorParameter('a', 1, unit=5),  # type: ignore[arg-type]
        lambda: BehaviorParameter('a', 1, minimum='0'),  # type: ignore[arg-type]
        lambda: BehaviorInput('a', description=None),  # type: ignore[arg-type]
        lambda: BehaviorManifest('A', author=None),  # type: ignore[arg-type]
        lambda: BehaviorManifest(''),
        lambda: BehaviorManifest('a/b'),
        lambda: BehaviorManifest('A', parameters=[BehaviorParameter('a', 1), BehaviorParameter('a', 2)]),
    ],
)
def test_wrong_declarations_are_refused(make: Any) -> None:
    with pytest.raises(ManifestError):
        make()


def test_a_parameter_cannot_hide_what_a_behavior_has() -> None:
    class Odd(Behavior):
        manifest = BehaviorManifest('Odd', parameters=[BehaviorParameter('create', 1)])

    with pytest.raises(ManifestError, match="'create'"):
        Odd()


def test_parameters_may_be_declared_in_the_constructor() -> None:
    class Ported(Behavior):
        manifest = BehaviorManifest('Ported', parameters=[BehaviorParameter('speed', 1.0)])

        def __init__(self) -> None:
            super().__init__()
            self.add_parameter('speed', 1.0)
            self.add_parameter('label', 'x')

    ported = Ported()
    ported.set_arguments([('label', 'y')])
    assert ported.label == 'y'  # type: ignore[attr-defined]
    assert list(ported.parameters) == ['speed', 'label']
    with pytest.raises(ManifestError, match='declared twice'):
        ported.add_parameter('speed', 2.0)


def test_two_behaviors_share_nothing() -> None:
    first, second = Patrol(), Patrol()
    first.set_parameter('rounds', 9)
    first.add_parameter('extra', 1)
    assert second.rounds == 3  # type: ignore[attr-defined]
    assert 'extra' not in second.parameters
