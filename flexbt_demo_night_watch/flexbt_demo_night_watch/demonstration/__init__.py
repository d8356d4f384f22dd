# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``night_watch``: processes of the two robots, the scripted operator, and the picture."""

from .script import BRANCHES, night_watch
from .watch import ROUNDS, Watch, open_watch
from .watch_processes import ROBOTS, config_file, place_poses, watch_processes, watch_world

__all__ = [
    'BRANCHES',
    'ROBOTS',
    'ROUNDS',
    'Watch',
    'config_file',
    'night_watch',
    'open_watch',
    'place_poses',
    'watch_processes',
    'watch_world',
]
