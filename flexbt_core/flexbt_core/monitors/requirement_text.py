# SPDX-License-Identifier: BSD-3-Clause
"""Requirements as a mission engineer writes them, one per line, and files of them.

===========================================  =========================================================================
Text                                         Meaning
===========================================  =========================================================================
``never EVENT``                              it does not happen
``EVENT at most 3 times``                    it happens no more often
``EVENT at most 1 time in 2 s``              in any period of this length (ms, s, min)
``EVENT only after EVENT``                   the second happens at some time before the first
``EVENT only after EVENT, 3 times``          the second happens 3 times before the first
``EVENT only after EVENT, each time anew``   again since the last time (or ``, 3 times, each time anew``)
``after EVENT comes /Path or =outcome``      one of these follows at once (of a machine)
``after EVENT, EVENT within 10 s``           it follows in time (ms, s, min)
``after EVENT, EVENT before the end``        it follows, unless the run is stopped (``, up to 3 times``: or has already
                                             followed that often, for retries)
``A never while B``                          these states or leaves are not active at the same time
``A works only while C holds``               the condition is checked and holds (or ``fails``) while the leaf is active
                                             (of a tree)
``EVENT only with KEY and KEY written``      the userdata was written, and is not a default (of a machine; proved only)
``EVENT is always still possible``           the event can always still be reached (proved only)
``NAME is a TYPE``                           a leaf, another node, or a state is of this type
``NAME has PORT=TEXT and PORT={key}``        its ports have these values
===========================================  =========================================================================

Events are those of :mod:`flexbt_core.monitors.requirements`. A file lists requirements by the name of a behavior or
the ID of a tree::

    Inspect Site:
      - /Drive only after /Plan > done, each time anew
      - after /Alarm > raised, /Retreat within 5 s
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Final, NamedTuple

from flexbt_core.behavior_tree.model.status import FAILURE, SUCCESS
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.model.autonomy import AUTONOMY_NAMES
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.yaml_data import YamlParts, line_of

from .requirements import (
    After,
    Apart,
    AtMost,
    Before,
    Has,
    IsA,
    Never,
    NodeOrState,
    NodesOrStates,
    Possible,
    Requirement,
    While,
    Within,
    Written,
)

LONGEST: Final = 500
"""Maximum length of a requirement, characters."""

_SECONDS: Final = {'ms': 0.001, 's': 1.0, 'min': 60.0}
_NUMBER: Final = r'(\d{1,12}(?:\.\d{1,30})?)'
_FORMS: Final[tuple[tuple[str, Callable[..., Requirement]], ...]] = (
    (r'never (.+)', Never),
    (
        rf'(.+) at most (\d{{1,9}}) times?(?: in {_NUMBER} (ms|s|min))?',
        lambda event, times, number, unit: AtMost(event, int(times), _seconds(number, unit)),
    ),
    (r'(.+) only with (.+) written', lambda event, keys: Written(event, tuple(_parts(keys, 'and')))),
    (
        r'(.+) only after (.+?)(?:, (\d{1,9}) times?)?(, each time anew)?',
        lambda event, needs, times, again: Before(event, needs, bool(again), int(times or 1)),
    ),
    (
        r'after (.+), (.+?) before the end(?:, up to (\d{1,9}) times?)?',
        lambda event, then, times: Within(event, then, times=int(times) if times else None),
    ),
    (
        rf'after (.+), (.+) within {_NUMBER} (ms|s|min)',
        lambda event, then, number, unit: Within(event, then, _seconds(number, unit)),
    ),
    (r'after (.+) comes (.+)', lambda event, allowed: After(event, tuple(_parts(allowed, 'or')))),
    (
        r'(.+) works only while (.+) (holds|fails)',
        lambda works, condition, how: While(works, condition, how == 'holds'),
    ),
    (r'(.+) never while (.+)', Apart),
    (r'(.+) is always still possible', Possible),
)
_IS_A: Final = re.compile(r'(.+) is an? (\S+)')
_HAS: Final = re.compile(r'(.+?) has ([\w/]+=.*)')
_NEXT: Final = re.compile(r' and (?=[\w/]+=)')
"""Separator of two ports."""
_EXAMPLES: Final = (
    '"never A", "A at most 3 times", "A at most 1 time in 2 s", "A only after B", "A only after B, 3 times", '
    '"A only after B, each time anew", "after A comes B or C", "after A, B within 5 s", "after A, B before the end", '
    '"after A, B before the end, up to 3 times", "A never while B", "A works only while C holds", '
    '"A only with KEY written", "A is always still possible", "A is a TYPE", "A has PORT=TEXT"'
)


class RequirementError(FlexbtError):
    """Requirements cannot be read, or name missing parts; ``problems`` lists all problems with their places."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(problems)
        super().__init__('\n'.join(self.problems))


class StatedRequirement(NamedTuple):
    """A requirement and its place: a file with its line, or the option of a command."""

    requirement: Requirement
    place: str


def parse_requirement(text: str, place: str) -> StatedRequirement:
    """Read one requirement. Raises RequirementError."""
    line = ' '.join(text.split())
    if len(line) > LONGEST:
        raise RequirementError([f'{place}: a requirement has at most {LONGEST} characters, not {len(line)}'])
    for form, make in _FORMS:
        match = re.fullmatch(form, line)
        if match is not None:
            made = make(*map(_event, match.groups('')))
            problem = _unfit(made)
            if problem:
                raise RequirementError([f'{place}: "{line}": {problem}'])
            return StatedRequirement(made, place)
    if (match := _IS_A.fullmatch(line)) is not None:
        return StatedRequirement(IsA(_event(match[1]), match[2]), place)
    if (match := _HAS.fullmatch(line)) is not None:
        values = [part.partition('=') for part in _NEXT.split(match[2])]
        return StatedRequirement(Has(_event(match[1]), tuple((port, text) for port, _, text in values)), place)
    raise RequirementError([f'{place}: "{line}" is not a requirement; write one of {_EXAMPLES}'])


def read_requirements(text: str, source: str) -> dict[str, tuple[StatedRequirement, ...]]:
    """Read a file of requirements, by behavior name or tree ID. Raises RequirementError with all problems."""
    parts = YamlParts(source)
    found: dict[str, tuple[StatedRequirement, ...]] = {}
    for name, node in parts.mapping(parts.root(text), 'the file').items():
        stated = []
        for one in parts.sequence(node, f'what is required of {short_repr(name)}'):
            line = parts.name(one, 'a requirement')
            try:
                stated.append(parse_requirement(line, f'{source}:{line_of(one)}'))
            except RequirementError as error:
                parts.problems += error.problems if line else ()
        found[name] = tuple(stated)
    if parts.problems:
        raise RequirementError(parts.problems)
    return found


def _seconds(number: str, unit: str) -> float | None:
    return float(number) * _SECONDS[unit] if number else None


def _parts(text: str, word: str) -> list[str]:
    return [_event(part) for part in text.split(f' {word} ')]


def _event(text: str) -> str:
    left, arrow, outcome = text.strip().partition('>')
    return f'{left.strip()} > {outcome.strip()}' if arrow else left.strip()


def _unfit(made: Requirement) -> str:
    if isinstance(made, AtMost) and made.times < 1:
        return 'a number of times is 1 at least; write "never" for none'
    if isinstance(made, Before | Within) and made.times is not None and made.times < 1:
        return 'a number of times is 1 at least'
    if isinstance(made, Within | AtMost) and made.seconds is not None and not 0.0 < made.seconds < math.inf:
        return 'a time is above 0'
    return ''


# -- the names that requirements can use -----------------------------------------------------------------------------


class Vocabulary(NamedTuple):
    """The names that requirements of a machine or tree can use: ``events``, ``working`` (parts that work for a time),
    ``conditions`` of a tree, ``keys`` of the userdata of a machine, and all ``parts``."""

    events: Collection[str]
    working: Collection[str]
    conditions: Collection[str]
    keys: Collection[str]
    parts: NodesOrStates
    is_tree: bool


def machine_vocabulary(machine: MachineDefinition) -> Vocabulary:
    """Return the vocabulary of a machine."""
    nodes = [node for node in machine.nodes() if node is not machine]
    ends = [f'={outcome}' for outcome in machine.outcomes]
    left = [f'{node.path} > {outcome}' for node in nodes for outcome in node.outcomes]
    states = [node.path for node in nodes if not isinstance(node, MachineDefinition)]
    keys = {*machine.input_keys, *machine.defaults}
    keys.update(key for node in machine.children.values() for key in _keys_of(node))
    events = [*(node.path for node in nodes), *left, *ends]
    return Vocabulary(events, states, (), keys, machine_parts(machine), False)


def machine_parts(machine: MachineDefinition) -> NodesOrStates:
    """Return the parts of the machine: states and machines, with the machine keys that their keys map to and the
    parameters of states, such as ``tree``; and transitions, ``/Path > outcome``, with the ``autonomy`` that they
    require."""
    found: dict[str, list[NodeOrState]] = {}
    for node in machine.nodes():
        if node is machine:
            continue
        owner = node if isinstance(node, MachineDefinition) else node.state
        keys = {key: f'{{{node.remap.get(key, key)}}}' for key in (*owner.input_keys, *owner.output_keys)}
        made_with = {} if isinstance(node, MachineDefinition) else node.state.made_with
        found[node.path] = [NodeOrState(owner.type_name, {**made_with, **keys})]
        for outcome, way in node.transitions.items():
            level = AUTONOMY_NAMES.get(way.autonomy, '')
            found[f'{node.path} > {outcome}'] = [NodeOrState('transition', {'autonomy': level} if level else {})]
    return found


def _keys_of(node: StateDefinition | MachineDefinition) -> Iterator[str]:
    owner = node if isinstance(node, MachineDefinition) else node.state
    return (node.remap.get(key, key) for key in (*owner.input_keys, *owner.output_keys))


def tree_vocabulary(leaves: Iterable[tuple[str, bool]], parts: NodesOrStates) -> Vocabulary:
    """Return the vocabulary of a tree. ``leaves`` are pairs of a name and whether the leaf takes time; ``parts`` are
    all nodes."""
    found = list(leaves)
    names = list(dict.fromkeys(name for name, _ in found))
    working = list(dict.fromkeys(name for name, takes_time in found if takes_time))
    results = [f'{name} > {status.name}' for name in names for status in (SUCCESS, FAILURE)]
    ends = [f'={status.name}' for status in (SUCCESS, FAILURE)]
    return Vocabulary(
        [*names, *results, *(f'{name} > halted' for name in working), *ends],
        working,
        [name for name, takes_time in found if not takes_time],
        (),
        parts,
        True,
    )


def problems_with(stated: Iterable[StatedRequirement], known: Vocabulary, what: str) -> list[str]:
    """Return the problems, with places, of requirements about parts that ``what`` does not have."""
    return [f'{one.place}: "{one.requirement}": {text}' for one in stated for text in _unknown(one, known, what)]


def _unknown(stated: StatedRequirement, known: Vocabulary, what: str) -> Iterator[str]:
    one = stated.requirement
    only = 'a tree' if isinstance(one, While) else 'a machine' if isinstance(one, After | Written) else ''
    if only and only != ('a tree' if known.is_tree else 'a machine'):
        yield f'this can be required of {only} only'
        return
    if isinstance(one, IsA | Has):
        if one.name not in known.parts:
            yield f"{what} has nothing called '{one.name}'{did_you_mean(one.name, known.parts)}"
        return
    if isinstance(one, Apart | While):
        names = [one.one, one.other] if isinstance(one, Apart) else [one.works]
        for name in names:
            if name not in known.working:
                kind = 'leaf that takes time' if known.is_tree else 'state'
                yield f"{what} has no {kind} '{name}'{did_you_mean(name, known.working)}"
        if isinstance(one, Apart) and one.one == one.other and len(known.parts.get(one.one, ())) == 1:
            yield f"{what} has one '{one.one}' only, and that is never beside itself"
        if isinstance(one, While) and one.condition not in known.conditions:
            yield f"{what} has no condition '{one.condition}'{did_you_mean(one.condition, known.conditions)}"
        return
    events = [one.event]
    if isinstance(one, Before):
        events.append(one.needs)
    elif isinstance(one, Within):
        events.append(one.then)
    elif isinstance(one, After):
        events += one.allowed
    elif isinstance(one, Written):
        for key in one.keys:
            if key not in known.keys:
                yield f"the userdata of {what} has no key '{key}'{did_you_mean(key, known.keys)}"
    for event in events:
        if event not in known.events:
            yield f"{what} has no event '{event}'{did_you_mean(event, known.events)}"
    if isinstance(one, After) and ' > ' not in one.event:
        yield f"'{one.event}' is not a state left by an outcome: write '{one.event} > OUTCOME'"
