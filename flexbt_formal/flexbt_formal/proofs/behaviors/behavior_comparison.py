# SPDX-License-Identifier: BSD-3-Clause
"""Two versions of a behavior side by side: the trees that the same states run, and the machines."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from typing import NamedTuple

from flexbt_core.state_machine import MachineDefinition
from flexbt_formal.exploration import Bounds, Limits, MachineSystem, Progress, compare
from flexbt_formal.proofs.trees import Compared, compare_trees
from flexbt_tools.behaviors import UsedTrees

from .behavior_proof import named_progress
from .blackboards import Blackboards
from .environment import state_models


class Version(NamedTuple):
    """One of both: its machine, and the trees that this runs."""

    machine: MachineDefinition
    used: UsedTrees


def compare_behaviors(
    name: str,
    before: Version,
    now: Version,
    bounds: Bounds,
    *,
    seconds: float,
    configurations: int,
    given: Collection[str] = (),
    on_progress: Callable[[str, Progress], None] | None = None,
) -> list[Compared]:
    """Compare the trees that the same states run, and the machines, within ``seconds`` of processor time in all.

    Raises TreeLoadError and RefusedError as compare_trees does.
    """
    old = {use.path: use.key for use in before.used.uses}
    pairs = {
        (old[use.path], use.key): use.path
        for use in reversed(now.used.uses)
        if use.key is not None and old.get(use.path) is not None
    }
    end = time.process_time() + seconds
    found: list[Compared] = []

    def limits() -> Limits:  # what one does not use of its time, those after it may
        left = max(end - time.process_time(), 0.0)
        return Limits(left / (len(pairs) + 1 - len(found)), configurations, seconds)

    for (earlier, key), path in reversed(pairs.items()):
        assert earlier is not None
        called = f'tree {key.id}' if earlier.id == key.id else f'tree {key.id} (before: {earlier.id}) of {path}'
        versions = ((before.used.library, earlier), (now.used.library, key))
        tell = named_progress(called, on_progress)
        found.append(compare_trees(*versions, given=given, limits=limits(), on_progress=tell, name=called))

    def make(version: Version) -> MachineSystem:
        models = state_models(version.used, {}, Blackboards.of(version.used, given))
        return MachineSystem(version.machine, models, bounds, reduces=False)

    tell = named_progress('the machine', on_progress)
    return [*found, Compared(f'machine of {name}', compare(lambda: make(before), lambda: make(now), limits(), tell))]
