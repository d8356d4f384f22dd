# SPDX-License-Identifier: BSD-3-Clause
"""What the operator was asked, and has allowed: a transition that needs it has it, for just this request."""

from __future__ import annotations

from collections.abc import Mapping

from flexbt_core.state_machine import Decision, is_inside

from .properties import Property, Violation


class Approvals:
    """Of each state or machine the last request, and what is allowed."""

    def __init__(self) -> None:
        self._asked: dict[str, Decision] = {}
        self._given: dict[str, str] = {}

    def resume(self, given: Mapping[str, str]) -> None:
        """What was allowed in a run before holds: outcomes by paths."""
        self._asked.clear()
        self._given = dict(given)

    def asked(self, decision: Decision) -> None:
        """The operator is asked; an older request for the same is void."""
        self._asked[decision.path] = decision

    def confirmed(self, decision_id: str) -> Violation | None:
        """The operator has confirmed a request."""
        for path, decision in self._asked.items():
            if decision.id == decision_id:
                self._given[path] = decision.outcome
                del self._asked[path]
                return None
        return Violation(Property.APPROVAL, '/', f'request {decision_id} was confirmed, and is not pending')

    def forced(self, path: str, outcome: str) -> None:
        """The operator wants a state or machine to be left by an outcome."""
        self._given[path] = outcome
        self._asked.pop(path, None)

    def leaves(self, path: str, outcome: str, may_pass: bool) -> Violation | None:
        """A state or machine is left by an outcome, which ``may_pass`` without the operator, or may not."""
        asked = self._asked.pop(path, None) if self._asked else None
        given = self._given.pop(path, None) if self._given else None
        if self._given or self._asked:  # what is in it is left, too
            for inner in [one for one in (*self._given, *self._asked) if is_inside(one, path)]:
                self._given.pop(inner, None)
                self._asked.pop(inner, None)
        if may_pass or given == outcome:
            return None
        if given is not None:
            why = f'approved was {given!r}'
        else:
            why = 'nobody was asked' if asked is None else f'request {asked.id} was not answered'
        return Violation(
            Property.APPROVAL, path, f'{path} was left by {outcome!r}, which needs the operator, and {why}'
        )
