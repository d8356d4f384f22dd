# SPDX-License-Identifier: BSD-3-Clause
"""From capabilities, a specification and a request to formulas.

The formulas are those of flexbe_synthesis: in each step exactly one capability or outcome of the machine is active;
the outcome of an active capability arrives in the next step; pre- and postconditions are about the memory. Options add
limits on retries, fairness of outcomes, giving up as a last resort, and concurrent capabilities, if their resources are
known.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from itertools import combinations
from typing import Final

from flexbt_core.values.text import did_you_mean, short_repr, truncate_middle

from .capabilities import (
    TIMEOUT,
    Capability,
    CapabilityFile,
    Interfaces,
    StateInterface,
    UnknownParameterError,
    concurrent_pairs,
)
from .errors import SynthesisError
from .formulas import Formula, FormulaError, Ranges, names_in, parse_formula
from .request_files import FAILURE_OUTCOMES, MachineRequest, SpecificationFile
from .specification import GameVariable, Section, Specification, SpecificationLine
from .yaml_nodes import YamlEntry

# Names of activations, outcomes and memory in formulas, and the reading of valuations.
#
# Either each capability ``a`` has an activation ``a_a`` and its outcomes ``a_c``, ``a_f`` (the first letters of
# ``completed``, ``failure``, as many as make them different), or (*parsed*) an integer ``capability`` says which one is
# active, and the outcomes are inputs by their full names.

CAPABILITY: Final = 'capability'

_KINDS: Final = 'axp'
"""Suffixes of a capability that is active, was given up, or has not completed yet (is pending)."""


@dataclass(frozen=True)
class Vocabulary:
    """The names of a system. ``outcomes`` are the normalized outcomes that each capability can have; ``ends`` the
    outcomes of the machine and the propositions for them; ``numbers`` those of capabilities where they are parsed."""

    outcomes: Mapping[str, tuple[str, ...]]
    suffixes: Mapping[str, str]
    ends: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, int] | None = None

    def active(self, capability: str, *, primed: bool = False) -> str:
        """Return the proposition that a capability is active."""
        prime = "'" if primed else ''
        if self.numbers is not None:
            return f'({CAPABILITY}{prime}={self.numbers[capability]})'
        return f'{capability}_a{prime}'

    def arrives(self, capability: str, outcome: str) -> str:
        """Return the proposition that an outcome of a capability arrives with the next step."""
        if self.numbers is not None:
            return f"({self.active(capability)} & {outcome}')"
        return f"{capability}_{self.suffixes[outcome]}'"

    def active_in(self, values: Mapping[str, int]) -> tuple[str, ...]:
        """Return the capabilities that are active in a valuation."""
        if self.numbers is not None:
            return tuple(one for one, number in self.numbers.items() if values.get(CAPABILITY) == number)
        return tuple(one for one in self.outcomes if values.get(f'{one}_a'))

    def arrived_in(self, values: Mapping[str, int], capability: str) -> tuple[str, ...]:
        """Return the outcomes of a capability that inputs tell, given that it was active."""
        return tuple(one for one in self.outcomes[capability] if values.get(self.input_of(capability, one)))

    def input_of(self, capability: str, outcome: str) -> str:
        """Return the input that reports an outcome."""
        return outcome if self.numbers is not None else f'{capability}_{self.suffixes[outcome]}'

    def ends_in(self, values: Mapping[str, int]) -> tuple[str, ...]:
        """Return the outcomes of the machine that are reached in a valuation."""
        return tuple(outcome for outcome, proposition in self.ends.items() if values.get(proposition))

    def is_own(self, name: str) -> bool:
        """Return whether a variable is one of the translation: an activation, an outcome of a capability or of the
        machine, or the mark of a capability that was given up or has not completed yet."""
        return name in self._own

    @cached_property
    def _own(self) -> frozenset[str]:
        marks = (f'{capability}_{kind}' for capability in self.outcomes for kind in _KINDS)
        told = (self.input_of(capability, one) for capability, outcomes in self.outcomes.items() for one in outcomes)
        return frozenset((*marks, *told, *self.ends.values(), CAPABILITY))


def suffixes(outcomes: Sequence[str], marks: str = 'a') -> dict[str, str]:
    """Return the shortest prefix of each outcome that no other one has, and that is neither a mark nor the memory."""
    found = {}
    for outcome in outcomes:
        lengths = range(1, len(outcome) + 1)
        taken = [*marks, 'm', *(other for other in outcomes if other != outcome)]
        found[outcome] = next(
            (outcome[:n] for n in lengths if not any(other.startswith(outcome[:n]) for other in taken)), outcome
        )
    return found


_WORD: Final = re.compile(r"([A-Za-z_]\w*)('?)")
_CONDITION: Final = re.compile(r'(!?)\s*(@?)([A-Za-z_]\w*)\s*(?:=\s*(\w+))?')
_LATER: Final = re.compile(r"'|\bnext\s*\(")
_WORDS_OF_FORMULAS: Final = ('next', 'TRUE', 'FALSE', 'true', 'false')

GAVE_UP: Final = 'failed'
"""The outcome that a machine gets which has a limit on retries, where the request has no failure outcome."""

OBJECTIVE: Final = 'the outcome of the machine stands for the goal'
"""The rule of what links the outcomes of the machine with the goals."""

ONE_ACTIVE: Final = 'one capability, or outcome of the machine, is active, or several that may be concurrent'
"""The rule of what can be active at once."""


class Liveness(Enum):
    """The assumptions about failures, and the definition of success.

    FAIR: a capability that is tried repeatedly in the same state completes at some time; only the goal is success.
    ADVERSARIAL: nothing is assumed, but failing repeatedly is success, too (flexbe_synthesis' default).
    FAIR_OUTCOMES: again and again each capability is inactive or completes (flexbe_synthesis' other one).
    """

    FAIR = 'fair'
    ADVERSARIAL = 'adversarial'
    FAIR_OUTCOMES = 'fair-outcomes'


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a translation. ``retries``: a capability is given up after this many further failures in a row."""

    liveness: Liveness = Liveness.FAIR
    retries: int | None = None
    pending: bool = False
    parsed: bool = False


@dataclass(frozen=True, slots=True)
class SynthesisProblem:
    """A problem to solve, and how its valuations are read; ``notes`` are for the user."""

    specification: Specification
    vocabulary: Vocabulary
    interfaces: Mapping[str, StateInterface]
    file: CapabilityFile
    request: MachineRequest
    options: Options
    notes: tuple[str, ...] = ()

    @property
    def hoped(self) -> str:
        """The normalized outcome that counts as success."""
        return self.file.mappings.transition_outcomes[0]

    def normalized(self, outcome: str) -> str:
        """Return the normalized outcome for an outcome of a state."""
        return self.file.mappings.state_outcomes[outcome]

    def formula(self, text: str) -> Formula:
        """Return a formula over the variables. Raises FormulaError."""
        return parse_formula(text, self.specification.ranges)

    def holding(self, values: Mapping[str, int]) -> list[str]:
        """Return the variables of the user that a valuation sets: memory that is true, and integers with their
        labels."""
        found = []
        for name, value in values.items():
            label = self.file.labels.get(name, {}).get(value)
            if label is not None:
                found.append(f'{name}={label}')
            elif value and not self.vocabulary.is_own(name):
                found.append(name.removesuffix('_m') if value == 1 else f'{name}={value}')
        return found


def translated(
    capabilities: CapabilityFile,
    interfaces: Interfaces,
    request: MachineRequest,
    given: SpecificationFile | None = None,
    options: Options | None = None,
) -> SynthesisProblem:
    """Return the problem of capabilities that are to fulfil a request; ``given`` adds variables and formulas.

    Raises:
        SynthesisError: with everything that does not fit together, each with its place.
    """
    return Translation(capabilities, interfaces, request, given or SpecificationFile(''), options or Options()).made()


class Translation:
    """A translator that assembles formulas section by section and collects problems."""

    def __init__(
        self,
        file: CapabilityFile,
        interfaces: Interfaces,
        request: MachineRequest,
        given: SpecificationFile,
        options: Options,
    ) -> None:
        self._file, self._request, self._given, self._options = file, request, given, options
        self._problems: list[str] = []
        self._notes: list[str] = []
        self._texts: list[tuple[Section, str, str | None, str, str]] = []  # text, origin, place, rule
        self._rule = ''
        self._hoped = file.mappings.transition_outcomes[0]
        self._interfaces = self._found(interfaces)
        self._variables: dict[str, GameVariable] = {}
        self._setters: dict[str, list[str]] = {}
        self._vocabulary = self._named()
        self._memory = self._remembered()

    def made(self) -> SynthesisProblem:
        """Return the problem. Raises SynthesisError."""
        self._declare()
        self._begin()
        self._rules()
        self._objective()
        for section in self._given.formulas:
            if not section.value.endswith('_INIT'):
                for _, formula, origin, place in self._given_in(section):
                    self._add(section, formula, origin, place)
        if not any(section is Section.SYS_LIVENESS for section, *_ in self._texts):
            self._problem(None, 'nothing is asked for: give a goal, or SYS_LIVENESS in a specification')
        live, last_resort, hopes = self._promises()
        lines = self._parsed_lines()
        if self._problems:
            raise SynthesisError(dict.fromkeys(self._problems))
        # What may be concurrent and is not needed stays inactive.
        pairs = () if self._options.parsed else concurrent_pairs(self._file, self._interfaces)
        specification = Specification(
            self._variables,
            tuple(lines),
            tuple((self._formula(a), self._formula(o)) for a, o in live),
            None if last_resort is None else self._formula(last_resort),
            tuple(map(self._formula, hopes)),
            frozenset(f'{name}_a' for pair in pairs for name in pair),
        )
        words, notes = self._vocabulary, tuple(self._notes)
        return SynthesisProblem(specification, words, self._interfaces, self._file, self._request, self._options, notes)

    # -- names -------------------------------------------------------------------------------------------------------

    def _found(self, interfaces: Interfaces) -> dict[str, StateInterface]:
        found = {}
        for one in self._file.capabilities.values():
            parameters = {key: self._sample(value) for key, value in one.parameters.items()}
            try:
                found[one.name] = interfaces(one.interface, parameters)
            except (LookupError, ValueError) as error:
                if isinstance(error, UnknownParameterError) and error.parameter == TIMEOUT and one.deadline:
                    self._problem(
                        one.deadline,
                        f'deadline of capability {one.name}: it is the parameter {TIMEOUT} of a state, and '
                        f'{error.state} takes none{did_you_mean("", error.known)}; '
                        'leave the deadline out, or name a state that takes one',
                    )
                    continue
                text = str(error.args[0]) if error.args else type(error).__name__
                self._problem(one.line, f'capability {one.name}: {text}')
                continue
            self._check_interface(one, found[one.name])
        if self._problems:
            raise SynthesisError(self._problems)
        return found

    def _sample(self, value: object) -> object:
        """Return a value for a parameter that synthesis chooses."""
        if isinstance(value, str) and value.startswith('@'):
            return next(iter(self._file.labels.get(value[1:], {}).values()), '')
        return value

    def _check_interface(self, one: Capability, interface: StateInterface) -> None:
        def problem(text: str) -> None:
            self._problem(one.line, f'capability {one.name}: {text}')

        mappings = self._file.mappings
        normal = ', '.join(mappings.transition_outcomes)
        for outcome in interface.outcomes:
            normalized = mappings.state_outcomes.get(outcome)
            if normalized is None:
                problem(
                    f"its outcome '{outcome}' counts as nothing; add '{outcome}: {self._hoped}', or another one of "
                    f'{normal}, to state_outcome_mappings'
                )
            elif normalized not in mappings.transition_outcomes:
                what = f"its outcome '{outcome}' is mapped to '{normalized}'"
                problem(f'{what}, which is none of transition_outcomes ({normal})')
        for outcome in one.autonomy:
            if outcome not in interface.outcomes:
                problem(f"autonomy for '{outcome}'{did_you_mean(outcome, interface.outcomes)}")
        for kind, given, known in (
            ('userdata_in', one.userdata_in, interface.input_keys),
            ('userdata_out', one.userdata_out, interface.output_keys),
        ):
            for key in given:
                if known is not None and key not in known:
                    problem(f"{kind} has '{key}'{did_you_mean(key, known)}")
        for key in sorted({*(interface.input_keys or ()), *one.userdata_in}):
            if key in {*(interface.output_keys or ()), *one.userdata_out}:
                read, written = one.userdata_in.get(key, key), one.userdata_out.get(key, key)
                if read != written:
                    problem(f"userdata '{key}' is read as '{read}' and written as '{written}'; remap both to one name")

    def _named(self) -> Vocabulary:
        mappings = self._file.mappings
        outcomes = {}
        for name in sorted(self._file.capabilities):
            own = {mappings.state_outcomes[outcome] for outcome in self._interfaces[name].outcomes}
            outcomes[name] = tuple(one for one in mappings.transition_outcomes if one in own)
        ends = self._ends()
        if self._options.retries is not None and not FAILURE_OUTCOMES & ends.keys():
            ends[GAVE_UP] = GAVE_UP
            self._notes.append(f"the machine has the outcome '{GAVE_UP}', for when retries are used up")
        self._check_names(ends)
        numbers = {name: number for number, name in enumerate(outcomes, 1)} if self._options.parsed else None
        return Vocabulary(outcomes, suffixes(mappings.transition_outcomes, self._marks), ends, numbers)

    def _check_names(self, ends: Mapping[str, str]) -> None:
        taken = {
            **dict.fromkeys(_WORDS_OF_FORMULAS, 'a word of formulas'),
            **dict.fromkeys(ends.values(), 'an outcome'),
            **{f'{name}_m': f'the memory of {name}' for name in (*self._file.capabilities, *self._file.memory)},
            **{
                f'{name}_{kind}': f'a proposition of {name}'
                for name in self._file.capabilities
                for kind in (*self._marks, *suffixes(self._file.mappings.transition_outcomes, self._marks).values())
            },
        }
        lines = {name: one.line for name, one in self._file.capabilities.items()}
        for name in dict.fromkeys((*lines, *self._file.memory, *self._file.labels)):
            if name in taken:
                self._problem(lines.get(name, 1), f"'{name}' is {taken[name]} already: call it otherwise")

    @property
    def _marks(self) -> str:
        """Suffixes of what a capability has besides its outcomes and its memory."""
        return 'a' + 'x' * (self._options.retries is not None) + 'p' * self._options.pending

    def _ends(self) -> dict[str, str]:
        """Return the outcomes of the machine, with the propositions for them."""
        mappings = self._file.mappings
        asked = self._request.outcomes
        if not asked and self._request.goals and 'finished' in mappings.machine_outcomes:
            asked = ('finished',)
        ends = {}
        for outcome in asked:
            if outcome in mappings.machine_outcomes:
                ends[outcome] = mappings.machine_outcomes[outcome]
            elif outcome in FAILURE_OUTCOMES:
                ends[outcome] = outcome
            else:
                self._problem(
                    None,
                    f"the machine is to have the outcome '{outcome}', for which sm_outcome_mappings has no "
                    f"proposition; add '{outcome}: {outcome}' to it",
                )
        alike = [outcome for outcome, end in ends.items() if list(ends.values()).count(end) > 1]
        if alike:
            self._problem(None, f'the outcomes {", ".join(alike)} have one proposition; give each its own')
        return ends

    def _remembered(self) -> dict[str, bool]:
        """Return the initial values of the memory, by name without suffix."""
        memory = dict(self._file.memory)
        texts = [*self._request.initial_conditions, *self._request.goals]
        for one in self._file.capabilities.values():
            for entries in (one.preconditions, *one.postconditions.values()):
                texts += [entry.text for entry in entries]
        for text in texts:
            for word, _ in _WORD.findall(text):
                base = word.removesuffix('_m')
                if base in self._file.capabilities and word not in self._file.labels:
                    memory.setdefault(base, False)
        return memory

    # -- sections ----------------------------------------------------------------------------------------------------

    def _declare(self) -> None:
        words = self._vocabulary
        inputs = {
            words.input_of(one, outcome): None for one, outcomes in words.outcomes.items() for outcome in outcomes
        }
        if self._options.parsed:
            inputs = dict.fromkeys(self._file.mappings.transition_outcomes)
        outputs: dict[str, tuple[int, int] | None] = dict.fromkeys(words.ends.values())
        if self._options.parsed:
            outputs[CAPABILITY] = 0, len(words.outcomes)
        else:
            outputs |= dict.fromkeys(f'{one}_a' for one in words.outcomes)
        for name in self._memory:
            (inputs if name in self._file.world_memory else outputs)[f'{name}_m'] = None
        bounds = {name: (min(labels), max(labels)) for name, labels in self._file.labels.items()}
        for name, range_ in bounds.items():
            if name in self._file.world_integers:
                self._variables[name] = GameVariable(name, True, range_)
            else:
                outputs[name] = range_
        if self._options.retries is not None:
            outputs |= dict.fromkeys(f'{one}_x' for one in self._failing())
        if self._options.pending:
            outputs |= dict.fromkeys(f'{one}_p' for one in self._failing())
        self._variables |= {name: GameVariable(name, True) for name in sorted(inputs)}
        self._variables |= {name: GameVariable(name, False, outputs[name]) for name in sorted(outputs)}
        self._own = set(self._variables)
        for name, variable in self._given.variables.items():
            known = self._variables.get(name)
            if known is not None and known != variable:
                self._problems.append(
                    f"{self._given.source}: '{name}' is declared otherwise than the capabilities have it "
                    f'({"an input" if known.is_input else "an output"}, {known.values[0]} to {known.values[-1]})'
                )
            elif not (self._options.parsed and name.removesuffix('_a') in words.outcomes):
                self._variables.setdefault(name, variable)

    def _failing(self) -> list[str]:
        """Return the capabilities that have another outcome than success."""
        return [name for name, outcomes in self._vocabulary.outcomes.items() if set(outcomes) - {self._hoped}]

    def _fails(self, name: str) -> str:
        """Return the proposition that such a capability ends without success."""
        words = self._vocabulary
        return ' | '.join(words.arrives(name, one) for one in words.outcomes[name] if one != self._hoped)

    def _begin(self) -> None:
        """Add the initial conditions. A condition about a variable replaces its default; a request about one variable
        replaces what the specification says of that variable alone."""
        asked = [
            (self._expanded(text, False), f"initial condition '{truncate_middle(text)}' (request)", 'request')
            for text in self._request.initial_conditions
        ]
        alone = {names[0] for text, _, _ in asked if len(names := list(self._names(text))) == 1}
        for section in (Section.ENV_INIT, Section.SYS_INIT):
            for text, formula, origin, place in self._given_in(section):
                if self._names(formula) <= alone and len(self._names(formula)) == 1:
                    if formula not in [one for one, _, _ in asked]:
                        self._notes.append(
                            f"{place}: the request says otherwise than '{truncate_middle(text)}'; the request counts"
                        )
                    continue
                asked.append((formula, origin, place))
        mentioned: set[str] = set()
        for formula, origin, place in asked:
            about = self._names(formula)
            mentioned |= about
            known = [self._variables[name].is_input for name in about if name in self._variables]
            if any(known) and not all(known):
                self._notes.append(f'{origin} is about inputs and outputs: the system has to see to it')
            self._add(Section.ENV_INIT if known and all(known) else Section.SYS_INIT, formula, origin, place)
        self._begin_otherwise(mentioned)

    def _given_in(self, section: Section) -> Iterator[tuple[str, str, str, str]]:
        """Yield the given formulas of a section: text, formula, origin and place."""
        for text, line in self._given.formulas.get(section, ()):
            place = f'{self._given.source}:{line}'
            yield text, self._expanded(text, False), f"{section.value} '{truncate_middle(text)}' ({place})", place

    def _begin_otherwise(self, mentioned: set[str]) -> None:
        self._rule = 'what is not said otherwise is off at the start'
        words = self._vocabulary
        for name, variable in self._variables.items():
            if name in mentioned or name not in self._own:
                continue
            section = Section.ENV_INIT if variable.is_input else Section.SYS_INIT
            if variable.bounds is None:
                holds = name == 'begin_game_a' or (name.endswith('_m') and self._memory.get(name[:-2], False))
                self._add(section, name if holds else f'!{name}')
            elif name == CAPABILITY and self._options.parsed:
                self._add(section, f'({CAPABILITY}=0)')
        chosen = sorted(mentioned & {f'{one}_a' for one in words.outcomes})
        for one, other in combinations(chosen, 2):
            self._add(Section.SYS_INIT, f'!({one} & {other})')

    def _rules(self) -> None:
        self._capabilities()
        self._conditions()
        self._frames()
        self._values_without_gaps()

    def _capabilities(self) -> None:
        self._rule = ONE_ACTIVE
        words, add = self._vocabulary, self._add
        for name, outcomes in words.outcomes.items():
            active = words.active(name)
            answers = [f"{words.input_of(name, outcome)}'" for outcome in outcomes]
            add(Section.ENV_TRANS, f'{active} -> ({" | ".join(answers)})')
            if not self._options.parsed:
                for one, other in combinations(answers, 2):
                    add(Section.ENV_TRANS, f'{active} -> !({one} & {other})')
                for one in answers:
                    add(Section.ENV_TRANS, f'!{active} -> !{one}')
        ends = list(words.ends.values())
        for end in ends:
            add(Section.SYS_TRANS, f"{end} -> {end}'")
        if self._options.parsed:
            for one, other in combinations(self._file.mappings.transition_outcomes, 2):
                add(Section.ENV_TRANS, f"!({one}' & {other}')")
            # Upstream's formulas, kept with its liveness, demand that a capability is active even at the end.
            idle = self._options.liveness is Liveness.FAIR or self._options.retries is not None
            ended = ' | '.join(f"{end}'" for end in ends) if idle and ends else 'FALSE'
            add(Section.SYS_TRANS, f"({CAPABILITY}'!=0) <-> !({ended})")
            for one, other in combinations(ends, 2):
                add(Section.SYS_TRANS, f"!({one}' & {other}')")
            return
        choices = sorted([*(f"{one}_a'" for one in words.outcomes), *(f"{end}'" for end in ends)])
        add(Section.SYS_TRANS, f'({" | ".join(choices)})')
        together = {(f"{one}_a'", f"{other}_a'") for one, other in concurrent_pairs(self._file, self._interfaces)}
        for one, other in combinations(choices, 2):
            if (one, other) not in together:
                add(Section.SYS_TRANS, f'!({one} & {other})')

    def _conditions(self) -> None:
        to_failed: list[str] = []
        for one in self._file.capabilities.values():
            for outcome, entries in one.relations.items():
                self._relation(one, outcome, entries, to_failed)
            active = self._vocabulary.active(one.name, primed=True)
            for text, line in one.preconditions:
                place = f'{self._file.source}:{line}'
                if "'" in text:
                    self._problem(
                        line,
                        f"precondition '{truncate_middle(text)}' of {one.name}: "
                        "it is about one moment; leave out the '",
                    )
                    continue
                formula = self._expanded(text, True)
                origin = f"precondition '{truncate_middle(text)}' of {one.name} ({place})"
                self._add(Section.SYS_TRANS, f'!({formula}) -> !{active}', origin, place)
            for outcome, entries in one.postconditions.items():
                for entry in entries:
                    self._effect(one, outcome, entry)
        failed = self._vocabulary.ends.get('failed')
        if to_failed and failed:
            self._add(Section.SYS_TRANS, f"!({' | '.join([*to_failed, failed])}) -> !{failed}'")

    def _outcome_of(self, one: Capability, outcome: str, line: int, what: str) -> str | None:
        if outcome not in self._vocabulary.outcomes[one.name]:
            own = ', '.join(self._vocabulary.outcomes[one.name])
            self._problem(line, f"{what} of {one.name} after '{outcome}', which {one.interface} does not have ({own})")
            return None
        return self._vocabulary.arrives(one.name, outcome)

    def _relation(self, one: Capability, outcome: str, entries: Iterable[YamlEntry], to_failed: list[str]) -> None:
        words = self._vocabulary
        targets, texts, places = list[str](), list[str](), list[str]()
        for text, line in entries:
            arrives = self._outcome_of(one, outcome, line, 'transition_relation')
            name = text.removeprefix('!').strip()
            if arrives is None or name.startswith('@'):
                continue
            if name in words.outcomes:
                target = words.active(name, primed=True)
            elif name in words.ends:
                target = f"{words.ends[name]}'"
                to_failed += [arrives] if name == 'failed' and not text.startswith('!') else []
            else:
                known = [*words.outcomes, *words.ends]
                self._problem(
                    line,
                    f'transition_relation of {one.name}: there is no {short_repr(name)}{did_you_mean(name, known)}',
                )
                continue
            place = f'{self._file.source}:{line}'
            if text.startswith('!'):
                origin = f"transition_relation '{truncate_middle(text)}' of {one.name} after {outcome} ({place})"
                self._add(Section.SYS_TRANS, f'{arrives} -> !{target}', origin, place)
            else:
                targets.append(target)
                texts.append(truncate_middle(text))
                places.append(place)
        if targets:
            origin = f"transition_relation '{' | '.join(texts)}' of {one.name} after {outcome} ({places[0]})"
            arrives = words.arrives(one.name, outcome)
            self._add(Section.SYS_TRANS, f'{arrives} -> ({" | ".join(targets)})', origin, places[0])

    def _effect(self, one: Capability, outcome: str, entry: YamlEntry) -> None:
        what = f"postcondition '{truncate_middle(entry.text)}' of {one.name}"
        arrives = self._outcome_of(one, outcome, entry.line, f"postcondition '{truncate_middle(entry.text)}'")
        parts = _CONDITION.fullmatch(entry.text)
        if parts is None:
            self._problem(entry.line, f'{what}: write NAME, !NAME, VARIABLE=VALUE or @VARIABLE')
            return
        negated, chosen, name, value = parts.groups()
        variable = name if value or chosen else self._proposition(name)
        known = self._variables.get(variable)
        if known is None or self._vocabulary.is_own(variable):
            reason = (
                'nothing but a capability itself sets that'
                if known
                else f'there is no variable {short_repr(name)}{did_you_mean(name, list(self._variables))}'
            )
            self._problem(entry.line, f'{what}: {reason}')
            return
        if arrives is None:
            return
        self._setters.setdefault(variable, []).append(arrives)
        if chosen:
            return
        effect = f"{negated}{variable}'" if value is None else f"({variable}'={self._value(variable, value)})"
        section = Section.ENV_TRANS if known.is_input else Section.SYS_TRANS
        place = f'{self._file.source}:{entry.line}'
        self._add(section, f'{arrives} -> {effect}', f'{what} after {outcome} ({place})', place)

    def _frames(self) -> None:
        """Add the frame conditions: a value that nothing changes stays the same."""
        self._rule = 'what nothing changes stays as it is'
        own = {f'{name}_m' for name in self._memory} | self._file.labels.keys()
        for name, variable in self._variables.items():
            if name not in own and name not in self._setters:
                continue
            setters = ' | '.join(dict.fromkeys(self._setters.get(name, ()))) or 'FALSE'
            section = Section.ENV_TRANS if variable.is_input else Section.SYS_TRANS
            if variable.bounds is not None:
                self._add(section, f"!({setters}) -> ({name}'={name})")
            else:
                self._add(section, f"(!({setters}) & {name}) -> {name}'")
                self._add(section, f"(!({setters}) & !{name}) -> !{name}'")

    def _values_without_gaps(self) -> None:
        """Exclude the numbers between the values of an integer that are none of them."""
        self._rule = 'an integer has one of its values'
        for name, labels in self._file.labels.items():
            variable = self._variables[name]
            if len(labels) < len(variable.values):
                owner = 'ENV' if variable.is_input else 'SYS'
                self._add(Section[f'{owner}_INIT'], ' | '.join(f'{name}={number}' for number in labels))
                self._add(Section[f'{owner}_TRANS'], ' | '.join(f"{name}'={number}" for number in labels))

    # -- what is to be reached ---------------------------------------------------------------------------------------

    def _objective(self) -> None:
        self._rule = OBJECTIVE
        words, add = self._vocabulary, self._add
        goals = [
            (self._expanded(text, False), f"goal '{truncate_middle(text)}' (request)") for text in self._request.goals
        ]
        success = next((end for name, end in words.ends.items() if name not in FAILURE_OUTCOMES), None)
        self._hopes: list[str] = [success] if success else [goal for goal, _ in goals]
        if success and goals:
            final = 'log_finished' if success == 'finished' and 'log_finished' in words.outcomes else None
            target = words.active(final) if final else success
            target_next = words.active(final, primed=True) if final else f"{success}'"
            now = ' & '.join(f'({goal})' for goal, _ in goals)
            then = ' & '.join(self._later(goal) for goal, _ in goals)
            reached = then if any(map(self._is_about_steps, (goal for goal, _ in goals))) else f'!({now}) & {then}'
            for goal, origin in goals:
                add(Section.SYS_TRANS, f'(!{self._later(goal)} & !{target}) -> !{target_next}', origin, 'request')
            add(Section.SYS_TRANS, f'({reached}) -> {target_next}')
            if final:
                add(Section.SYS_TRANS, f"(!{words.arrives(final, self._hoped)} & !{success}) -> !{success}'")
        self._strive(goals, success)

    def _strive(self, goals: list[tuple[str, str]], success: str | None) -> None:
        """Liveness: what is to be reached again and again."""
        words, add = self._vocabulary, self._add
        excused = ''.join(f' | {end}' for end in words.ends.values() if end != success)
        if self._options.liveness is Liveness.ADVERSARIAL and self._options.retries is None:
            for name in self._failing():
                excused += f' | !({words.active(name)} -> {self._completes(name)})'
        if success:
            add(
                Section.SYS_LIVENESS,
                f'{success}{excused}',
                None if goals else f"outcome '{success}' (request)",
                'request',
            )
        else:
            for goal, origin in goals:
                add(Section.SYS_LIVENESS, f'({goal}){excused}', origin, 'request')
        if self._options.retries is not None:
            self._limits()
        if self._options.liveness is Liveness.FAIR_OUTCOMES or self._options.pending:
            self._owed()

    def _completes(self, name: str) -> str:
        words = self._vocabulary
        return words.arrives(name, self._hoped) if self._hoped in words.outcomes[name] else 'FALSE'

    def _later(self, goal: str) -> str:
        return f'({goal})' if self._is_about_steps(goal) else f'next({goal})'

    @staticmethod
    def _is_about_steps(formula: str) -> bool:
        return _LATER.search(formula) is not None

    def _limits(self) -> None:
        """Require that a capability that has used up its retries is not tried again."""
        self._rule = 'a capability that was given up is not tried again'
        for name in self._failing():
            self._add(Section.SYS_TRANS, f"{name}_x' <-> ({name}_x | {self._fails(name)})")
            self._add(Section.SYS_TRANS, f"{name}_x' -> !{self._vocabulary.active(name, primed=True)}")

    def _owed(self) -> None:
        """Track capabilities that have not completed, as flexbe_synthesis does. Pending flags are optional."""
        self._rule = 'what was started is owed until it completes'
        words = self._vocabulary
        for name in self._failing():
            active, active_next = words.active(name), words.active(name, primed=True)
            completes = self._completes(name)
            if self._options.pending:
                self._add(Section.SYS_TRANS, f"{active_next} -> {name}_p'")
                self._add(Section.SYS_TRANS, f"({active} & ({self._fails(name)})) -> {name}_p'")
                self._add(Section.SYS_TRANS, f"(!{active_next} & {active} & {completes}) -> !{name}_p'")
                self._add(Section.SYS_TRANS, f"!({active} | {active_next}) -> ({name}_p' <-> {name}_p)")
            if self._options.liveness is Liveness.FAIR_OUTCOMES:
                owed = f'{name}_p' if self._options.pending else active
                self._add(Section.ENV_LIVENESS, f'!{owed} | {completes}')

    def _promises(self) -> tuple[list[tuple[str, str]], str | None, list[str]]:
        """Return ``live``, ``last_resort`` and ``hopes`` of the :class:`Specification`, as texts."""
        if self._options.liveness is not Liveness.FAIR and self._options.retries is None:
            return [], None, []
        words = self._vocabulary
        live = [
            (words.active(name), self._completes(name))
            for name in self._failing()
            if self._options.retries is None and self._hoped in words.outcomes[name]
        ]
        gives_up = [f"{end}'" for name, end in words.ends.items() if name in FAILURE_OUTCOMES]
        if not gives_up or not self._hopes:
            return live, None, []
        return live, ' | '.join(gives_up), self._hopes

    # -- texts -------------------------------------------------------------------------------------------------------

    def _proposition(self, name: str) -> str:
        """Return the proposition for a name in the user's text. The name of a capability means its memory."""
        words = self._vocabulary
        if name in self._memory and name not in self._variables:
            return f'{name}_m'
        if name in words.ends and name not in self._variables:
            return words.ends[name]
        return name

    def _expanded(self, text: str, primed: bool) -> str:
        """Return the user's formula with propositions for names, about the next step if ``primed``."""

        def proposition(word: re.Match[str]) -> str:
            name, prime = word[1], word[2] or ("'" if primed else '')
            if name in _WORDS_OF_FORMULAS:
                return word[0]
            if self._options.parsed:
                for one, outcomes in self._vocabulary.outcomes.items():
                    if name == f'{one}_a':
                        return self._vocabulary.active(one, primed=bool(prime))
                    for outcome in outcomes:
                        if name == f'{one}_{self._vocabulary.suffixes[outcome]}':
                            return self._vocabulary.arrives(one, outcome)
            return f'{self._proposition(name)}{prime}'

        labelled = re.sub(
            r"([A-Za-z_]\w*)(\s*'?\s*(?:[<>!]?=|[<>])\s*)([A-Za-z_]\w*)",
            lambda one: f'{one[1]}{one[2]}{self._value(one[1], one[3])}' if one[1] in self._file.labels else one[0],
            text[:20_001],
        )
        return _WORD.sub(proposition, labelled)

    def _value(self, variable: str, text: str) -> str:
        """Return the number of a value, which may be a label."""
        for number, label in self._file.labels.get(variable, {}).items():
            if label == text and not text.isdigit():
                return str(number)
        return text

    def _names(self, formula: str) -> set[str]:
        return {name for name, _ in _WORD.findall(formula) if name not in _WORDS_OF_FORMULAS}

    def _add(self, section: Section, text: str, origin: str | None = None, place: str = '') -> None:
        self._texts.append((section, text, origin, place, self._rule))

    def _parsed_lines(self) -> list[SpecificationLine]:
        lines = []
        wrong: set[str | None] = set()  # what a user wrote may be in several formulas
        for section, text, origin, place, rule in self._texts:
            try:
                formula = self._formula(text)
                self._check_step(section, text, formula)
                lines.append(SpecificationLine(section, text, formula, origin, rule))
            except FormulaError as error:
                if origin is not None and origin not in wrong:
                    self._problems.append(f'{place}: {origin.removesuffix(f" ({place})")}: {error.reason}')
                elif origin is None and not wrong:
                    self._problems.append(str(error))
                wrong.add(origin)
        return lines

    def _check_step(self, section: Section, text: str, formula: Formula) -> None:
        """Check that a formula is about a step that its section knows. Raises FormulaError."""
        later = [name for name in names_in(formula) if name.primed]
        if later and section.value.endswith('_INIT'):
            raise FormulaError(
                text, f"{later[0]} is of the next step, and this is about the beginning: leave out the '"
            )
        chosen = [name for name in later if not self._variables[name.name].is_input]
        if chosen and section is Section.ENV_TRANS:
            raise FormulaError(
                text, f'the world moves before {chosen[0]} is chosen, so it cannot depend on it: write it in SYS_TRANS'
            )

    def _formula(self, text: str) -> Formula:
        return parse_formula(text, self._ranges, self._file.labels, self._known)

    @cached_property
    def _ranges(self) -> Ranges:
        return {name: variable.bounds for name, variable in self._variables.items()}

    @cached_property
    def _known(self) -> Collection[str]:
        """Names that users know: the capabilities, and the variables without those of the translation."""
        given = (name.removesuffix('_m') for name in self._variables if not self._vocabulary.is_own(name))
        return dict.fromkeys([*self._file.capabilities, *given])

    def _problem(self, line: int | None, text: str) -> None:
        self._problems.append(f'{self._file.source}:{line}: {text}' if line is not None else f'request: {text}')
