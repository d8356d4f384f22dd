# SPDX-License-Identifier: BSD-3-Clause
"""Commands for the executive, made from what the operator wants and what the operator sees.

A command is bound to the view from which it was made: to the run, and to the decision that it answers. Commands that
cannot work are refused here, and the message lists those that would; the executive checks everything again.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from flexbt_console.errors import NotShownError, RefusedError
from flexbt_console.mirror.records import (
    AutonomyLevel,
    Behavior,
    CommandKind,
    Decision,
    DecisionKind,
    ExecutiveState,
    InputValue,
    OperatorCommand,
    StateKind,
)
from flexbt_console.mirror.view import View
from flexbt_core.values.text import did_you_mean, one_line, short_repr

from .operator_values import answer, parameter_value


class CommandBuilder:
    """A builder of the commands of one operator.

    Without an operator (None) the user is an observer, and every command is refused for the reason ``why``.
    """

    def __init__(self, operator: str | None, why: str = 'an observer cannot send commands; omit --observer') -> None:
        self.operator = operator
        self._why = why

    def require_operator(self) -> str:
        """Return the name of the operator. Raises RefusedError if the user is an observer."""
        if self.operator is None:
            raise RefusedError(self._why)
        return self.operator

    def command(self, view: View, kind: CommandKind, **fields: Any) -> OperatorCommand:
        """Return a new command with these fields for the run on display.

        A STOP names no executive: another one than that on display may have replaced it.

        Raises:
            RefusedError: the user is an observer, who cannot send commands.
        """
        snapshot = view.snapshot
        command = OperatorCommand(
            id=os.urandom(16).hex(),
            kind=kind,
            operator=self.require_operator(),
            executive_id=snapshot.executive_id if snapshot and kind is not CommandKind.STOP else '',
            run_id=snapshot.run_id if snapshot else '',
            stops=view.stops,
        )
        return replace(command, **fields)

    def start(
        self,
        view: View,
        name: str,
        arguments: Sequence[tuple[str, str]] = (),
        autonomy: AutonomyLevel | None = None,
        inputs: Sequence[InputValue] = (),
        *,
        unseen: bool = False,
    ) -> OperatorCommand:
        """Start a behavior; without a level of autonomy, at the one that the executive shows.

        ``unseen``: allow a synthesized behavior whose machine has not arrived; likewise for :meth:`switch`.

        Raises:
            NotShownError: its machine has not arrived.
            RefusedError: there is no such behavior or parameter, or the behavior cannot be used.
        """
        check_behavior(view, name, arguments, unseen)
        shown = view.snapshot.autonomy if view.snapshot else AutonomyLevel.LOW
        return self.command(
            view,
            CommandKind.START,
            run_id='',
            behavior=name,
            arguments=tuple(arguments),
            autonomy=int(shown if autonomy is None else autonomy),
            inputs=tuple(inputs),
        )

    def switch(
        self, view: View, name: str, arguments: Sequence[tuple[str, str]] = (), *, unseen: bool = False
    ) -> OperatorCommand:
        """Switch to another behavior, keeping the active states.

        Raises:
            NotShownError: its machine has not arrived.
            RefusedError: there is no such behavior or parameter, or the behavior cannot be used.
        """
        check_behavior(view, name, arguments, unseen)
        return self.command(view, CommandKind.SWITCH, behavior=name, arguments=tuple(arguments))

    def autonomy(self, view: View, level: AutonomyLevel, path: str = '') -> OperatorCommand:
        """Set the level of autonomy, of the run, of a sub-tree of it, or for the next run.

        Raises:
            RefusedError: there is no such state.
        """
        command = self.command(view, CommandKind.AUTONOMY, autonomy=int(level))
        path = _known_path(view, path) if path else ''
        return replace(command, run_id=command.run_id if view.running else '', path=path)

    def resume(self, view: View) -> OperatorCommand:
        """Resume a paused run, or one that was interrupted when the executive ended."""
        is_interrupted = view.snapshot is not None and view.snapshot.state is ExecutiveState.INTERRUPTED
        return self.command(view, CommandKind.RESUME_RUN if is_interrupted else CommandKind.RESUME)

    def repeat(self, view: View, path: str = '') -> OperatorCommand:
        """Leave a state and enter it again. The default path is the waiting state, or the only active one.

        Raises:
            RefusedError: which state is meant is not clear, or it is not active.
        """
        path = _active_path(view, path) if path else _waiting_path(view)
        return self.command(view, CommandKind.REPEAT, path=path)

    def at_path(self, kind: CommandKind, view: View, path: str) -> OperatorCommand:
        """Return a command for a state or container, active or not: lock or unlock it, set or clear a breakpoint.

        Raises:
            RefusedError: there is no such state.
        """
        return self.command(view, kind, path=_known_path(view, path))

    def confirm(self, view: View, decision_id: str = '', *, unseen: bool = False) -> OperatorCommand:
        """Confirm a transition, or the suggestion of a choice. Without an identifier: of the only decision.

        An identifier that is not pending here is sent anyway: the executive reports its result. ``unseen``: also when
        what the decision is about has not arrived; so for the other answers.

        Raises:
            NotShownError: what it is about has not arrived.
            RefusedError: nothing or too much is pending, or it cannot be confirmed.
        """
        decision = view.pending(decision_id) if decision_id else _only(view.decisions, 'decision')
        if decision is not None:
            if decision.kind is DecisionKind.INPUT:
                raise RefusedError(f'{decision.id} asks for a value ({decision.input_type}); use "input VALUE"')
            if not decision.outcome:
                raise RefusedError(
                    f'{decision.id} suggests no outcome; choose by "force OUTCOME": {", ".join(decision.outcomes)}'
                )
            _check_shown(view, decision, unseen)
            decision_id = decision.id
        return self.command(view, CommandKind.CONFIRM, decision_id=decision_id)

    def step(self, view: View, kind: CommandKind, decision_id: str = '', *, unseen: bool = False) -> OperatorCommand:
        """Confirm a transition, and hold a later one; see :meth:`confirm`."""
        return replace(self.confirm(view, decision_id, unseen=unseen), kind=kind)

    def at_hold(
        self, kind: CommandKind, view: View, run_id: str = '', node: str = '', condition: str = ''
    ) -> OperatorCommand:
        """Return a command for a tree that is held or paused; the default is the only one.

        It names the hold that the operator sees: given twice, it does not let the tree go from the next one as well.

        Raises:
            RefusedError: no tree is held, or several are.
        """
        holds = view.snapshot.tree_holds if view.snapshot else ()
        if not run_id and len(holds) != 1:
            listed = ', '.join(f'{one_line(hold.run_id)} ({one_line(hold.tree)})' for hold in holds)
            raise RefusedError(f'several trees are held; name one by --run: {listed}' if holds else 'no tree is held')
        hold = next((one for one in holds if run_id in ('', one.run_id)), None)
        if hold is not None and (hold.path or kind is not CommandKind.TREE_STEP):
            run_id = f'{hold.run_id}@{hold.since * 1e6:.0f}'
        return self.command(view, kind, tree_run_id=run_id or holds[0].run_id, path=node, text=condition)

    def choose(self, view: View, decision: Decision, outcome: str, *, unseen: bool = False) -> OperatorCommand:
        """Answer a decision by an outcome: confirm it if the state wants it, else force it.

        Raises:
            NotShownError: what it is about has not arrived.
            RefusedError: the decision does not have this outcome.
        """
        if outcome not in decision.outcomes:
            raise RefusedError(
                f'{decision.path} has no outcome {short_repr(outcome)}; choose one of {", ".join(decision.outcomes)}'
            )
        _check_shown(view, decision, unseen)
        if outcome == decision.outcome:
            return self.command(view, CommandKind.CONFIRM, decision_id=decision.id)
        return self.command(view, CommandKind.FORCE, decision_id=decision.id, path=decision.path, outcome=outcome)

    def force(
        self, view: View, path: str, outcome: str, decision_id: str = '', *, unseen: bool = False
    ) -> OperatorCommand:
        """Leave a state by an outcome. The default path is the waiting state, or the only active one.

        Raises:
            NotShownError: it overrides a decision, and what that is about has not arrived.
            RefusedError: the state is ambiguous or not active, or does not have this outcome.
        """
        if path:
            path = _active_path(view, path)
        elif decision_id:
            path = _pending(view, decision_id).path
        else:
            path = _waiting_path(view)
        outcomes = view.outcomes(path)
        if outcomes and outcome not in outcomes:
            raise RefusedError(f'{path} has no outcome {short_repr(outcome)}; choose one of {", ".join(outcomes)}')
        if not decision_id:
            # Send the decision that the operator overrides. If another one has appeared meanwhile, the executive
            # refuses, instead of leaving a state that the operator has not seen.
            decision_id = next(
                (d.id for d in view.decisions if d.path == path and d.kind is not DecisionKind.INPUT), ''
            )
        if (decision := view.pending(decision_id)) is not None:
            _check_shown(view, decision, unseen)
        return self.command(view, CommandKind.FORCE, path=path, outcome=outcome, decision_id=decision_id)

    def answer(self, view: View, decision_id: str, text: str, *, unseen: bool = False) -> OperatorCommand:
        """Answer an input request with a value. The default identifier is that of the only request.

        Raises:
            NotShownError: what it is about has not arrived.
            RefusedError: the request does not exist, or the text is not a value of the wanted type.
        """
        decision = _input_request(view, decision_id)
        _check_shown(view, decision, unseen)
        return self.command(
            view,
            CommandKind.ANSWER,
            decision_id=decision.id,
            inputs=(answer(decision, text, view.places),),
        )

    def decline(self, view: View, decision_id: str = '') -> OperatorCommand:
        """Decline an input request. The default identifier is that of the only request.

        Raises: RefusedError: the request does not exist.
        """
        decision = _input_request(view, decision_id)
        return self.command(view, CommandKind.DECLINE, decision_id=decision.id)

    def to_requester(self, kind: CommandKind, view: View, operator: str = '') -> OperatorCommand:
        """Return a command that hands the authority over to an operator, or refuses it. The default is the operator who
        requests it.

        Raises:
            RefusedError: no name was passed, and nobody or several operators request it.
        """
        asking = view.snapshot.authority_requests if view.snapshot else ()
        if not operator and len(asking) != 1:
            who = f'requested by {", ".join(asking)}' if asking else 'nobody requests the authority'
            raise RefusedError(f'name the operator; {who}')
        return self.command(view, kind, grantee=operator or asking[0])


def _check_shown(view: View, decision: Decision, unseen: bool) -> None:
    lacking = view.lacks(decision)
    if lacking and not unseen:
        raise NotShownError(
            f'the subject of {decision.path} was not received ({lacking}); nothing was sent. '
            'Wait for it, or answer anyway with --unseen'
        )


def _describe(decision: Decision) -> str:
    what = decision.input_type if decision.kind is DecisionKind.INPUT else decision.outcome or 'a choice'
    return f'{decision.id} ({decision.path}: {what})'


def _only(decisions: Sequence[Decision], what: str) -> Decision:
    if not decisions:
        raise RefusedError(f'no {what} is pending')
    if len(decisions) > 1:
        listed = ', '.join(_describe(decision) for decision in decisions)
        raise RefusedError(f'several decisions are pending; name one of them: {listed}')
    return decisions[0]


def _pending(view: View, decision_id: str) -> Decision:
    decision = view.pending(decision_id)
    if decision is None:
        listed = ', '.join(_describe(decision) for decision in view.decisions) or 'none'
        raise RefusedError(f'decision {short_repr(decision_id)} is not pending (any more); pending: {listed}')
    return decision


def _input_request(view: View, decision_id: str) -> Decision:
    if not decision_id:
        inputs = [decision for decision in view.decisions if decision.kind is DecisionKind.INPUT]
        return _only(inputs, 'input request')
    decision = _pending(view, decision_id)
    if decision.kind is not DecisionKind.INPUT:
        raise RefusedError('This decision takes no value; use confirm or force')
    return decision


def _waiting_path(view: View) -> str:
    waiting = [decision for decision in view.decisions if decision.kind is not DecisionKind.INPUT]
    if waiting:
        return _only(waiting, 'decision').path
    active = view.active_paths
    if len(active) != 1:
        states = f'the active states are {", ".join(active)}' if active else 'no state is active'
        raise RefusedError(f'name the state to leave: {states}; use "force PATH OUTCOME"')
    return active[0]


def _active_path(view: View, text: str) -> str:
    levels = view.active_levels
    matches = _ending(levels, text)
    if len(matches) == 1:
        return matches[0]
    if not matches and view.structure is not None:
        known = _known_path(view, text)
        state = view.state(known)
        if state is not None and state.kind is not StateKind.STATE:
            return known  # it may be active though all in it has ended: the executive knows
    active = ', '.join(matches or view.active_paths) or 'none'
    what = 'is not unique' if matches else 'is not active'
    raise RefusedError(f'{short_repr(text)} {what}; active: {active}')


def _known_path(view: View, text: str) -> str:
    """Return the path of a state or container of the run, active or not, from the path or its last labels."""
    known = [state.path for state in view.structure.states] if view.structure else list(view.active_levels)
    if not known:
        return text
    matches = _ending(known, text)
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise RefusedError(f'{short_repr(text)} is not unique: {", ".join(matches)}')
    remedy = did_you_mean(f'/{text.strip("/")}', known, '; see "structure"')
    raise RefusedError(f'there is no state {short_repr(text)}{remedy}')


def _ending(paths: Sequence[str], text: str) -> list[str]:
    """Return the path that equals ``path``, or else the paths that end with its labels."""
    return [text] if text in paths else [path for path in paths if path.endswith(f'/{text.strip("/")}')]


def find_behavior(behaviors: Sequence[Behavior], name: str) -> Behavior:
    """Return the behavior called ``name``, or ``package/name``, as the executive finds it.

    Raises:
        RefusedError: there is none, or several packages have one.
    """
    found = [one for one in behaviors if name in (one.name, f'{one.package}/{one.name}')]
    if len(found) == 1:
        return found[0]
    same = [one.name for one in behaviors if one.name == f'{one.package}/{name}']
    if same:
        raise RefusedError(
            f'several packages have a behavior {short_repr(name)}; say {" or ".join(map(short_repr, same))}'
        )
    remedy = did_you_mean(name, [one.name for one in behaviors], '; see "behaviors"')
    raise RefusedError(f'there is no behavior {short_repr(name)}{remedy}')


def check_behavior(view: View, name: str, arguments: Sequence[tuple[str, str]], unseen: bool) -> None:
    """Raise NotShownError or RefusedError if a behavior cannot be started with these arguments, as far as is known."""
    behaviors: Sequence[Behavior] | None = view.behaviors
    if behaviors is None:
        return
    behavior = find_behavior(behaviors, name)
    if behavior.error:
        raise RefusedError(f'behavior {short_repr(name)} cannot be used: {behavior.error}')
    if behavior.lacks_machine and not unseen:
        raise NotShownError(
            f'behavior {short_repr(name)} was synthesized, and its machine was not received (it may be too long); '
            'nothing was sent. Check its file on the robot, or send it anyway with --unseen'
        )
    parameters = {parameter.name: parameter for parameter in behavior.parameters}
    for key, value in arguments:
        if '/' in key:  # of an embedded behavior, as in /Inner/speed: the executive knows
            continue
        parameter = parameters.get(key)
        if parameter is None:
            known = ', '.join(parameters) or 'none'
            raise RefusedError(
                f'behavior {short_repr(name)} has no parameter {short_repr(key)}; its parameters: {known}'
            )
        parameter_value(parameter, value)
