# SPDX-License-Identifier: BSD-3-Clause
"""Changes of the product, made at run time, that the invariants have to find: ``make nemesis MUTANTS=1``.

An invariant that finds none of them may be too weak to find anything. Each mutation names the plans that provoke it.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

Change = Callable[[Any], Any]
"""A function that returns what replaces the original."""


@dataclass(frozen=True)
class Mutation:
    """A change of an attribute, ``module:Class.attribute``, and the names of the plans that provoke it.

    ``besides``: another mutation, which is made as well since what it removes would do the same job.
    """

    name: str
    where: str
    change: Change
    plans: str
    besides: str = ''

    def apply(self) -> None:
        """Change the product in this process. Raises AttributeError and ImportError if it has no such attribute."""
        if self.besides:
            next(one for one in MUTATIONS if one.name == self.besides).apply()
        module, _, path = self.where.partition(':')
        owner: Any = importlib.import_module(module)
        *classes, attribute = path.split('.')
        for name in classes:
            owner = getattr(owner, name)
        original = vars(owner)[attribute]
        if isinstance(original, property):
            assert original.fget is not None
            setattr(owner, attribute, property(self.change(original.fget)))
        else:
            setattr(owner, attribute, self.change(original))


def _returns(value: Any) -> Change:
    return lambda _original: lambda *_, **__: value


_NOTHING: Final = _returns(None)


def _each(second: int) -> Change:
    """Return a change that leaves out every ``second``-th call."""

    def change(original: Any) -> Any:
        calls = 0

        def sometimes(*arguments: Any, **named: Any) -> Any:
            nonlocal calls
            calls += 1
            return original(*arguments, **named) if calls % second else None

        return sometimes

    return change


def _twice(original: Any) -> Any:
    def twice(*arguments: Any, **named: Any) -> Any:
        original(*arguments, **named)
        return original(*arguments, **named)

    return twice


def _forgets(original: Any) -> Any:
    """Return a receiver of commands that knows none from before."""

    def receive(ledger: Any, command: Any, writer: bytes = b'') -> None:
        ledger._entries.pop(command.id, None)
        original(ledger, command, writer)

    return receive


def _without(*events: str) -> Change:
    """Return a change that drops events of the event log."""

    def change(original: Any) -> Any:
        return lambda log, event, **fields: None if event in events else original(log, event, **fields)

    return change


def _loses_wakes(original: Any) -> Any:
    def wait(event: Any, *arguments: Any) -> Any:
        event._is_set = False
        return original(event, *arguments)

    return wait


def _raises_sometimes(original: Any) -> Any:
    calls = 0

    def receive(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == 20:
            raise ValueError('a mutation')
        return original(*arguments)

    return receive


def _other_status(original: Any) -> Any:
    """Return an end of goals that tells askers another status than the list."""

    def end(server: Any, goal: Any, status: int, result: Any) -> None:
        original(server, goal, status, result)
        goal.status = 6 if status != 6 else 5

    return end


def _without_active(original: Any) -> Any:
    def read(status: Any, event: Any) -> None:
        original(status, event)
        status.snapshot = status.snapshot.__class__(
            **{name: getattr(status.snapshot, name) for name in status.snapshot.__dataclass_fields__} | {'active': ()}
        )

    return read


def _kind_dropped(original: Any) -> Any:
    """Return a journal that writes no decisions."""
    return lambda journal, commands=(), **line: original(journal, (), **line)


def _exits_twice(original: Any) -> Any:
    def call(leaf: Any, name: str, fn: Any, *rest: Any) -> Any:
        if name == 'on_exit':
            fn(*rest)
        return original(leaf, name, fn, *rest)

    return call


_NAVIGATION: Final = 'flexbt_navigation.node:Navigation'
_MOTION: Final = 'flexbt_onboard.runs.motion_stop:MotionStop'
_ENFORCER: Final = 'flexbt_onboard.runs.stop_enforcer:StopEnforcer'
_GUARD: Final = 'flexbt_onboard.node.stop_guard:StopGuard'
_CALL: Final = 'flexbt_common.calls.action_call:ActionCall'
_SERVER: Final = 'flexbt_common.calls.goal_server:GoalServer'
_TREES: Final = 'flexbt_server.actions.tree_goals:TreeGoals'
_OWNERS: Final = 'flexbt_server.actions.goal_owners:GoalOwners'
_LEDGER: Final = 'flexbt_onboard.commands.command_ledger:CommandLedger'
_JOURNAL: Final = 'flexbt_onboard.persistence.run_journal:RunJournal'
_AUTHORITY: Final = 'flexbt_onboard.commands.authority:Authority'
_PEERS: Final = 'flexbt_onboard.link.peers:PeersWatch'
_MIRROR: Final = 'flexbt_console.mirror.mirror:Mirror'
_LEAF: Final = 'flexbt_core.state_machine.engine.leaf:LeafRun'
_M = Mutation

MUTATIONS: Final[tuple[Mutation, ...]] = (
    # stop
    _M(
        'a stop does not cancel the goals of the run',
        'flexbt_onboard.behaviors.run_context:RunGoals.stop',
        _NOTHING,
        'stop hang_bt',
    ),
    _M('a run ignores its stop', 'flexbt_onboard.runs.behavior_run:BehaviorRun.stop', _NOTHING, 'stop'),
    _M('stops are not enforced', f'{_ENFORCER}._check', _NOTHING, 'hang_bt hang_navigation', 'nobody is ever late'),
    _M('a STOP while idle does not halt the robot', f'{_ENFORCER}.halt_robot', _NOTHING, 'stop'),
    _M('no zero velocity is commanded', f'{_MOTION}._command_zero', _NOTHING, 'hang_bt hang_executive'),
    _M(
        'other goals are not canceled',
        f'{_MOTION}._cancel_all',
        _NOTHING,
        'hang_bt hang_executive',
        'nobody is ever late',
    ),
    _M('the guard hears no STOP', f'{_GUARD}._on_stop', _NOTHING, 'hang_executive', 'nobody is ever late'),
    _M('the guard does not hold the robot', f'{_GUARD}._hold', _NOTHING, 'hang_executive', 'nobody is ever late'),
    _M('the guard does not repeat the STOP', f'{_GUARD}._repeat', _NOTHING, 'hang_executive'),
    _M('the guard never releases the robot', f'{_GUARD}._release', _NOTHING, 'hang_executive'),
    _M(
        'an end of the run by a STOP is forgotten',
        'flexbt_onboard.runs.run_supervisor:RunSupervisor._ended',
        _NOTHING,
        'stop',
    ),
    # who moves the robot dies or hangs
    _M('navigation ignores the death of its owners', f'{_NAVIGATION}._on_owner', _NOTHING, 'kill_bt kill_executive'),
    _M('navigation ignores owners that hang', f'{_NAVIGATION}._on_late', _NOTHING, 'hang_bt long_hang'),
    _M('navigation continues after a hang', f'{_NAVIGATION}._after_hang', _NOTHING, 'hang_navigation'),
    _M('trees outlive their owner', f'{_OWNERS}._changed', _NOTHING, 'kill_executive'),
    _M('trees run on while their owner hangs', f'{_OWNERS}._hold', _NOTHING, 'hang_executive long_hang'),
    _M('trees continue after a hang', f'{_TREES}._after_hang', _NOTHING, 'hang_bt long_hang'),
    _M('nobody is ever gone', 'flexbt_common.lifecycle.liveliness:LivelinessWatch._tell', _NOTHING, 'kill_bt'),
    _M(
        'nobody is ever late',
        'flexbt_common.lifecycle.liveliness:LivelinessWatch._tell_late',
        _NOTHING,
        'hang_bt long_hang',
    ),
    _M(
        'the end of a process is not seen',
        'flexbt_common.lifecycle.liveliness:ProcessIdentity.has_ended',
        _returns(False),
        'kill_bt kill_executive',
    ),
    _M('the executive does not show who has died', f'{_PEERS}._alive_changed', _each(6), 'kill_navigation'),
    _M(
        'the executive shows all nodes as alive',
        f'{_PEERS}._alive_changed',
        lambda old: lambda self, peer, alive: old(self, peer, True),
        'kill_navigation',
    ),
    # goals
    _M('a call does not cancel', f'{_CALL}._cancel', _NOTHING, 'force stop'),
    _M('a call does not see that its server is gone', f'{_CALL}._is_gone', _returns(False), 'kill_bt'),
    _M('a call gives up at once', f'{_CALL}._is_gone', _returns(True), 'stop'),
    _M('a call never ends', f'{_CALL}._finish', _NOTHING, 'force stop'),
    _M('a server ignores cancels', f'{_SERVER}._cancel', _NOTHING, 'force stop'),
    _M('a server forgets to answer who waits', f'{_SERVER}.end', _each(2), 'force stop'),
    _M('a server lists another status than it answers', f'{_SERVER}.end', _other_status, 'stop'),
    _M('a tree ignores cancels', f'{_TREES}.cancel', _NOTHING, 'force stop'),
    _M('a tree goal never ends', f'{_TREES}.end', _NOTHING, 'stop'),
    # ledger, journal, event log
    _M('a command that is sent again is applied again', f'{_LEDGER}.receive', _forgets, 'resend'),
    _M('results are forgotten by a crash', f'{_JOURNAL}.results', _returns([]), 'resend_crash'),
    _M('decisions are not journaled', f'{_JOURNAL}.append', _kind_dropped, 'resend_crash'),
    _M('a decision is written twice', 'flexbt_onboard.link.reporter:Reporter.command', _twice, 'stop'),
    _M(
        'refused commands are reported as applied',
        f'{_LEDGER}._settle',
        lambda old: lambda self, one, _reason, fields: old(self, one, None, fields),
        'refused',
    ),
    _M('the begin of a run is not journaled', f'{_JOURNAL}.begin', _NOTHING, 'kill_executive'),
    _M('positions are not journaled', f'{_JOURNAL}.move', _returns(()), 'kill_executive'),
    _M('the end of a run is not journaled', f'{_JOURNAL}.end', _NOTHING, 'crash_after_stop'),
    _M(
        'the journal is not read after a crash',
        'flexbt_onboard.persistence.journal:Journal._read',
        _NOTHING,
        'kill_executive',
    ),
    _M('the journal does not write', 'flexbt_onboard.persistence.journal:Journal._write', _NOTHING, 'kill_executive'),
    _M('ends are not in the event log', 'flexbt_onboard.persistence.event_log:EventLog.add', _without('ended'), 'stop'),
    # authority
    _M('everybody may command', f'{_AUTHORITY}.check', _NOTHING, 'authority'),
    _M(
        'a claim takes the authority from its holder',
        f'{_AUTHORITY}._request',
        lambda _old: lambda self, operator: self._give(operator, 'claimed it'),
        'authority',
    ),
    # engine
    _M('states are not left at a stop', f'{_LEAF}.leave', _NOTHING, 'stop'),
    _M('on_exit is called twice', f'{_LEAF}.call', _exits_twice, 'stop'),
    _M('a pause does not pause the state', f'{_LEAF}.pause', _NOTHING, 'pause'),
    _M('a tree does not hold', 'flexbt_server.runs.tree_run:TreeRun.hold', _NOTHING, 'hang_executive long_hang'),
    _M('a wake-up is lost', 'flexbt_core.clock.waiting:WakeEvent.wait', _loses_wakes, 'preempted'),
    _M('a posted function is lost', 'flexbt_common.runtime.node_runtime:NodeRuntime._post_locked', _each(500), 'stop'),
    _M('a callback raises', 'flexbt_common.calls.goal_server:GoalServer._publish_list', _raises_sometimes, 'stop'),
    _M('a node does not close its parts', 'flexbt_common.runtime.node_runtime:NodeRuntime.close', _NOTHING, 'stop'),
    # what operators see
    _M('a mirror stays live', 'flexbt_console.mirror.freshness:Freshness.age', _returns(0.0), 'cut'),
    _M('a mirror takes old snapshots', f'{_MIRROR}._is_newer', _returns(True), 'delay'),
    _M(
        'active states are not shown',
        'flexbt_onboard.runs.run_snapshot:RunStatus.read',
        _without_active,
        'kill_executive',
    ),
)
