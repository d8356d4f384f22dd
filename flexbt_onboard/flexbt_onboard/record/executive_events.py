# SPDX-License-Identifier: BSD-3-Clause
"""What happens around the runs, told to operator and record: nodes, consoles, authority, questions, faults."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexbt_msgs.msg import BehaviorList, ExecutiveLog
from flexbt_onboard.runs.run_view import waiting_fields

if TYPE_CHECKING:
    from flexbt_onboard.node.executive import Executive


class ExecutiveNews:
    """Tells what happens around the runs. On the executor thread, except where it says otherwise.

    ``problems`` says what is wrong with the record and the journal; '' for nothing.
    """

    def __init__(self, executive: Executive) -> None:
        self.problems: dict[str, str] = {}
        self._executive = executive
        self._noted: set[str] = set()  # questions

    def announce(self) -> None:
        """The executive begins: what it has, and what is wrong with it."""
        executive = self._executive
        entries = executive.library.entries.values()
        executive.link.publish_behaviors(BehaviorList(behaviors=[entry.to_message() for entry in entries]))
        for entry in entries:
            if entry.error:
                executive.link.log(
                    ExecutiveLog.WARN, f'behavior {entry.name!r} of {entry.package} is broken: {entry.error}'
                )
        interrupted = executive.interrupted
        if interrupted is not None:
            executive.link.log(
                ExecutiveLog.WARN,
                f'behavior {interrupted.behavior!r} was interrupted by the end of the executive in '
                f'{", ".join(interrupted.active) or "its beginning"}; an operator has to resume or abort it',
                run_id=interrupted.run_id,
            )
        executive.changed()

    def authority(self, text: str) -> None:
        """Another operator has the authority to command, or asks for it."""
        executive = self._executive
        executive.link.log(ExecutiveLog.INFO, text)
        executive.record.note(
            'authority', holder=executive.authority.holder, requests=executive.authority.requests[:], text=text
        )
        executive.changed()

    def questions(self) -> None:
        """A question to the operator has come or gone."""
        executive = self._executive
        pending = {decision.id: decision for decision in executive.questions.decisions()}
        for decision_id in pending.keys() - self._noted:
            executive.record.note('waiting', run=executive.shown_run_id, **waiting_fields(pending[decision_id]))
        for decision_id in self._noted - pending.keys():
            executive.record.note('decided', run=executive.shown_run_id, decision=decision_id)
        self._noted = set(pending)
        executive.changed()

    def operators(self, text: str, is_warning: bool) -> None:
        """Consoles have come or gone."""
        executive = self._executive
        executive.link.log(ExecutiveLog.WARN if is_warning else ExecutiveLog.INFO, text)
        executive.record.note('operator', text=text)

    def problem(self, file: str, severity: int, text: str) -> None:
        """The record or the journal cannot be written; ``text`` is '' when it can be again. From any thread."""
        executive = self._executive
        self.problems[file] = text
        told = severity if text else ExecutiveLog.INFO
        executive.runtime.post(lambda: executive.link.log(told, text or f'the {file} is written again'))

    def peer(self, name: str, alive: bool, seen_before: bool) -> None:
        """A node that the executive depends on has come or gone."""
        executive = self._executive
        run_id = executive.run.run_id if executive.run is not None else ''
        if alive:
            executive.link.log(
                ExecutiveLog.INFO, f'{name} is alive {"again" if seen_before else ""}'.rstrip(), run_id=run_id
            )
        else:
            executive.link.log(ExecutiveLog.ERROR, f'{name} is not alive any more', run_id=run_id)
        self._nodes_changed()

    def peer_ready(self, name: str, ready: bool) -> None:
        """A node that the executive depends on has become ready, or is not any more."""
        executive = self._executive
        run_id = executive.run.run_id if executive.run is not None else ''
        if ready:
            executive.link.log(ExecutiveLog.INFO, f'{name} is ready', run_id=run_id)
        elif name in executive.peers.unready():  # not when it has died, which is told already
            executive.link.log(ExecutiveLog.WARN, f'{name} is alive, but not ready any more', run_id=run_id)
        self._nodes_changed()

    def _nodes_changed(self) -> None:
        executive = self._executive
        if executive.run is not None:
            executive.run.nodes_changed()
        executive.changed()

    def fault(self, error: BaseException) -> None:
        """A callback let an exception escape."""
        executive = self._executive
        executive.link.log(
            ExecutiveLog.ERROR, f'fault in the executive, which goes on: {type(error).__name__}: {error}'
        )
