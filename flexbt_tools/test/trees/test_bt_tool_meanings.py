# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool check``: keys, texts and children that are mixed up, though their types fit."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory

from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES, document
from flexbt_tools.tree_checks.check import check_trees

TREES = Path(get_package_share_directory('flexbt_server')) / 'behavior_trees'
SOUND = (TREES / 'navigate_to_pose.xml').read_text('utf-8')


def crossed(folder: Path, text: str) -> list[str]:
    """Return the messages of the rule."""
    file = folder / 'main.xml'
    file.write_text(text, encoding='utf-8')
    shutil.copy(TREES / 'recoveries.xml', folder)
    found = check_trees([str(file)], node_registry(lambda source, error: None))
    return [one.place.message for one in found if one.rule.name == 'crossed']


@pytest.mark.parametrize('tree', STOCK_TREES, ids=lambda tree: tree.stem)
def test_trees_of_nav2_mix_nothing_up(tmp_path: Path, tree: Path) -> None:
    assert crossed(tmp_path, tree.read_text(encoding='utf-8')) == []


@pytest.mark.parametrize(
    ('old', 'new', 'told'),
    [
        ('error_code="{follow_path_error_code}"', 'error_code="{compute_path_error_code}"',
         'key [compute_path_error_code] is read here as an error code of FollowPath'),
        ('error_code_id="{follow_path_error_code}"', 'error_code_id="{compute_path_error_code}"',
         'its error_code_id goes to the key of ComputePathToPose'),
        ('planner_id="{selected_planner}"', 'planner_id="{selected_controller}"', 'is read here as a planner'),
        ('"controller_selector"', '"planner_selector"', 'topic_name="planner_selector" is that of PlannerSelector'),
        ('"local_costmap/clear_entirely_local', '"global_costmap/clear_entirely_global',
         "it is called after 'local', and its service_name is about 'global'"),
    ],
    ids=['code that is read', 'code that is written', 'selection', 'topic', 'service'],
)  # fmt: skip
def test_what_is_mixed_up_is_told(tmp_path: Path, old: str, new: str, told: str) -> None:
    assert old in SOUND and any(told in message for message in crossed(tmp_path, SOUND.replace(old, new, 1)))


PLAN = '<ComputePathToPose goal="{goal}" path="{path}"/>'
CLEAR = '<ClearEntireCostmap service_name="global_costmap/clear"/>'


def test_children_of_a_recovery_node_that_are_swapped_are_told(tmp_path: Path) -> None:
    assert crossed(tmp_path, document(f'Main: <RecoveryNode number_of_retries="1">{PLAN}{CLEAR}</RecoveryNode>')) == []
    swapped = crossed(tmp_path, document(f'Main: <RecoveryNode number_of_retries="1">{CLEAR}{PLAN}</RecoveryNode>'))
    assert swapped == ['its first child only recovers, and the second one is what can fail: are they swapped?']


def test_one_key_for_the_codes_of_all_is_right(tmp_path: Path) -> None:
    follow = '<FollowPath path="{path}" error_code_id="{code}"/>'
    both = PLAN.replace('/>', ' error_code_id="{code}"/>') + follow
    assert crossed(tmp_path, document(f'Main: <Sequence>{both}</Sequence>')) == []
    assert crossed(tmp_path, document('Main: <Spin name="LoadGlobal" error_code_id="{spin_error_code}"/>')) == []


def test_children_of_a_switch_stand_at_their_cases(tmp_path: Path) -> None:
    def switch(first: str, second: str) -> str:
        children = f'<Wait name="{first}"/><Spin name="{second}"/><AlwaysFailure/>'
        return document(f'Main: <Switch2 variable="{{mode}}" case_1="fetch" case_2="bring">{children}</Switch2>')

    assert crossed(tmp_path, switch('Fetch', 'bring')) == []
    assert crossed(tmp_path, switch('one', 'two')) == []
    told = 'it is called after a case of <Switch2>, and stands where that is not the case'
    assert crossed(tmp_path, switch('bring', 'Fetch')) == [told, told]
