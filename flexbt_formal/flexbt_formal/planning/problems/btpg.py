# SPDX-License-Identifier: BSD-3-Clause
"""The scenes of BTPG (Cai et al., IJCAI 2025), as they are published extracted: grounded actions with costs."""

from __future__ import annotations

from collections.abc import Iterable

from flexbt_core.values import load_json, shown

from .model import Action, Condition, PlanningError


def read_scene(scene: str, actions: Iterable[str], source: str = '<scene>') -> tuple[tuple[Action, ...], Condition]:
    """The actions of a scene, and what holds at its start.

    Args:
        scene: JSON with ``initial``, a list of literals.
        actions: lines of JSON with ``name``, ``pre``, ``add``, ``del`` and ``cost``.
        source: named in errors.

    Raises:
        PlanningError: a text is not of this form; names the line.
    """
    try:
        initial = _literals(load_json(scene)['initial'])
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise PlanningError(
            f'{source}: no scene of BTPG: expected JSON with a list "initial" ({shown(error)})'
        ) from None
    found = []
    for number, line in enumerate(actions, 1):
        try:
            entry = load_json(line)
            effects = {name: _literals(entry[name]) for name in ('pre', 'add', 'del')}
            found.append(
                Action(str(entry['name']), effects['pre'], effects['add'], effects['del'], float(entry['cost']))
            )
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
            raise PlanningError(
                f'{source}, action {number}: expected JSON with name, pre, add, del and cost ({shown(error)})'
            ) from None
    return tuple(found), initial


def _literals(entry: object) -> Condition:
    if not isinstance(entry, list) or not all(isinstance(one, str) for one in entry):
        raise TypeError(f'{shown(entry)} is no list of literals')
    return frozenset(entry)
