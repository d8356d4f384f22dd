# SPDX-License-Identifier: BSD-3-Clause
"""The behaviors of the demonstrations are found, built, and lead where they should."""

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from flexbt_core import Autonomy, MachineDefinition, StateDefinition, define
from flexbt_demo_behaviors.inspection.behaviors import Inspection, InspectSite
from flexbt_demo_behaviors.navigate.behaviors import Navigate, NavigateSplit, ShowPathState
from flexbt_onboard.behaviors.behavior import Behavior
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.behaviors.run_building import definition_of

BEHAVIORS = [Navigate, NavigateSplit, Inspection, InspectSite]


def transitions(definition: MachineDefinition) -> dict[tuple[str, str], tuple[str, int]]:
    """Target and required autonomy of each outcome of each state."""
    return {
        (label, outcome): (way.state or f'={way.outcome}', way.autonomy)
        for label, child in definition.children.items()
        for outcome, way in child.transitions.items()
    }


@pytest.mark.parametrize('behavior', BEHAVIORS)
def test_a_behavior_builds_twice_from_one_instance(behavior: type[Behavior]) -> None:
    instance = behavior()
    first, second = definition_of(instance), definition_of(instance)
    states = [child.state for child in first.children.values() if isinstance(child, StateDefinition)]
    others = [child.state for child in second.children.values() if isinstance(child, StateDefinition)]
    assert not set(map(id, states)) & set(map(id, others))


@pytest.mark.parametrize('behavior', BEHAVIORS)
def test_a_behavior_is_found_by_its_name_and_usable(behavior: type[Behavior]) -> None:
    entry = BehaviorLibrary.discover().find(behavior.manifest.name)
    assert entry.error == ''
    assert entry.make is behavior
    assert all(parameter.description for parameter in entry.parameters)


def test_the_plan_is_judged_by_a_person_below_full_autonomy() -> None:
    ways = transitions(define(NavigateSplit().create()))
    assert ways['JudgePath', 'done'] == ('FollowPath', Autonomy.High)
    assert ways['JudgePath', 'canceled'][0] == 'AskGoal'
    assert ways['JudgePath', 'failed'][0] == 'Recover'


def test_recovery_leads_back_to_asking_or_ends_the_behavior() -> None:
    ways = transitions(define(NavigateSplit().create()))
    assert ways['FollowPath', 'failed'][0] == 'Recover'
    assert ways['Recover', 'done'][0] == 'AskGoal'
    assert ways['Recover', 'failed'][0] == '=failed'


def test_a_tree_that_is_not_installed_is_refused_when_the_behavior_is_built() -> None:
    behavior = Navigate()
    behavior.set_parameter('tree', 'flexbt_demo_behaviors/navigate/missing.xml')
    with pytest.raises(Exception, match=r'missing\.xml'):
        define(behavior.create())


class Spoken(ShowPathState):
    """Keeps what it says."""

    def __init__(self) -> None:
        super().__init__()
        self.said: list[str] = []

    def log_info(self, text: str) -> None:
        self.said.append(text)

    def log_warn(self, text: str) -> None:
        self.said.append(text)


def test_a_path_is_described_by_its_length_and_end() -> None:
    path = Path(poses=[PoseStamped(), PoseStamped(), PoseStamped()])
    path.poses[1].pose.position.x = 3.0
    path.poses[2].pose.position.x = 3.0
    path.poses[2].pose.position.y = 4.0
    state = Spoken()
    assert state.describe(path) == 'done'
    assert '7.0 m in 3 poses' in state.said[0]
    assert '(3.00, 4.00)' in state.said[0]
    assert state.describe(Path()) == 'empty'
