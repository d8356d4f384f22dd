# SPDX-License-Identifier: BSD-3-Clause
"""Files, interfaces of states and answers of a synthesis as text, for commands and the executive."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from flexbt_common.values.value_types import from_plain, resolve_type
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.values.text import did_you_mean, pluralize, short_repr
from flexbt_formal.synthesis.capabilities import (
    Interfaces,
    Mappings,
    StateInterface,
    UnknownParameterError,
    read_capabilities,
    read_mappings,
)
from flexbt_formal.synthesis.explanation import CounterPlay, Explanation, PlayStep, answers_text, state_text, world_text
from flexbt_formal.synthesis.from_strategy import SynthesizedMachine
from flexbt_formal.synthesis.hand_written import hand_written, is_whole
from flexbt_formal.synthesis.machine_text import state_instantiations
from flexbt_formal.synthesis.request_files import MachineRequest, read_specification
from flexbt_formal.synthesis.translation import Options, SynthesisProblem, translated
from flexbt_onboard.behaviors.machine_behavior import states_of
from flexbt_onboard.errors import BrokenBehaviorError
from flexbt_tools.errors import UsageError
from flexbt_tools.files import read_text_file

MAX_BYTES: Final = 4_000_000
"""Maximum size of an input file of a synthesis, bytes."""

T = TypeVar('T')


@dataclass(frozen=True, slots=True)
class SynthesisFiles:
    """The text of the capabilities and its name, and the names of the mapping files (the last one that has an entry
    wins) and of a specification."""

    capabilities: tuple[str, str] | None
    mappings: Sequence[str] = ()
    specification: str | None = None


def read_problem(
    files: SynthesisFiles, request: MachineRequest, interfaces: Interfaces, options: Options
) -> SynthesisProblem:
    """Return the problem that files and request describe. A complete specification needs no capabilities.

    Raises:
        SynthesisError: with all problems of the files, each with file and line.
        UsageError: a file cannot be read, or no file is given.
    """
    given = None if files.specification is None else read(files.specification, read_specification)
    if files.capabilities is None:
        if given is None:
            raise UsageError('name a capability file, or a whole specification by --spec')
        return hand_written(given, request)
    capabilities = read_capabilities(*files.capabilities, _mappings(files.mappings))
    if given is not None and is_whole(given, capabilities):
        return hand_written(given, request, capabilities, interfaces)
    return translated(capabilities, interfaces, request, given, options)


def _mappings(names: Sequence[str]) -> Mappings:
    mappings = Mappings() if names else Mappings(_USUAL, {'finished': 'finished'})
    for name in names:
        mappings = mappings.updated(read(name, read_mappings))
    return mappings


_USUAL = {
    **dict.fromkeys(('done', 'finished', 'received', 'true'), 'completed'),
    **dict.fromkeys(
        ('aborted', 'canceled', 'data_error', 'empty', 'failed', 'false', 'no_connection', 'param_error', 'timeout'),
        'failure',
    ),
    'unavailable': 'failure',
}


def read(name: str, reader: Callable[[str, str], T]) -> T:
    """Return the result of ``reader`` for a file. Raises UsageError if the file cannot be read."""
    return reader(read_text_file(name, MAX_BYTES), name)


# Interfaces of installed state classes.


class StateInterfaces:
    """The states of modules by name; the last module that has a name wins.

    A name may include the module: ``package/Name``. ``others`` is searched for states that no module has.
    """

    def __init__(self, modules: Sequence[str], others: Interfaces | None = None) -> None:
        self._others = others
        self._classes: dict[str, type[EventState]] = {}
        self._modules: dict[str, str] = {}
        for module in modules:
            try:
                found = states_of([module])
            except BrokenBehaviorError as error:
                raise UsageError(f'--states {module}: {error}') from error
            for name, value in found.items():
                for known in (name, f'{module.partition(".")[0]}/{name}'):
                    self._classes[known] = value
                    self._modules[known] = module

    def module_of(self, name: str) -> str:
        """Return the module from which a state is imported."""
        return self._modules.get(name, 'my_states')

    def __call__(self, name: str, parameters: Mapping[str, Any]) -> StateInterface:
        """Return the interface of a state that is built with these parameters."""
        if name not in self._classes:
            if self._others is not None:
                return self._others(name, parameters)
            known = [one for one in self._classes if '/' not in one]
            raise LookupError(
                f"there is no state '{name}'{did_you_mean(name, known)}; --states names modules with more"
            )
        taken = inspect.signature(self._classes[name]).parameters.values()
        known = [one.name for one in taken if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)]
        unknown = next((one for one in parameters if one not in known), None)
        if unknown is not None and not any(one.kind is one.VAR_KEYWORD for one in taken):
            raise UnknownParameterError(name, unknown, known)
        try:
            state = self._classes[name](**parameters)
        except Exception as error:  # code of the state
            raise ValueError(f'{name} cannot be made: {type(error).__name__}: {error}') from error
        return StateInterface(state.outcomes, state.input_keys, state.output_keys)


# Answers of a synthesis: explanations as text, counter-plays step by step, and machines as messages of FlexBE.


def explanation_lines(explanation: Explanation) -> Iterator[str]:
    """Yield the lines of the explanation for a request that no machine can fulfill."""
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
    """Describe the world's move in a step."""
    if ' ends by ' in step.world:
        return step.world
    return f'{step.doing} continues' if step.doing.partition(' ')[0] not in ('nothing', 'the') else 'at the start'


def step_through(play: CounterPlay, problem: SynthesisProblem) -> None:
    """Let the user play the machine against a world that prevents the goal, on the terminal."""
    print('You are the machine; the world prevents the goal. Type the number of an answer, or q.')
    if play.state is None and len(play.answers) == 1:
        play.answer(0)
    while True:
        print(f'\n{state_text(play.state, problem)}: {world_text(play, problem)}')
        if not play.answers:
            print('Nothing is allowed now:')
            for one in play.why_none():
                print(f'  - {one}')
            return
        for number, choice in enumerate(answers_text(play, problem), 1):
            print(f'  {number}. {choice}')
        while True:
            try:
                word = input(f'1-{len(play.answers)}, q> ').strip().lower()
            except EOFError:
                return
            if word in ('q', 'quit', 'exit'):
                return
            if word.isascii() and word.isdigit() and len(word) < 5 and 1 <= int(word) <= len(play.answers):
                play.answer(int(word) - 1)
                break
            print(f'  there is no answer {short_repr(word)}')


# Machines as messages of FlexBE; requires the package ``flexbe_msgs``.


def flexbe_messages(machine: SynthesizedMachine) -> list[Any]:
    """Return the machine as ``flexbe_msgs/StateInstantiation[]``, each field checked against the installed definition.

    Raises:
        SynthesisError: FlexBE's message format cannot represent this machine.
        FlexbtError: ``flexbe_msgs`` is not installed.
        FieldError: the installed definition has other fields.
    """
    messages: list[Any] = from_plain(
        state_instantiations(machine), resolve_type('flexbe_msgs/msg/StateInstantiation[]')
    )
    return messages
