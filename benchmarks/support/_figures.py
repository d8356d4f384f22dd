# SPDX-License-Identifier: BSD-3-Clause
"""What benchmarks have in common: where figures go, processor time, installing a behavior."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Any


def write_figures(file: Path, figures: Any) -> None:
    """Write figures as JSON; directories that are missing are made."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(figures, indent=2) + '\n')


# What benchmarks of several processes have in common.


def processor_time(process: int) -> float:
    """User and system time of a process so far, s, of its threads that have ended, too: clock_getcpuclockid(3)."""
    return time.clock_gettime((~process << 3) | 2)  # CPUCLOCK_SCHED of linux/posix-timers.h, in nanoseconds


def install_behavior(directory: Path, file: Path, behavior: str) -> None:
    """Make the behavior that is in a module known to the processes that are started from now on.

    ``directory`` gets what an installation would leave, and is put on the Python path.
    """
    module = file.stem
    metadata = directory / f'{module}-0.dist-info'
    metadata.mkdir()
    (metadata / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {module}\nVersion: 0\n')
    (metadata / 'entry_points.txt').write_text(f'[flexbt.behaviors]\n{module} = {module}:{behavior}\n')
    (directory / f'{module}.py').symlink_to(file)
    os.environ['PYTHONPATH'] = f'{directory}{os.pathsep}{os.environ.get("PYTHONPATH", "")}'
