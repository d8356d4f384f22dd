# SPDX-License-Identifier: BSD-3-Clause
"""What the monitors of the executive find reaches the operator, once, and ends the run where that is wanted."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from flexbt_common.errors import UnfitParameterError
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.monitors.requirement_text import read_requirements
from flexbt_core.skills.skill import Skill
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveLog, ExecutiveStatus
from flexbt_onboard.node.executive_parameters import ExecutiveParameters, declare_parameters
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import wait_until


class Drives(EventState):
    skill = Skill.of(resources=['base'])

    def __init__(self) -> None:
        super().__init__(['done'], desired_rate=None)


def both_drive() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        both = ConcurrencyContainer(['done'], conditions=[('done', [('One', 'done'), ('Other', 'done')])])
        with both:
            for label in ('One', 'Other'):
                OperatableStateMachine.add(label, Drives(), {'done': 'done'})
        OperatableStateMachine.add('Both', both, {'done': 'done'})
    return machine


def opened(stops: bool, requirements: str = 'Test: []') -> ExecutiveBench:
    monitoring = Monitoring(True, stops, read_requirements(requirements, 'site.yaml'))
    return ExecutiveBench(behavior_of(both_drive), parameters=ExecutiveParameters(peers=(), monitoring=monitoring))


def told(bench: ExecutiveBench, words: str) -> list[ExecutiveLog]:
    return [line for line in bench.logs if words in line.text]


def test_what_a_monitor_finds_is_told_once_and_shown() -> None:
    bench = opened(stops=False, requirements='Test:\n  - never /Both/Other\n  - never /Bath\n')
    try:
        bench.start()
        bench.wait_for(lambda status: 'required is: never /Both/Other' in status.message, 'the first finding')
        wait_until(lambda: len(told(bench, 'monitor:')) == 2, 'both findings')
        (owners,) = told(bench, 'base has two owners at once: /Both/One and /Both/Other')
        (never,) = told(bench, '/Both/Other happens; required is: never /Both/Other')
        assert owners.severity == never.severity == ExecutiveLog.ERROR and never.path == '/Both/Other'
        (wrong,) = told(bench, 'site.yaml:3: "never /Bath": Test has no event \'/Bath\'')
        assert wrong.severity == ExecutiveLog.WARN
        bench.applied(ExecutiveCommand.FORCE, path='/Both/One', outcome='done')
        assert bench.status.state == ExecutiveStatus.RUNNING and len(told(bench, 'monitor:')) == 2
    finally:
        bench.close()


def test_a_run_is_stopped_by_what_a_monitor_finds_if_that_is_wanted() -> None:
    bench = opened(stops=True)
    try:
        bench.start()
        bench.wait_for(lambda status: status.state == ExecutiveStatus.IDLE and status.outcome, 'the end')
        assert bench.status.outcome == 'preempted' and 'base has two owners' in bench.status.message
    finally:
        bench.close()


def in_a_row(*labels: str) -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        for label, following in zip(labels, [*labels[1:], 'done'], strict=True):
            OperatableStateMachine.add(label, EventState(['done'], desired_rate=None), {'done': following})
    return machine


def test_a_run_that_is_switched_is_watched_by_the_requirements_of_its_new_behavior() -> None:
    rules = 'One:\n  - never /B\n  - never /C\nTwo:\n  - never /D\n  - /C only after /Z\n'
    rows = {'One': 'AB', 'Two': 'ACDZ', 'Other': 'X'}
    behaviors = [behavior_of(partial(in_a_row, *labels), name) for name, labels in rows.items()]
    monitoring = Monitoring(True, False, read_requirements(rules, 'site.yaml'))
    bench = ExecutiveBench(*behaviors, parameters=ExecutiveParameters(peers=(), monitoring=monitoring))
    try:
        bench.start('One')
        bench.refused(ExecutiveCommand.SWITCH, behavior='Other')
        bench.applied(ExecutiveCommand.FORCE, path='/A', outcome='done')
        wait_until(lambda: told(bench, 'monitor: /B happens'), 'what is required without a switch')
        bench.applied(ExecutiveCommand.STOP)
        bench.wait_idle()
        bench.start('One')
        bench.applied(ExecutiveCommand.SWITCH, behavior='Two')
        for label in 'AC':
            bench.applied(ExecutiveCommand.FORCE, path=f'/{label}', outcome='done')
        wait_until(lambda: told(bench, 'monitor: /D happens'), 'what the other behavior must not do')
        assert not told(bench, 'monitor: /C')
    finally:
        bench.close()


@pytest.mark.parametrize(
    ('value', 'why'),
    [
        ({'monitor_action': 'explode'}, "'explode' is neither warn nor stop"),
        ({'requirements': '/no/such/file.yaml'}, 'No such file'),
        ({'requirements': 'WRONG'}, 'wrong.yaml:2: "walk" is not a requirement'),
    ],
)
def test_parameters_that_cannot_work_are_refused(value: dict[str, str], why: str, tmp_path: Path) -> None:
    wrong = tmp_path / 'wrong.yaml'
    wrong.write_text('Test:\n  - walk\n')
    parameters = {key: str(wrong) if text == 'WRONG' else text for key, text in value.items()}
    with (
        NodeRuntime.open('onboard_executive', parameters={'monitors': True, **parameters}) as runtime,
        pytest.raises(UnfitParameterError, match=why),
    ):
        declare_parameters(runtime.node)
