# SPDX-License-Identifier: BSD-3-Clause
"""The errors of synthesis."""

from __future__ import annotations

from collections.abc import Iterable

from flexbt_core.errors import FlexbtError


class SynthesisError(FlexbtError):
    """An input that cannot be read or turned into a machine; ``problems`` lists the reasons, each with its place."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(problems)
        super().__init__('\n'.join(self.problems))


class SynthesisTimeout(FlexbtError):
    """The time limit was reached before an answer was found; the text reports the progress."""
