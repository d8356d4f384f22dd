# SPDX-License-Identifier: BSD-3-Clause
"""The steps of a proof as plain data, for tests and for JSON."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from flexbt_formal.exploration import Label, Move


def plain_moves(moves: Iterable[Move]) -> list[list[Any]]:
    """Each as kind, subject, value, answers."""
    return [[*label, list(answers)] for label, answers in moves]


def moves_of(plain: Iterable[Sequence[Any]]) -> tuple[Move, ...]:
    """What :func:`plain_moves` was given."""
    return tuple(Move(Label(kind, subject, value), tuple(answers)) for kind, subject, value, answers in plain)
