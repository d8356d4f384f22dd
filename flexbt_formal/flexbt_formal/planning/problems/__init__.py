# SPDX-License-Identifier: BSD-3-Clause
"""What is planned: actions and conditions as bit sets, goals, problems; how missions, skills and BTPG tell them."""

from .btpg import read_scene
from .goal import conditions, parse_goal
from .measurement import Measurement
from .mission import Mission, read_mission
from .model import Action, Condition, Domain, PlanningError, bits
from .problem import Leaf, Problem, predicate_of
from .skill_problem import grounded_problem, sensor_leaf, skill_problem

__all__ = [
    'Action',
    'Condition',
    'Domain',
    'Leaf',
    'Measurement',
    'Mission',
    'PlanningError',
    'Problem',
    'bits',
    'conditions',
    'grounded_problem',
    'parse_goal',
    'predicate_of',
    'read_mission',
    'read_scene',
    'sensor_leaf',
    'skill_problem',
]
