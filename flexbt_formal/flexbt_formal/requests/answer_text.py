# SPDX-License-Identifier: BSD-3-Clause
"""Explanations as lines for an engineer, and a play that is stepped through."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from flexbt_core.values import counted, shown
from flexbt_formal.synthesis.explanation import CounterPlay, Explanation, Step, answers_text, state_text, world_text
from flexbt_formal.synthesis.inputs import Problem


def explanation_lines(explanation: Explanation) -> Iterator[str]:
    """What there is to say about a request that no machine fulfils."""
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
            more = f' (or {counted(others, "other")})' if others > 0 else ''
            then = f'; then {step.chosen}{more}' if step.chosen else '; then nothing is allowed, because of'
            yield f'  {number:2}. {happening(step)}{then}'
        if explanation.stuck:
            yield from (f'        {one}' for one in explanation.stuck)
        else:
            yield '      … and so on for ever; no other answer helps'
    yield ''
    yield 'What may help:'
    yield from (f'  - {remedy}' for remedy in explanation.remedies)


def happening(step: Step) -> str:
    """What the world does in a step."""
    if ' ends by ' in step.world:
        return step.world
    return f'{step.doing} goes on' if step.doing.partition(' ')[0] not in ('nothing', 'the') else 'at the start'


def step_through(play: CounterPlay, problem: Problem, ask: Callable[[str], str], tell: Callable[[str], None]) -> None:
    """Lets somebody be the machine, against a world that prevents the goal. ``ask`` raises EOFError at the end."""
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
            tell(f'  there is no answer {shown(word)}')
