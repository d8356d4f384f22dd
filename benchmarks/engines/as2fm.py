# SPDX-License-Identifier: BSD-3-Clause
"""The test models of AS2FM: each probability beside the one that its own tests expect (from random runs).

DIR is a checkout of https://github.com/convince-project/AS2FM.

Usage: python3 benchmarks as2fm DIR [--only TEXT] [--seconds S] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Final

from _figures import write_figures

from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_formal.roaml.checking import CheckLimits, check
from flexbt_formal.roaml.model import RoamlModel
from flexbt_formal.roaml.source_text import ModelFault

DATA: Final = 'test/jani_generator/_test_data'
NEAR: Final = 0.015
"""The tolerance of AS2FM's tests where a probability is not 0 or 1."""

_TREES: Final = (
    ('sequence', 'regular_bt_test'),
    ('fallback', 'regular_bt_test'),
    ('reactive_sequence', 'ten_tick_zero_no_tick_one'),
    ('reactive_fallback', 'ten_tick_zero_no_tick_one'),
    ('repeat', 'repeats_and_success'),
    ('ifthenelse_then', 'tree_success'),
    ('ifthenelse_then', 'counter_then_10'),
    ('ifthenelse_else', 'tree_success'),
    ('ifthenelse_else', 'counter_else_10'),
    ('parallel_success', 'parallel_success_status_action_child_test'),
    ('parallel_failure', 'parallel_failure_status_action_child_test'),
    ('parallel_running', 'parallel_running_status_action_child_test'),
)
_MODELS: Final = (
    ('blackboard_test', 'tree_success', 1.0, 0.0),
    ('grid_robot_blackboard', 'at_goal', 1.0, 0.0),
    ('grid_robot_blackboard_simple', 'tree_success', 1.0, 0.0),
    ('uc1_docking', 'charging_starts', 1.0, 0.0),
    ('uc1_docking/main_with_problem.xml', 'charging_starts', 0.0, 0.0),
    ('uc1_mission', 'tree_finished_robot_docked', 1.0, 0.0),
    ('uc1_mission', 'no_coverage_failures_after_mission_failed', 1.0, 0.0),
    ('uc1_mission/main_bug.xml', 'no_coverage_failures_after_mission_failed', 0.96, 0.3),
    ('uc2_assembly/Main', 'executes_recovery_branch_or_success', 1.0, 0.0),
    ('uc2_assembly/Main', 'move_success', 1.0, 0.0),
    ('uc2_assembly/Main/main_bug.xml', 'executes_recovery_branch_or_success', 0.7, NEAR),
    ('uc3_museum_guide/Main', 'tree_success', 1.0, 0.0),
    ('overarching_tutorial/main_locations.xml', 'butter_at_table', 1.0, 0.0),
    ('ros_example', 'battery_depleted', 1.0, 0.0),
    ('ros_example', 'battery_over_depleted', 0.0, 0.0),
    ('ros_example', 'alarm_on', 1.0, 0.0),
    ('events_sync_examples', 'seq_check', 1.0, 0.0),
    ('different_rate_senders', 'counter_check', 1.0, 0.0),
    ('multiple_senders_same_event', 'seq_check', 1.0, 0.0),
    ('on_entry_exit_test', 'working', 1.0, 0.0),
    ('conditional_transitions', 'destination_reached', 1.0, 0.0),
    ('array_model_basic', 'array_check', 1.0, 0.0),
    ('array_model_additional', 'array_check', 1.0, 0.0),
    ('array_model_multi_dim', 'array_check', 1.0, 0.0),
    ('array_of_data_structs', 'success', 1.0, 0.0),
    ('array_of_strings', 'array_check', 1.0, 0.0),
    ('probabilistic_transitions', 'expected_counts', 1.0, NEAR),
    ('data_structs/main_xml_def.xml', 'success', 1.0, 0.0),
    ('data_structs/main_json_def.xml', 'success', 1.0, 0.0),
    ('string_comparison', 'string_two_sent', 0.6, NEAR),
    ('string_comparison', 'strings_res_one', 0.3, NEAR),
    ('string_comparison', 'strings_res_two', 0.6, NEAR),
    ('string_comparison', 'strings_res_min_one', 0.1, NEAR),
    ('string_msg_comparison', 'success', 1.0, 0.0),
    ('ros_add_int_srv_example', 'happy_clients', 1.0, 0.0),
    ('set_float_srv_example', 'float_received', 1.0, 0.0),
    ('fibonacci_action_example', 'clients_ok', 1.0, 0.0),
    ('fibonacci_action_single_thread', 'client1_ok', 1.0, 0.0),
    ('nested_data_ros', 'success', 1.0, 0.0),
)
_EXAMPLES: Final = (
    ('quick_start_battery_monitor', 'battery_depleted', 0.0, 0.0),
    ('quick_start_battery_monitor', 'battery_below_20', 0.0, 0.0),
    ('quick_start_battery_monitor', 'battery_alarm_on', 1.0, 0.0),
    ('quick_start_battery_monitor', 'battery_charged', 1.0, 0.0),
    ('tutorial_fetch_and_carry', 'snack_at_table', 1.0, 0.0),
    ('tutorial_fetch_and_carry/main_probabilistic_extended_bt.xml', 'snack_at_table', 0.954, NEAR),
)
ROWS: Final = (
    *((f'{DATA}/bt_test_models/main_test_{tree}.xml', name, 1.0, 0.0) for tree, name in _TREES),
    *((f'{DATA}/{model}', name, expected, near) for model, name, expected, near in _MODELS),
    *((f'examples/{model}', name, expected, near) for model, name, expected, near in _EXAMPLES),
)
"""Model, property, the probability that is expected, and how near AS2FM's tests want it."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('directory', type=Path, metavar='DIR')
    parser.add_argument('--only', default='', metavar='TEXT', help='models with this in their path')
    parser.add_argument('--seconds', type=float, default=60.0, help='for each property (default: %(default)g)')
    parser.add_argument('--output', type=Path, default=Path('out/as2fm.json'))
    options = parser.parse_args()
    if not (options.directory / DATA).is_dir():
        print(f'{options.directory} is no checkout of AS2FM: there is no {DATA}', file=sys.stderr)
        return 2
    figures = []
    wrong = 0
    print(f'{"model and property":78} {"expected":>8} {"found":>8} {"±":>6} {"states":>8} {"CPU s":>6}')
    for model, name, expected, near in ROWS:
        if options.only not in model:
            continue
        path = options.directory / (model if model.endswith('.xml') else f'{model}/main.xml')
        begin = time.process_time()
        shown = f'{model.removeprefix(DATA + "/").removesuffix(".xml")} {name}'
        try:
            known = RoamlModel(str(path))
            (asked,) = (one for one in known.properties if one.name == name)
            found = check(known, asked, limits=CheckLimits(seconds=options.seconds))
        except (TreeLoadError, ModelFault) as error:
            print(f'{shown:78} {expected:8g} refused: {error}', flush=True)
            wrong += 1
            continue
        seconds = time.process_time() - begin
        bound = (found.high - found.low) / 2
        is_good = found.low - near - 1e-9 <= expected <= found.high + near + 1e-9
        wrong += not is_good
        about = 'exact' if found.is_exact else f'{bound:.3f}'
        row = f'{shown:78} {expected:8g} {found.value:8.4g} {about:>6} {found.size:8} {seconds:6.1f}'
        print(row + ('' if is_good else '  NOT AS EXPECTED'), flush=True)
        figures.append(
            {'model': model, 'property': name, 'expected': expected, 'value': found.value, 'low': found.low}
            | {'high': found.high, 'how': found.how, 'CPU, s': seconds, 'good': is_good}
        )
    print(f'{len(figures)} properties, {wrong} not as expected')
    write_figures(options.output, {'rows': figures})
    return 1 if wrong else 0


if __name__ == '__main__':
    raise SystemExit(main())
