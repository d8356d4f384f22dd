# SPDX-License-Identifier: BSD-3-Clause
"""Goal to tree: the cheapest plan on a declared model, as a reactive tree that is tried before it is given out.

::

    problem = Problem(actions, initial, conditions(parse_goal('on(cup, table)')))
    found = plan(problem, time_limit=10.0)
    if found.cost is None:
        print(found.reason)
    else:
        file.write_text(tree_xml(found))

``model`` has what is planned with, ``search`` finds plans, ``policy`` and ``compaction`` make branches of them,
``coverage`` tries these, ``tree_xml`` writes them. ``teams`` has the same for several robots,
``regions`` makes a map,
``measurement`` finds out where a robot begins.
"""

from .btpg import read_scene
from .compaction import Group, Rule, chosen, compact
from .coverage import Coverage, Disturbance, explore
from .goal import conditions, parse_goal
from .leaf_elements import COUNT_ENTRY, FAILURE_ENTRY, failed_action
from .measurement import Measurement
from .mission import Mission, read_mission
from .model import Action, Condition, Domain, PlanningError
from .planner import Plan, plan
from .policy import Branch, Policy
from .problem import Leaf, Problem
from .reachability import Reachability
from .regions import Move, MoveKind, Region, RegionKind, RegionMap, region_map
from .search import Outcome, Progress, SearchResult, Step, search
from .skill_problem import sensor_leaf, skill_problem
from .teams import Task, Team, TeamBranch, TeamPlan, TeamPolicy, plan_team, team_problem, team_xml
from .tree_xml import tree_xml

__all__ = [
    'COUNT_ENTRY',
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
    'tree_xml',
]
