# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong with manifests."""

from __future__ import annotations

from collections.abc import Iterable

from flexbt_core.errors import FlexbtError


class SkillError(FlexbtError):
    """Manifests that cannot be used. ``problems`` has everything that is wrong, as ``place: what; what to do``."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems: tuple[str, ...] = tuple(problems)
        super().__init__('\n'.join(self.problems))
