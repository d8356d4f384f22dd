# SPDX-License-Identifier: BSD-3-Clause
"""Plans for several robots: tasks divided, what runs at the same time, and who takes over when one is lost.

``team`` has what is planned, ``division`` who does what, ``team_policy`` what each robot does in which state beside the
others, ``team_xml`` writes one tree for each robot. It is tried by ``coverage`` of the room around.
"""

from .team import Team, team_problem
from .team_planner import Task, TeamPlan, plan_team
from .team_policy import TeamBranch, TeamPolicy
from .team_xml import team_xml

__all__ = ['Task', 'Team', 'TeamBranch', 'TeamPlan', 'TeamPolicy', 'plan_team', 'team_problem', 'team_xml']
