# SPDX-License-Identifier: BSD-3-Clause
"""Plays in the words of capabilities."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from flexbt_formal.synthesis.inputs import Problem

from .counter_play import CounterPlay

MAX_STEPS: Final = 40
"""Steps that are told at most."""


class Step(NamedTuple):
    """What is active, what the world answers, and what was chosen from what may follow."""

    doing: str
    world: str
    choices: tuple[str, ...]
    chosen: str


def played(play: CounterPlay, problem: Problem) -> tuple[tuple[Step, ...], tuple[str, ...]]:
    """A play in which the system does what takes least luck, until it has come round or the goal is out of reach; and
    why it ends: the demands that leave no answer, or that nothing helps any more."""
    steps: list[Step] = []
    seen: dict[tuple[object, ...], int] = {}
    while len(steps) < MAX_STEPS:
        if not play.answers:
            steps.append(Step(state_text(play.state, problem), world_text(play, problem), (), ''))
            return tuple(steps), tuple(play.why_none())
        key = tuple((play.state or {}).values())
        seen[key] = seen.get(key, 0) + 1
        if seen[key] > 2:
            break
        choices = answers_text(play, problem)
        chosen = play.nearest_answer()
        step = Step(state_text(play.state, problem), world_text(play, problem), choices, choices[chosen])
        steps += [step] if len(choices) > 1 or problem.vocabulary.active_in(play.state or {}) else []
        play.answer(chosen)
        if play.is_hopeless:
            return tuple(steps), ('from there the goal is out of reach, even if everything goes well',)
    return tuple(steps), ()


def state_text(state: Mapping[str, int] | None, problem: Problem) -> str:
    """What is active, and what is known."""
    if state is None:
        return 'the start'
    words = problem.vocabulary
    doing = ' and '.join((*words.active_in(state), *words.ends_in(state))) or 'nothing'
    return f'{doing}{_holding(state, problem)}'


def world_text(play: CounterPlay, problem: Problem) -> str:
    """What the world does."""
    words = problem.vocabulary
    said = []
    for name in words.active_in(play.state or {}):
        said += [f'{name} ends by {outcome}' for outcome in words.arrived_in(play.inputs, name)]
    own = {name.name for name in problem.specification.names(inputs=True) if words.is_own(name.name)}
    said += [
        name if value == 1 else f'{name}={value}' for name, value in play.inputs.items() if value and name not in own
    ]
    return ', '.join(said) or ('nothing' if play.state is not None else 'all is as it is at the start')


def answers_text(play: CounterPlay, problem: Problem) -> tuple[str, ...]:
    """What may follow, each by what becomes active and what is known then; where that is the same, it is numbered."""
    texts = [state_text({**play.inputs, **one}, problem) for one in play.answers]
    return tuple(
        text if texts.count(text) == 1 else f'{text} ({texts[:index].count(text) + 1})'
        for index, text in enumerate(texts)
    )


def _holding(state: Mapping[str, int], problem: Problem) -> str:
    held = problem.holding(state)
    return f' (holds {", ".join(held)})' if held else ''
