# SPDX-License-Identifier: BSD-3-Clause
"""What an engineer runs at a desk: planning, synthesis, proofs of trees and behaviors, models of AS2FM.

Nothing that a robot runs imports this package. What a robot can use of it (the leaf ``ReachGoal``, the search of
``console synthesize``) and what it adds to ``bt_tool`` and ``behavior_tool`` come by entry points.

Public here is planning, from a goal to a tree that is tried before it is returned::

    problem = PlanningProblem(actions, initial, conditions(parse_goal('on(cup, table)')))
    found = plan(problem, time_limit=10.0)
    if found.cost is None:
        print(found.reason)
    else:
        file.write_text(tree_xml(found))
"""

from .planning.coverage import Coverage, Disturbance
from .planning.goal import conditions, parse_goal
from .planning.missions import Measurement, Mission, read_mission, sensor_leaf, skill_problem
from .planning.planner import Plan, plan
from .planning.policy import Branch, BranchRule, Policy, RuleGroup
from .planning.problem import Action, Condition, Domain, Leaf, PlanningError, PlanningProblem, read_scene
from .planning.regions import MoveKind, PlanRegion, RegionKind, RegionMap, RegionMove, region_map
from .planning.search import RegressionStep, SearchOutcome, SearchProgress, SearchResult, search
from .planning.team import Task, Team, TeamPlan, plan_team, team_problem
from .planning.tree_xml import failed_action, tree_entries, tree_xml

__all__ = [
    'Action',
    'Branch',
    'BranchRule',
    'Condition',
    'Coverage',
    'Disturbance',
    'Domain',
    'Leaf',
    'Measurement',
    'Mission',
    'MoveKind',
    'Plan',
    'PlanRegion',
    'PlanningError',
    'PlanningProblem',
    'Policy',
    'RegionKind',
    'RegionMap',
    'RegionMove',
    'RegressionStep',
    'RuleGroup',
    'SearchOutcome',
    'SearchProgress',
    'SearchResult',
    'Task',
    'Team',
    'TeamPlan',
    'conditions',
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
    'tree_entries',
    'tree_xml',
]
