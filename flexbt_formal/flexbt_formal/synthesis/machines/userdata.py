# SPDX-License-Identifier: BSD-3-Clause
"""Whether what a state reads has been written, whatever way it is reached."""

from __future__ import annotations

from flexbt_formal.synthesis.errors import SynthesisError

from .machine import SynthesizedMachine


def keys_from_the_start(machine: SynthesizedMachine) -> tuple[str, ...]:
    """The keys that no state writes and some state reads: the machine has to get them.

    Raises:
        SynthesisError: a key is written by a state, but there is a way to a reader without that; it is told.
    """
    reads = {
        name: {key for part in state.parts for key in part.reads.values()} for name, state in machine.states.items()
    }
    writes = {
        name: {key for part in state.parts for key in part.writes.values()} for name, state in machine.states.items()
    }
    written = set().union(*writes.values())
    problems = []
    for name in machine.states:
        for key in sorted(reads[name] & written):
            way = _way_without(machine, name, {one for one in machine.states if key in writes[one]})
            if way is not None:
                problems.append(
                    f"{name} reads userdata '{key}', which is not written on the way {' → '.join(way)}: "
                    f'make what writes it a precondition of {name}'
                )
    if problems:
        raise SynthesisError(problems)
    return tuple(sorted(set().union(*reads.values()) - written))


def _way_without(machine: SynthesizedMachine, target: str, writers: set[str]) -> list[str] | None:
    """The shortest way from the start to a state on which none of the writers is left."""
    ways = {machine.initial: [machine.initial]}
    for name in (waiting := [machine.initial]):
        if name == target:
            return ways[name]
        if name in writers:
            continue
        for to in machine.states[name].transitions.values():
            if to in machine.states and to not in ways:
                ways[to] = [*ways[name], to]
                waiting.append(to)
    return None
