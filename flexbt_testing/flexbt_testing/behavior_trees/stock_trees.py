# SPDX-License-Identifier: BSD-3-Clause
"""Trees that come with Nav2, read from a clone of its repository if one is available."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Final

WORKSPACE: Final = Path(__file__).resolve().parents[3]
"""The top of the checkout."""

DIRECTORY: Final = 'nav2_bt_navigator/behavior_trees'


def stock_trees(branch: str) -> Mapping[str, str]:
    """Return the trees of a branch of ros-navigation/navigation2 as name: XML; none without a clone.

    The clone is the directory in the environment variable FLEXBT_NAVIGATION2, or one next to the workspace.
    """
    named = os.environ.get('FLEXBT_NAVIGATION2')
    clones = [Path(named)] if named else sorted(WORKSPACE.parent.glob('*/*navigation2/repo'))
    if not clones:
        return {}
    listed = _git(clones[0], 'ls-tree', '--name-only', branch, f'{DIRECTORY}/').splitlines()
    return {Path(path).name: _git(clones[0], 'show', f'{branch}:{path}') for path in listed if path.endswith('.xml')}


def _git(clone: Path, *words: str) -> str:
    done = subprocess.run(
        ['git', '-c', f'safe.directory={clone}', '-C', clone, *words],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout
