# SPDX-License-Identifier: BSD-3-Clause
"""What a run shows of the skills of its states: told where it contradicts, and nowhere else."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.skills.literals import Predicate, SkillError
from flexbt_core.skills.observation import SkillMonitor, claims
from flexbt_core.skills.skill import Outcome, Skill

AT = Predicate('at', {'where': 'place'}, exclusive='where')
HOLDING = Predicate('holding')


def drive(to: str) -> Skill:
    return Skill.of(
        parameters={'to': 'place'},
        preconditions=['not holding'] if to == 'dock' else [],
        outcomes={'done': ['at(to)'], 'failed': 'failed'},
        predicates=[AT, HOLDING],
        retries=1,
    ).bound(to=to)


SKILLS = {
    '/ToDock': drive('dock'),
    '/ToDoor': drive('door'),
    '/Grab': Skill.of(preconditions=['at(door)'], outcomes={'done': ['holding'], 'failed': 'failed'}),
    '/Drop': Skill.of(outcomes={'done': ['not holding']}),
    '/Where': Skill.of(outcomes={'dock': Outcome.of('answered', 'at(dock)')}, predicates=[AT]),
    '/Look': Skill.of(
        outcomes={'true': Outcome.of('answered', 'holding'), 'false': Outcome.of('answered', 'not holding')}
    ),
}


def monitor() -> SkillMonitor:
    return SkillMonitor({path: claims(skill) for path, skill in SKILLS.items()})


def run(*steps: str) -> list[str]:
    """Return the observations of steps ``path outcome``; ``!`` in front of the outcome: it was forced."""
    follower = monitor()
    told = []
    for step in steps:
        path, _, outcome = step.partition(' ')
        told += [f'{path}: {text}' for text in follower.began(path)]
        told += [
            f'{path}: {text}'
            for text in follower.ended(path, outcome.removeprefix('!'), by_itself=not outcome.startswith('!'))
        ]
    return told


@pytest.mark.parametrize(
    ('steps', 'told'),
    [
        (['/ToDoor done', '/Grab done', '/Look true', '/Drop done', '/Look false', '/ToDock done'], []),
        (
            ['/ToDoor done', '/Grab done', '/Look false'],
            ["/Look: /Grab ended by 'done', after which holding was to hold; it does not"],
        ),
        (
            ['/Drop done', '/Look true'],
            ["/Look: /Drop ended by 'done', after which not holding was to hold; it does not"],
        ),
        (['/Look false', '/Look true'], []),  # the world has changed
        (  # at one place at most
            ['/ToDoor done', '/Where dock', '/Where dock'],
            ["/Where: /ToDoor ended by 'done', after which at(door) was to hold; it does not"],
        ),
        (['/ToDoor done', '/ToDock done', '/Where dock'], []),
        (['/Grab done', '/Look false', '/Look true'], ["/Look: /Grab ended by 'done', after which holding was to hold; "
                                                       'it does not']),
        (['/Grab !done', '/Look false'], []),  # forced: nobody knows
        (['/Grab done', '/Grab !done', '/Look false'], []),
        (['/ToDoor done', '/ToDock !done', '/Where dock'], []),
        (
            ['/ToDoor done', '/ToDock done', '/Grab done'],
            ["/Grab: it began though at(door) does not hold, as /ToDock brought about by 'done'"],
        ),
        (['/Look true', '/ToDock done'], ['/ToDock: it began though not holding does not hold, as /Look measured']),
        (['/Grab lost'], ["/Grab: it ended by 'lost', of which its skill knows nothing"]),
        (['/ToDoor failed'] * 2, []),
        (
            ['/ToDoor failed'] * 4,
            ['/ToDoor: it has failed 3 times in a row; its skill allows for 1 after the first'],
        ),
        (['/ToDoor failed', '/ToDoor failed', '/ToDoor done', '/ToDoor failed', '/ToDoor failed'], []),
        (['/Other done'], []),
    ],
)  # fmt: skip
def test_what_contradicts_is_told(steps: list[str], told: list[str]) -> None:
    assert run(*steps) == told


def test_what_was_done_within_a_step_is_judged_when_it_ends() -> None:
    follower = monitor()
    follower.ended('/ToDoor', 'done')
    follower.ended('/ToDock', 'done')
    assert follower.ended('/Grab', 'done') == [
        "it began though at(door) does not hold, as /ToDock brought about by 'done'"
    ]


def test_of_what_is_not_bound_nothing_is_known() -> None:
    loose = Skill.of(parameters={'to': 'place'}, preconditions=['at(to)'], outcomes={'done': ['at(to)']})
    assert claims(loose) == {}
    assert claims(Skill.of(resources=['arm'])) == {}


JSON = st.recursive(st.none() | st.integers() | st.text(max_size=5), lambda inner: st.lists(inner, max_size=3)
                    | st.dictionaries(st.sampled_from(['needs', 'outcomes', 'retries', 'class', 'effects', 'a']), inner,
                                      max_size=4), max_leaves=8)  # fmt: skip


@given(st.dictionaries(st.text(max_size=3), JSON, max_size=2))
def test_whatever_a_line_of_the_log_holds_is_taken_or_refused(told: dict[str, Any]) -> None:
    try:
        follower = SkillMonitor(told)
    except SkillError:
        return
    for path in told:
        follower.began(path)
        follower.ended(path, 'done')
