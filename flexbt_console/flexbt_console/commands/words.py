# SPDX-License-Identifier: BSD-3-Clause
"""What the words of a line may be, as the robot is now; for completion."""

from __future__ import annotations

from collections.abc import Iterable

from flexbt_console.mirror import AutonomyLevel, DecisionKind

from .spec import Typed


def levels(typed: Typed) -> Iterable[str]:
    return (level.name.lower() for level in AutonomyLevel)


def behaviors(typed: Typed) -> Iterable[str]:
    """Those that cannot be loaded come last: whoever starts one is told why it cannot be."""
    return (one.name for one in sorted(typed.view.behaviors or (), key=lambda one: bool(one.error)))


def parameters(typed: Typed) -> Iterable[str]:
    chosen = (behavior for behavior in typed.view.behaviors or () if typed.words[:1] == (behavior.name,))
    return (f'{parameter.name}=' for behavior in chosen for parameter in behavior.parameters)


def states(typed: Typed) -> Iterable[str]:
    view = typed.view
    return (state.path for state in view.structure.states) if view.structure else view.active_levels


def active_states(typed: Typed) -> Iterable[str]:
    return typed.view.active_levels


def locked(typed: Typed) -> Iterable[str]:
    return typed.view.snapshot.locked if typed.view.snapshot else ()


def breakpoints(typed: Typed) -> Iterable[str]:
    return typed.view.snapshot.breakpoints if typed.view.snapshot else ()


def outcomes(typed: Typed) -> Iterable[str]:
    view = typed.view
    if typed.words:
        return view.outcomes(typed.words[0])
    waiting = view.decision.outcomes if view.decision else ()
    return (*waiting, *(view.outcomes(view.active_paths[0]) if len(view.active_paths) == 1 else ()))


def decisions(typed: Typed) -> Iterable[str]:
    return (decision.id for decision in typed.view.decisions)


def input_requests(typed: Typed) -> Iterable[str]:
    return (decision.id for decision in typed.view.decisions if decision.kind is DecisionKind.INPUT)


def requesters(typed: Typed) -> Iterable[str]:
    return typed.view.snapshot.authority_requests if typed.view.snapshot else ()


def userdata_paths(typed: Typed) -> Iterable[str]:
    structure = typed.view.structure
    return (state.path for state in structure.states if state.children) if structure else ()


def robot_names(typed: Typed) -> Iterable[str]:
    """The namespaces of the robots of the domain."""
    return typed.robots


def short_answers(typed: Typed) -> Iterable[str]:
    """What may be typed in short, without a command: the choices of the oldest decision, or the places."""
    decision = typed.view.decision
    if decision is None:
        return ()
    return decision.choices or (sorted(typed.view.places) if decision.wants_pose else ())
