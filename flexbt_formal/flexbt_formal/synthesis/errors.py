# SPDX-License-Identifier: BSD-3-Clause
"""The errors of synthesis."""

from __future__ import annotations

from collections.abc import Iterable

from flexbt_core.errors import FlexbtError


class SynthesisError(FlexbtError):
    """Something cannot be read, or not be made a machine of; ``problems`` are what is wrong, each with its place."""

    def __init__(self, problems: Iterable[str]) -> None:
        self.problems = tuple(problems)
        super().__init__('\n'.join(self.problems))


class SynthesisTimeout(FlexbtError):
    """The time limit was reached before there was an answer; the text says how far it had come."""
