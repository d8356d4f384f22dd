# SPDX-License-Identifier: BSD-3-Clause
"""Answers of a synthesis: explanations as text, plays that are stepped through, and machines as messages of FlexBE."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from flexbt_common.values.value_types import from_plain, resolve_type
from flexbt_core.values.text import pluralize, short_repr
from flexbt_formal.synthesis.counter_play import CounterPlay, PlayStep, answers_text, state_text, world_text
from flexbt_formal.synthesis.explanation import Explanation
from flexbt_formal.synthesis.machine import SynthesizedMachine
from flexbt_formal.synthesis.machine_text import state_instantiations
from flexbt_formal.synthesis.translation import SynthesisProblem


def explanation_lines(explanation: Explanation) -> Iterator[str]:
    """Yield what there is to say about a request that no machine fulfils."""
    yield f'No machine can do that: {explanation.kind.value}.'
    yield ''
    if explanation.conflict:
        size = 'the smallest set' if explanation.is_smallest else 'none can be left out; a smaller set may exist'
        yield f'These demands conflict ({size}):'
        yield from (f'  - {demand}' for demand in explanation.conflict)
    else:
        yield 'No demand by itself is to blame: what the capabilities are allows nothing.'
    if explanation.never:
        yield ''
        yield 'From the start:'
        yield from (f'  - {one}' for one in explanation.never)
    if explanation.steps:
        yield ''
        yield 'One course of events:'
        for number, step in enumerate(explanation.steps, 1):
            others = len(step.choices) - 1
            more = f' (or {pluralize(others, "other")})' if others > 0 else ''
            then = f'; then {step.chosen}{more}' if step.chosen else '; then nothing is allowed, because of'
            yield f'  {number:2}. {happening(step)}{then}'
        if explanation.stuck:
            yield from (f'        {one}' for one in explanation.stuck)
        else:
            yield '      … and so on forever; no other answer helps'
    yield ''
    yield 'What may help:'
    yield from (f'  - {remedy}' for remedy in explanation.remedies)


def happening(step: PlayStep) -> str:
    """Return what the world does in a step."""
    if ' ends by ' in step.world:
        return step.world
    return f'{step.doing} goes on' if step.doing.partition(' ')[0] not in ('nothing', 'the') else 'at the start'


def step_through(
    play: CounterPlay, problem: SynthesisProblem, ask: Callable[[str], str], tell: Callable[[str], None]
) -> None:
    """Let the user play the machine against a world that prevents the goal. ``ask`` raises EOFError at the end."""
    tell('You are the machine; the world prevents the goal. Type the number of an answer, or q.')
    if play.state is None and len(play.answers) == 1:
        play.answer(0)
    while True:
        tell(f'\n{state_text(play.state, problem)}: {world_text(play, problem)}')
        if not play.answers:
            tell('Nothing is allowed now:')
            for one in play.why_none():
                tell(f'  - {one}')
            return
        for number, choice in enumerate(answers_text(play, problem), 1):
            tell(f'  {number}. {choice}')
        while True:
            try:
                word = ask(f'1-{len(play.answers)}, q> ').strip().lower()
            except EOFError:
                return
            if word in ('q', 'quit', 'exit'):
                return
            if word.isascii() and word.isdigit() and len(word) < 5 and 1 <= int(word) <= len(play.answers):
                play.answer(int(word) - 1)
                break
            tell(f'  there is no answer {short_repr(word)}')


# Machines as messages of FlexBE, where the package ``flexbe_msgs`` is installed.


def flexbe_messages(machine: SynthesizedMachine) -> list[Any]:
    """Return the machine as ``flexbe_msgs/StateInstantiation[]``, each field checked against the installed definition.

    Raises:
        SynthesisError: FlexBE's form does not hold this machine.
        FlexbtError: ``flexbe_msgs`` is not installed.
        FieldError: the installed definition has other fields.
    """
    messages: list[Any] = from_plain(
        state_instantiations(machine), resolve_type('flexbe_msgs/msg/StateInstantiation[]')
    )
    return messages
