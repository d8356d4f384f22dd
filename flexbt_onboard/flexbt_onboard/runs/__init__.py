# SPDX-License-Identifier: BSD-3-Clause
"""Runs of behaviors: each on a thread of its own, seen as values."""

from .behavior_run import BehaviorRun
from .callback_watch import LIMIT, CallbackWatch, HeldUp
from .operator_watch import OperatorWatch
from .run_observer import BehaviorRunObserver
from .run_snapshot import ActiveLeaf, RunDecision, RunEnd, RunPhase, RunSnapshot
from .run_supervisor import LastRun, RunDisplay, RunSupervisor, ShownRun
from .stop_watch import StopWatch

__all__ = [
    'LIMIT',
    'ActiveLeaf',
    'BehaviorRun',
    'BehaviorRunObserver',
    'CallbackWatch',
    'HeldUp',
    'LastRun',
    'OperatorWatch',
    'RunDecision',
    'RunDisplay',
    'RunEnd',
    'RunPhase',
    'RunSnapshot',
    'RunSupervisor',
    'ShownRun',
    'StopWatch',
]
