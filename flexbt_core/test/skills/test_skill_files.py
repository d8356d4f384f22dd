# SPDX-License-Identifier: BSD-3-Clause
"""Manifests as YAML: what is written is read again, and what is wrong is told with its line and what to do."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.literals import (
    BlackboardSensor,
    ConditionSensor,
    Literal,
    Predicate,
    SkillError,
    TopicSensor,
    parse_literal,
)
from flexbt_core.skills.skill import Outcome, OutcomeClass, Skill
from flexbt_core.skills.yaml_files import read_skills, write_skills

NAMES = st.from_regex(r'[A-Za-z_][A-Za-z0-9_]{0,8}', fullmatch=True).filter(lambda name: name != 'not')
TYPES = st.sampled_from(['place', 'thing', 'cup', 'door'])
TEXTS = st.text(max_size=12).map(lambda text: text.replace('$', '$$'))
TIMES = st.floats(0.0, 1e9) | st.integers(0, 100).map(float)


@st.composite
def predicates(draw: st.DrawFn, name: str) -> Predicate:
    parameters = draw(st.dictionaries(NAMES, TYPES, max_size=3))
    argument = st.sampled_from([f'${name}' for name in parameters]) | TEXTS if parameters else TEXTS
    sensor = draw(
        st.none()
        | st.builds(ConditionSensor, NAMES, st.dictionaries(NAMES, argument, max_size=2))
        | st.builds(TopicSensor, TEXTS, NAMES, argument)
        | st.builds(BlackboardSensor, argument)
    )
    exclusive = draw(st.none() | st.sampled_from(list(parameters))) if parameters else None
    return Predicate(name, parameters, sensor, exclusive)


@st.composite
def libraries(draw: st.DrawFn) -> SkillLibrary:
    known = {name: draw(predicates(name)) for name in draw(st.lists(NAMES, unique=True, min_size=1, max_size=3))}
    objects = draw(st.dictionaries(st.from_regex(r'[a-z0-9_][a-z0-9_.:/@-]{0,6}', fullmatch=True), TYPES, max_size=4))
    skills = []
    for name in draw(st.lists(NAMES, unique=True, max_size=3)):
        parameters = draw(st.dictionaries(NAMES, TYPES, max_size=3))

        def literals(parameters: dict[str, str] = parameters) -> tuple[Literal, ...]:
            found = []
            for name in draw(st.lists(st.sampled_from(list(known)), unique=True, max_size=3)):
                predicate = known[name]
                choices = [
                    [*(name for name, own in (objects | parameters).items() if own == kind)]
                    for kind in predicate.parameters.values()
                ]
                if all(choices):
                    arguments = tuple(draw(st.sampled_from(choice)) for choice in choices)
                    found.append(Literal(name, arguments, draw(st.booleans())))
            return tuple(found)

        def outcome(literals: object = literals) -> Outcome:
            effects = literals()  # type: ignore[operator]
            return Outcome(draw(st.sampled_from(OutcomeClass)), effects, draw(st.none() | st.integers(0, 3)))

        least = draw(TIMES)
        skills.append(
            Skill(
                name,
                parameters,
                literals(),
                {ending: outcome() for ending in draw(st.lists(NAMES, unique=True, max_size=3))},
                tuple(draw(st.lists(TEXTS, unique=True, max_size=2))),
                tuple(draw(st.lists(TEXTS, unique=True, max_size=2))),
                tuple(draw(st.lists(TEXTS, unique=True, max_size=2))),
                draw(TIMES),
                draw(st.none() | TIMES.filter(bool)),
                draw(st.none() | st.integers(0, 9)),
                draw(st.booleans()),
                (least, draw(st.none() | st.sampled_from([least, least + 1.5]))),
                draw(st.dictionaries(NAMES, TEXTS, max_size=2)),
            )
        )
    types = {'cup': 'thing', 'place': 'object', 'thing': 'object', 'door': 'object'}
    return SkillLibrary.of(skills, known.values(), types=types, objects=objects)


@settings(max_examples=50)
@given(libraries())
def test_what_is_written_is_read_again(library: SkillLibrary) -> None:
    text = write_skills(library)
    assert read_skills(text) == library
    assert write_skills(read_skills(text)) == text


@given(st.builds(Literal, NAMES, st.lists(NAMES, max_size=3).map(tuple), st.booleans()))
def test_a_literal_is_what_its_text_says(literal: Literal) -> None:
    assert parse_literal(str(literal)) == literal
    assert ~~literal == literal
    assert parse_literal(str(~literal)).positive is not literal.positive


TEXT = """\
types: {cup: thing}
objects: {kitchen: place, mug: cup, Tür/1: thing}
predicates:
  at:
    parameters: {where: place}
    sensor: {condition: IsAt, ports: {place: $where}}
  holding: {parameters: {what: thing}}
skills:
  GoTo:
    parameters: {to: place}
    preconditions:
      - not at(to)
    outcomes:
      SUCCESS:
        - at(to)
      FAILURE: failed
    cost: 15
    duration: [1, 20]
    arguments: {goal: '{$to}'}
  Grab:
    parameters: {what: cup}
    preconditions: [at(kitchen), not holding(mug)]
    outcomes: {SUCCESS: [holding(what)]}
"""

WRONG = [
    ('types: {cup: thing}', 'types: {cup: thing, thing: cup}', 1, 'type cup: it is a kind of itself: cup > thing'),
    ('mug: cup', 'mug: cupp', 2, "object mug: 'cupp' is not a type; did you mean 'cup'?"),
    ('mug: cup', '"mug (blue)": cup', 2, "'mug (blue)' cannot name an object: letters, digits and _.:/@-"),
    ('{where: place}', '{where: place}\n    exclusive: who', 4, "exclusive: 'who' is none of its parameters"),
    ('condition: IsAt, ports: {place: $where}', 'conditions: IsAt', 6, 'has to have one of condition, topic'),
    ('condition: IsAt, ports: {place: $where}', 'topic: pose', 6, 'sensor of predicate at has no type; a topic needs'),
    ('$where', '$place', 4, "sensor: $place in '$place' is none of its parameters"),
    ('$where', '100$', 4, "'100$' has a $ without a name; write $$"),
    ('holding: {', 'not: {', 7, "'not' cannot name a predicate"),
    ('not at(to)', 'not att(to)', 11, "not att(to): there is no predicate 'att'; did you mean 'at'?"),
    ('not at(to)', 'at(to)\n      - not at(to)', 11, 'asks for at(to) and not at(to), so it is never done'),
    ('\n        - at(to)', ' at(to)', 14, 'outcome SUCCESS of skill GoTo: effects are a list; write [at(to)]'),
    ('not at(to)', 'at to', 12, "preconditions of skill GoTo: 'at to' is not a literal; such as at(robot, place)"),
    ('not at(to)', '"at(to"', 12, "'at(to' is not a literal; in [ ] one with a comma has to be in quotes"),
    ('not at(to)', 'at(to, to)', 11, 'at(to, to): at has 1 arguments (place)'),
    ('not at(to)', 'at(too)', 11, "at(too): 'too' is neither a parameter nor an object; did you mean 'to'?"),
    ('not at(to)', 'holding(to)', 11, 'holding(to): to is of the type place, and holding takes thing'),
    ('        - at(to)\n', '        - at(to)\n        - not at(to)\n', 14, 'has at(to) and not at(to) as effects'),
    ('        - at(to)\n', '        - to != kitchen\n', 14, 'to != kitchen cannot be an effect'),
    ('FAILURE: failed', 'FAILURE: fail', 16, "'fail' is not a class of outcomes; did you mean 'failed'?"),
    ('FAILURE: failed', 'FAILURE: {autonomy: some}', 16, "'some' is not a level of autonomy; there are off"),
    ('FAILURE: failed', 'FAILURE: {clas: failed}', 16, "cannot have 'clas'; did you mean 'class'?"),
    ('cost: 15', 'cost: much', 17, "cost of skill GoTo has to be a number, not 'much'"),
    ('cost: 15', 'cost: -1', 17, '-1.0 has to be a number from 0 on'),
    ('cost: 15', 'costs: 15', 17, "skill GoTo cannot have 'costs'; did you mean 'cost'?"),
    ('cost: 15', 'retries: 1.5', 17, 'retries of skill GoTo has to be a whole number, not 1.5'),
    ('cost: 15', 'retries: -1', 17, '-1 has to be a number from 0 on'),
    ('cost: 15', 'deadline: .nan', 17, 'nan has to be a time above 0, s'),
    ('cost: 15', 'deadline: 0', 17, '0.0 has to be a time above 0, s; leave it out for never'),
    ('cost: 15', 'ignores_cancel: 1', 17, 'ignores_cancel of skill GoTo has to be true or false, not 1'),
    ('[1, 20]', '[20, 1]', 18, '[20.0, 1.0] has to be a least and a greatest time'),
    ('[1, 20]', '[1, 2, 3]', 18, 'has to be [least] or [least, greatest], s'),
    ("'{$to}'", "'{$from}'", 19, "$from in '{$from}' is not a parameter of the skill; it has to"),
    ('{what: cup}', '{what: cupp}', 21, "'cupp' is not a type; did you mean 'cup'?"),
    ('{what: cup}', '{wh-at: cup}', 21, "'wh-at' cannot name a parameter"),
    ('  Grab:', '  GoTo:', 20, "skills has 'GoTo' twice"),
    ('skills:', 'skill:', 8, "the text cannot have 'skill'; did you mean 'skills'?"),
    ('  Grab:', '  Grab: &a', 20, ''),
]  # fmt: skip


def test_the_example_is_right() -> None:
    library = read_skills(TEXT)
    assert library.skills['GoTo'].outcomes['SUCCESS'] == Outcome(OutcomeClass.COMPLETED, (parse_literal('at(to)'),))
    assert library.objects_of('thing') == ['mug', 'Tür/1']
    assert read_skills(write_skills(library)) == library


@pytest.mark.parametrize(
    ('preconditions', 'fit'),
    [
        ('at(from), at(to), from != to', False),
        ('at(from), at(to), to != from', False),
        ('at(kitchen), at(hall)', False),
        ('at(from), at(to)', True),
        ('at(from), at(kitchen)', True),
        ('at(from), not at(to), from != to', True),
    ],
)
def test_a_skill_that_asks_to_be_at_two_places_is_refused(preconditions: str, fit: bool) -> None:
    text = (
        'objects: {kitchen: place, hall: place}\npredicates: {at: {parameters: {where: place}, exclusive: where}}\n'
        f'skills: {{Go: {{parameters: {{from: place, to: place}}, preconditions: [{preconditions}]}}}}'
    )
    if fit:
        read_skills(text)
        return
    with pytest.raises(SkillError, match=r'<text>:3: skill Go preconditions: .* cannot hold at once \(at is exclusive'):
        read_skills(text)


@pytest.mark.parametrize(('right', 'wrong', 'line', 'message'), WRONG, ids=[wrong for _, wrong, _, _ in WRONG])
def test_what_is_wrong_is_told_with_its_line(right: str, wrong: str, line: int, message: str) -> None:
    text = TEXT.replace(right, wrong, 1)
    assert text != TEXT
    if not message:
        assert read_skills(text) == read_skills(TEXT)
        return
    with pytest.raises(SkillError) as error:
        read_skills(text, 'mission.yaml')
    found = [problem for problem in error.value.problems if message in problem]
    assert found, error.value.problems
    assert found[0].startswith(f'mission.yaml:{line}: ')


def test_a_file_adds_to_what_a_class_tells() -> None:
    classes = SkillLibrary.of([Skill.of('GoTo', outcomes={'SUCCESS': 'completed', 'FAILURE': 'failed'})])
    text = 'predicates: {near: {}}\nskills:\n  GoTo: {cost: 3, outcomes: {SUCCESS: [near]}}\n'
    skill = read_skills(text, base=classes).skills['GoTo']
    assert (skill.cost, [*skill.outcomes]) == (3.0, ['SUCCESS', 'FAILURE'])
    assert skill.outcomes['SUCCESS'].effects == (Literal('near'),)
    with pytest.raises(SkillError, match=r"f.yaml:3: skill GoTo has no outcome 'SUCESS'; did you mean 'SUCCESS'\?"):
        read_skills(text.replace('SUCCESS', 'SUCESS'), 'f.yaml', classes)


@pytest.mark.parametrize('hostile', ['[' * 5000, 'skills: 1', '- a', '', 'skills: {a: {cost: ' + '9' * 5000 + '}}'])
def test_any_text_is_refused_in_short_words(hostile: str) -> None:
    with pytest.raises(SkillError) as error:
        read_skills(hostile)
    assert all(len(problem) < 1000 for problem in error.value.problems)


@pytest.mark.parametrize(
    'template',
    [
        'skills: {%s: {preconditions: [%s]}}',
        'skills: {a: {outcomes: {b: %s%s}}}',
        'objects: {a: %s%s}',
        'predicates: {%s: {sensor: {blackboard: $%s}}}',
    ],
)
def test_a_field_of_megabytes_does_not_make_a_long_message(template: str) -> None:
    with pytest.raises(SkillError) as error:
        read_skills(template.replace('%s', 'x' * 200_000))
    assert all(len(problem) < 1000 for problem in error.value.problems)


def test_predicates_that_classes_declare_differently_are_refused() -> None:
    first = Skill.of('A', predicates=[Predicate('at', {'where': 'place'})])
    second = Skill.of('B', predicates=[Predicate('at', {'where': 'pose'})])
    with pytest.raises(SkillError, match='skills B: the predicate at is declared twice, and differently'):
        SkillLibrary.of([first, second])
    assert SkillLibrary.of([first]).predicates.keys() == {'at'}
    with pytest.raises(SkillError, match='skills A: there are two of this name'):
        SkillLibrary.of([first, first])


def test_a_predicate_of_the_file_is_not_the_one_of_a_class_that_has_its_name() -> None:
    base = SkillLibrary.of(
        [
            Skill.of(id, parameters={'goal': 'pose'}, outcomes={'SUCCESS': ['at(goal)'], 'FAILURE': 'failed'})
            for id in ('Drive', 'Fly')
        ],
        [Predicate('at', {'goal': 'pose'})],
    )
    text = 'predicates: {at: {parameters: {where: place}}}\nskills:\n  Drive: {parameters: {to: place}%s}\n'
    read = read_skills(text % ', outcomes: {SUCCESS: [at(to)]}', base=base)
    assert read.skills['Drive'].outcomes['SUCCESS'].effects == (parse_literal('at(to)'),)
    assert read.skills['Fly'].outcomes['SUCCESS'] == Outcome(OutcomeClass.COMPLETED)
    with pytest.raises(SkillError, match=r"f.yaml:3: skill Drive outcomes SUCCESS: at\(goal\): 'goal' is neither"):
        read_skills(text % '', 'f.yaml', base)
    same = read_skills('predicates: {at: {parameters: {goal: pose}}}', base=base)
    assert same.skills == base.skills


def test_a_flood_of_problems_is_cut_off() -> None:
    text = 'objects:\n' + ''.join(f'  o{number}: nothing\n' for number in range(5000))
    with pytest.raises(SkillError) as error:
        read_skills(text, 'f.yaml')
    assert len(error.value.problems) == 101
    assert error.value.problems[-1] == 'f.yaml:101: object o99: there are too many problems to show; mend these first'


def test_nobody_changes_a_manifest() -> None:
    library = read_skills(TEXT)
    skill = library.skills['GoTo']
    assert copy.deepcopy([library, skill, library.predicates['at']])[1] is skill
    changes: list[Callable[[Any], Any]] = [
        lambda one: setattr(one, 'cost', 1.0),
        lambda one: one.outcomes.update({'SUCCESS': Outcome()}),
        lambda one: one.arguments.clear(),
    ]
    for change in changes:
        with pytest.raises((AttributeError, TypeError)):
            change(skill)
