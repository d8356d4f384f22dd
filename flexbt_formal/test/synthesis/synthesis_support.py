# SPDX-License-Identifier: BSD-3-Clause
"""A coffee machine, whose parts tests change."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flexbt_formal.synthesis.capabilities import StateInterface, read_capabilities
from flexbt_formal.synthesis.request_files import MachineRequest
from flexbt_formal.synthesis.translation import Options, SynthesisProblem, translated

COFFEE = """\
name: coffee
state_outcome_mappings: {done: completed, failed: failure}
sm_outcome_mappings: {finished: finished}
capabilities:
  press:
    interface: Try
    preconditions: ['!press']
    postconditions: {completed: [press, '!grind'], failure: ['!press']}
  grind:
    interface: Try
    preconditions: [press]
    postconditions: {completed: ['!press', grind], failure: [press]}
    autonomy: {done: 0, failed: 3}
  brew:
    interface: Try
    preconditions: [grind]
    postconditions: {completed: ['!grind', brew], failure: [grind]}
"""


def interface(name: str, parameters: Mapping[str, Any]) -> StateInterface:
    """Return every state tries something, and fails or not."""
    return StateInterface(('done', 'failed'))


def coffee(
    *changes: tuple[str, str],
    goals: tuple[str, ...] = ('brew',),
    initial: tuple[str, ...] = (),
    outcomes: tuple[str, ...] = (),
    **options: Any,
) -> SynthesisProblem:
    """Return the problem of the coffee machine with parts of its text replaced. Raises SynthesisError."""
    text = COFFEE
    for before, after in changes:
        assert before in text
        text = text.replace(before, after, 1)
    request = MachineRequest(initial, goals, outcomes)
    return translated(read_capabilities(text, 'coffee.yaml'), interface, request, None, Options(**options))
