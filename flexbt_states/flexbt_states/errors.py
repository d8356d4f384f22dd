# SPDX-License-Identifier: BSD-3-Clause
"""The errors of flexbt_states.

StateParameterError    a state was constructed with a parameter that cannot work
"""

from __future__ import annotations

from flexbt_core.errors import FlexbtError


class StateParameterError(FlexbtError, ValueError):
    """A state was constructed with a parameter that cannot work; the behavior that contains it cannot start."""

    def __init__(self, state: object, parameter: str, reason: str) -> None:
        super().__init__(f'{type(state).__name__}: parameter {parameter}: {reason}')
        self.parameter = parameter
        self.reason = reason
