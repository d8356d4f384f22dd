# SPDX-License-Identifier: BSD-3-Clause
"""What is asked for: FlexBESynthesisRequest, as data and in YAML."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from flexbt_core.values import shown

from .yaml_nodes import YamlFile

FAILURE_OUTCOMES: Final = frozenset({'failed', 'failure', 'aborted', 'canceled'})
"""Outcomes of a machine that are no success."""

_KEYS: Final = (
    'initial_conditions',
    'goals',
    'sm_outcomes',
    'system_name',
    'spec_name',
    'specification_file_name',
    'synthesis_timeout_s',
)


@dataclass(frozen=True, slots=True)
class Request:
    """Initial conditions and goals (formulas over propositions, each list a conjunction), outcomes of the machine.

    Without goals the specification has the objective. ``timeout`` in seconds; 0 for the default.
    """

    initial_conditions: tuple[str, ...] = ()
    goals: tuple[str, ...] = ()
    outcomes: tuple[str, ...] = ()
    system: str = ''
    name: str = ''
    timeout: float = 0.0

    @property
    def success(self) -> str | None:
        """The outcome that stands for a goal that was reached."""
        return next((one for one in self.outcomes if one not in FAILURE_OUTCOMES), None)


def read_request(text: str, source: str) -> Request:
    """A request in YAML (or JSON) with the fields of the action's message.

    Raises:
        SynthesisError: with every problem of it, each as ``source:line: what``.
    """
    file = YamlFile(text, source)
    entries = file.top('a request', _KEYS)

    def texts(key: str) -> tuple[str, ...]:
        return tuple(one.text for one in file.words(entries.get(key), key))

    def text_of(key: str) -> str:
        return file.word(entries[key], key) if key in entries else ''

    timeout = (
        file.value(entries['synthesis_timeout_s'], 'synthesis_timeout_s') if 'synthesis_timeout_s' in entries else 0
    )
    if not isinstance(timeout, int | float) or not 0 <= timeout < 1e9:
        file.problem(entries['synthesis_timeout_s'], f'synthesis_timeout_s has to be seconds, not {shown(timeout)}')
        timeout = 0
    request = Request(
        texts('initial_conditions'),
        texts('goals'),
        texts('sm_outcomes'),
        text_of('system_name'),
        text_of('spec_name'),
        float(timeout),
    )
    file.end()
    return request
