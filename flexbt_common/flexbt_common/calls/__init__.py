# SPDX-License-Identifier: BSD-3-Clause
"""Actions and services with deadlines and exactly one outcome."""

from .action_call import ActionCall, ActionLinks, ActionServerLink, GoalOutcome, GoalStatus
from .goal_admission import GoalAdmission
from .goal_server import GoalFault, GoalServer, ServedGoal, goal_servers, set_error
from .service_call import ServiceCall, ServiceLink, ServiceLinks, ServiceOutcome, service_outcome

__all__ = [
    'ActionCall',
    'ActionLinks',
    'ActionServerLink',
    'GoalAdmission',
    'GoalFault',
    'GoalOutcome',
    'GoalServer',
    'GoalStatus',
    'ServedGoal',
    'ServiceCall',
    'ServiceLink',
    'ServiceLinks',
    'ServiceOutcome',
    'goal_servers',
    'service_outcome',
    'set_error',
]
