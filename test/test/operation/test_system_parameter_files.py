# SPDX-License-Identifier: BSD-3-Clause
"""The nodes of a robot with parameter files as people have them: each starts, or says what to write instead."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest

from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import wait_until

READY: Final = {
    'bt_server': 'active',
    'onboard_executive': 'configured; behaviors:',
    'navigation': 'ready',
    'simulator': 'robot at',
}
EMPTY_LISTS: Final = """
/**/bt_server:
  ros__parameters: {navigators: [], preload: [], bt_search_directories: [], allowed_directories: [],
                    error_code_names: []}
/**/onboard_executive:
  ros__parameters: {peers: [], motion_actions: [], capability_directories: []}
/**/navigation:
  ros__parameters: {operations: [], edge_cost_functions: [], trigger_events: [], planner_ids: []}
/**/simulator:
  ros__parameters: {allowed_directories: []}
"""
NAV2: Final = """
/**:
  ros__parameters: {use_sim_time: false}
bt_navigator:
  ros__parameters: {global_frame: map, navigators: [navigate_to_pose], plugin_lib_names: [a_bt_node]}
/**/bt_server:
  ros__parameters:
    tick_rate: 20
    navigators: [navigate_to_pose]
    default_nav_to_pose_bt_xml: $(find-pkg-share flexbt_server)/behavior_trees/navigate_to_pose.xml
"""


@pytest.mark.parametrize('text', [EMPTY_LISTS, NAV2])
def test_every_node_starts_with_a_parameter_file(tmp_path: Path, text: str) -> None:
    (tmp_path / 'parameters.yaml').write_text(text)
    with Stack(tmp_path) as stack:
        for name in READY:
            stack.start(name, {'use_sim_time': 'false'}, parameter_file=tmp_path / 'parameters.yaml')
        for name, said in READY.items():
            wait_until(lambda name=name, said=said: said in stack.output(name), lambda name=name: stack.output(name))  # type: ignore[misc]


@pytest.mark.parametrize('name', READY)
def test_every_node_says_what_is_to_be_written_in_place_of_a_number(tmp_path: Path, name: str) -> None:
    with Stack(tmp_path) as stack:
        stack.start(name, {'use_sim_time': '1'})
        why = "parameter 'use_sim_time': 1 is of type integer, not bool; write use_sim_time: true"
        wait_until(lambda: stack.output(name) == f'{name}: cannot start: {why}\n', lambda: stack.output(name))
