# SPDX-License-Identifier: BSD-3-Clause
"""Goal to tree: the cheapest plan on a declared model, as a reactive tree that is tried before it is given out.

::

    problem = Problem(actions, initial, conditions(parse_goal('on(cup, table)')))
    found = plan(problem, time_limit=10.0)
    if found.cost is None:
        print(found.reason)
    else:
        file.write_text(tree_xml(found))

``problems`` has what is planned, ``backward_search`` finds plans, ``trees`` makes trees of them, tries these and writes
them. ``teams`` has the same for several robots, ``regions`` makes a map.
"""

from .backward_search import Outcome, Progress, Reachability, SearchResult, Step, search
from .problems import (
    Action,
    Condition,
    Domain,
    Leaf,
    Measurement,
    Mission,
    PlanningError,
    Problem,
    conditions,
    parse_goal,
    read_mission,
    read_scene,
    sensor_leaf,
    skill_problem,
)
from .regions import Move, MoveKind, Region, RegionKind, RegionMap, region_map
from .teams import Task, Team, TeamBranch, TeamPlan, TeamPolicy, plan_team, team_problem, team_xml
from .trees import (
    FAILURE_ENTRY,
    Branch,
    Coverage,
    Disturbance,
    Group,
    Plan,
    Policy,
    Rule,
    chosen,
    compact,
    explore,
    failed_action,
    hopeless,
    plan,
    tree_entries,
    tree_xml,
)

__all__ = [
    'FAILURE_ENTRY',
    'Action',
    'Branch',
    'Condition',
    'Coverage',
    'Disturbance',
    'Domain',
    'Group',
    'Leaf',
    'Measurement',
    'Mission',
    'Move',
    'MoveKind',
    'Outcome',
    'Plan',
    'PlanningError',
    'Policy',
    'Problem',
    'Progress',
    'Reachability',
    'Region',
    'RegionKind',
    'RegionMap',
    'Rule',
    'SearchResult',
    'Step',
    'Task',
    'Team',
    'TeamBranch',
    'TeamPlan',
    'TeamPolicy',
    'chosen',
    'compact',
    'conditions',
    'explore',
    'failed_action',
    'hopeless',
    'parse_goal',
    'plan',
    'plan_team',
    'read_mission',
    'read_scene',
    'region_map',
    'search',
    'sensor_leaf',
    'skill_problem',
    'team_problem',
    'team_xml',
    'tree_entries',
    'tree_xml',
]
