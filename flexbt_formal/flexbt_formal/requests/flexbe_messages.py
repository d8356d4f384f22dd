# SPDX-License-Identifier: BSD-3-Clause
"""Machines as messages of FlexBE, where the package ``flexbe_msgs`` is installed."""

from __future__ import annotations

from typing import Any

from flexbt_common.values import from_plain, resolve_type
from flexbt_formal.synthesis.machines import SynthesizedMachine, state_instantiations


def flexbe_messages(machine: SynthesizedMachine) -> list[Any]:
    """The machine as ``flexbe_msgs/StateInstantiation[]``, each field checked against the installed definition.

    Raises:
        SynthesisError: FlexBE's form does not hold this machine.
        FlexbtError: ``flexbe_msgs`` is not installed.
        FieldError: the installed definition has other fields.
    """
    messages: list[Any] = from_plain(
        state_instantiations(machine), resolve_type('flexbe_msgs/msg/StateInstantiation[]')
    )
    return messages
