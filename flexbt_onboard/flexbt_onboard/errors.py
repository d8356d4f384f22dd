# SPDX-License-Identifier: BSD-3-Clause
"""The errors of the onboard executive; those of the state machine are in ``state_machine``.

OnboardError
├── BehaviorError               a behavior cannot be used
│   ├── ManifestError           the manifest of a behavior is wrong
│   ├── UnknownBehaviorError    no installed behavior has that name
│   └── BrokenBehaviorError     the behavior is installed, but could not be loaded
├── ParameterError              a value for a behavior's parameter, or an input, is not acceptable
└── CommandRefusedError         a command of the operator has no effect; the text is the reason
"""

from __future__ import annotations

from flexbt_core.errors import FlexbtError


class OnboardError(FlexbtError):
    """Base of the executive's errors; the text is fit for the operator."""


class BehaviorError(OnboardError):
    """A behavior cannot be used."""


class ManifestError(BehaviorError):
    """The manifest of a behavior is wrong."""


class UnknownBehaviorError(BehaviorError):
    """No installed behavior has that name."""


class BrokenBehaviorError(BehaviorError):
    """The behavior is installed, but it could not be loaded."""


class ParameterError(OnboardError):
    """A value for a behavior's parameter, or an input of its state machine, is not acceptable."""


class CommandRefusedError(OnboardError):
    """A command of the operator has no effect; the text is the reason."""
