# SPDX-License-Identifier: BSD-3-Clause
"""A behavior that waits for the operator all the time: every transition of a ring of states wants to be confirmed."""

from __future__ import annotations

import itertools
import os
from collections import Counter
from pathlib import Path

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState, ExitReason
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest

GATES = tuple(f'Gate{number}' for number in range(1, 13))


class Gate(EventState):
    """Wants to be left at once, which needs the operator; counts how it was left."""

    exits: Counter[ExitReason] = Counter()

    def __init__(self) -> None:
        super().__init__(outcomes=['go', 'back'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        return 'go'

    def on_exit(self, userdata: UserData) -> None:
        assert self.exit_reason is not None
        Gate.exits[self.exit_reason] += 1


class Gates(Behavior):
    """One gate after the other, without an end unless somebody goes back."""

    manifest = BehaviorManifest('Gates')

    def create(self) -> OperatableStateMachine:
        """Return the ring."""
        machine = OperatableStateMachine(outcomes=['done'])
        with machine:
            for here, there in itertools.pairwise((*GATES, GATES[0])):
                OperatableStateMachine.add(here, Gate(), {'go': there, 'back': 'done'}, {'go': Autonomy.High})
        return machine


def offer_gates(directory: Path) -> dict[str, str]:
    """Return the environment in which an executive finds the behavior as an installed one, by metadata in
    ``directory``."""
    metadata = directory / 'gates-0.dist-info'
    metadata.mkdir()
    (metadata / 'METADATA').write_text('Metadata-Version: 2.1\nName: gates\nVersion: 0\n')
    (metadata / 'entry_points.txt').write_text(f'[flexbt.behaviors]\ngates = {__name__}:{Gates.__name__}\n')
    return {'PYTHONPATH': f'{directory}{os.pathsep}{os.environ.get("PYTHONPATH", "")}'}
