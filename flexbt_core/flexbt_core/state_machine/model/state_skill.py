# SPDX-License-Identifier: BSD-3-Clause
"""The skill of a state: what it declares, completed by its keys and outcomes."""

from __future__ import annotations

from flexbt_core.skills import Outcome, Skill

from .event_state import EventState


def state_skill(state: EventState) -> Skill:
    """The skill of a state as it was made: of the class, or its own where it has bound what it was made with.

    It reads and writes its keys, and ends by its outcomes, which mean what is declared, or what their names say.
    """
    inner = state.unwrapped
    # The attribute of somebody's state may be something else.
    declared = inner.skill if isinstance(inner.skill, Skill) else Skill()
    skill = declared.completed_by(
        type(inner).__name__, {name: Outcome() for name in state.outcomes}, state.input_keys, state.output_keys
    )
    return skill.lasting(0.0, 0.0) if inner.is_instant else skill
