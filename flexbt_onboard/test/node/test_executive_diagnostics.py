# SPDX-License-Identifier: BSD-3-Clause
"""What monitors of the robot are told of the executive."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import wait_until

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Trip(EventState):
    """Wants 'on', and raises after it."""

    def __init__(self) -> None:
        super().__init__(outcomes=['on'], desired_rate=None)

    def execute(self, userdata: Any) -> str:
        if self.path == '/B':
            raise RuntimeError('tripped')
        return 'on'


def tripping() -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add('A', Trip(), {'on': 'B'}, autonomy={'on': Autonomy.Full})
        OperatableStateMachine.add('B', Trip(), {'on': 'done'})
    return machine


def test_levels_follow_the_run_the_nodes_and_the_disk(tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    parameters = ExecutiveParameters(peers=('bt_server',), event_log_directory=str(tmp_path / 'file'))
    bench = ExecutiveBench(behavior_of(tripping), parameters=parameters)
    arrays: list[DiagnosticArray] = []
    try:
        bench.console.call(
            lambda: bench.console.node.create_subscription(DiagnosticArray, '/diagnostics', arrays.append, 10)
        )

        def entry(name: str, condition: Callable[[Any], bool]) -> Any:
            full = f'/onboard_executive: {name}'

            def find() -> Any:
                latest = arrays[-1].status if arrays else []
                return next((one for one in latest if one.name == full and condition(one)), None)

            return wait_until(find, lambda: f'{name}: {arrays[-1:]}')

        entry('behavior', lambda one: one.level == OK and one.message == 'idle')
        assert 'bt_server' in entry('nodes', lambda one: one.level == ERROR).message
        assert 'cannot be written' in entry('event log and journal', lambda one: one.level == WARN).message
        bench.start(operator_id='ann')
        waiting = entry('behavior', lambda one: one.level == WARN)
        assert '/A' in waiting.message
        assert ('active states', '/A') in [(pair.key, pair.value) for pair in waiting.values]
        bench.applied(ExecutiveCommand.FORCE, path='/A', outcome='on')
        assert 'raised' in entry('behavior', lambda one: one.level == ERROR).message
    finally:
        bench.close()
