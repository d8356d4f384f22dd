# SPDX-License-Identifier: BSD-3-Clause
"""Runs a test of FlexBE's, of a state or of a behavior, on the engine of FlexBT."""

from __future__ import annotations

import importlib
import traceback
from functools import partial
from typing import Any, Final

from flexbt_core.state_machine import DecisionKind, EventState, OperatableStateMachine, Severity
from flexbt_core.values import excerpt, shown
from flexbt_flexbe import shim
from flexbt_flexbe.api import Behavior
from flexbt_flexbe.behaviors import without_harmless_faults
from flexbt_onboard.behaviors import current_run
from flexbt_testing.nodes.state_bench import Run, StateBench
from flexbt_testing.waiting import wait_until

from .state_test_file import StateTest, StateTestError

SECONDS: Final = 10.0
"""How long what is tested may run."""


def run_state_test(test: StateTest, bench: StateBench, seconds: float = SECONDS) -> list[str]:
    """Run a test; what is wrong, nothing when it passes.

    A state is a machine of its own. A behavior runs as FlexBE's unsupervised ones: transitions are taken whatever
    autonomy they require.
    """
    try:
        subject = _load(test)
    except StateTestError as error:
        return [str(error)]
    if test.import_only:
        return []
    run = bench.run(partial(_machine, test, subject))
    try:
        wait_until(lambda: _has_ended(run), 'it gave no outcome', seconds)
    except AssertionError as error:
        run.stop()
        return [str(error), *run.errors().splitlines()]
    if run.refusal is not None:
        return [run.refusal]
    problems = []
    if run.outcome != test.outcome:
        why = [text for text in (run.message, run.errors()) if text]
        problems.append(f'its outcome is {run.outcome!r}, not {test.outcome!r}' + ''.join(f'; {text}' for text in why))
    given = run.outputs
    for key, expected in test.outputs.items():
        if key not in given:
            problems.append(f'it has not written {key!r}')
        elif given[key] != expected:
            problems.append(f'{key!r} is {excerpt(repr(given[key]), 200)}, not {excerpt(repr(expected), 200)}')
    return problems


def _load(test: StateTest) -> type[Any]:
    """The class under test.

    Raises:
        StateTestError: it cannot be imported, or is neither state nor behavior.
    """
    where = f'class {test.class_name} of {test.module}'
    try:
        shim.install()
        found = getattr(importlib.import_module(test.module), test.class_name, None)
    except (Exception, SystemExit) as error:  # whatever foreign code raises when it is imported
        raise StateTestError(f'{where} cannot be imported: {"".join(traceback.format_exception_only(error))}') from None
    if not (isinstance(found, type) and issubclass(found, EventState | Behavior)):
        raise StateTestError(f'{where} is neither an EventState nor a Behavior, but {shown(found)}')
    return found


def _machine(test: StateTest, subject: type[Any]) -> OperatableStateMachine:
    """What is run for a test. On the thread of the run."""
    if issubclass(subject, EventState):
        state = subject(**test.parameters)
        machine = OperatableStateMachine(outcomes=list(state.outcomes))
        with machine:
            OperatableStateMachine.add('State', state, {outcome: outcome for outcome in state.outcomes})
    else:
        machine = _machine_of_behavior(test, subject)
    for key, value in test.inputs.items():
        machine.userdata[key] = value
    machine.output_keys = tuple(dict.fromkeys((*machine.output_keys, *test.outputs)))
    return machine


def _machine_of_behavior(test: StateTest, subject: type[Any]) -> OperatableStateMachine:
    run = current_run()
    behavior = subject(node=run.services.runtime.node)
    for name, value in test.parameters.items():
        if not behavior.set_parameter(name, value):
            raise StateTestError(f'the behavior has no parameter {name!r}')
    machine = behavior.create()
    if not isinstance(machine, OperatableStateMachine):
        raise StateTestError(f'create() gave {shown(machine)}, which is no state machine')
    without_harmless_faults(machine, partial(run.log, Severity.WARN, ''))
    return machine


def _has_ended(run: Run) -> bool:
    for decision in run.decisions():
        if decision.kind is DecisionKind.TRANSITION:
            run.behavior_run.confirm(decision.id, lambda _: None)
    return run.outcome is not None or run.refusal is not None
