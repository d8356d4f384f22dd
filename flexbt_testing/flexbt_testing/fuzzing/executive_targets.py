# SPDX-License-Identifier: BSD-3-Clause
"""What an executive reads: commands of operators, by a real one on its topics, and the journal that it finds."""

from __future__ import annotations

import collections
import contextlib
import itertools
import json
import re
import tempfile
from collections.abc import Hashable
from pathlib import Path

from flexbt_common.values import text_to_value
from flexbt_core.clock import ManualClock
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine import EventState, OperatableStateMachine, UserData
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveStatus
from flexbt_onboard.commands import COMMAND_LENGTHS
from flexbt_onboard.durability import RunJournal, encode_head, encode_line
from flexbt_onboard.errors import CommandRefusedError
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of

from .fuzzer import Target

COMMAND_WORDS = """
    id kind operator_id executive_id run_id decision_id path outcome autonomy behavior arguments inputs grantee text
    reason @RUN @EXECUTIVE /A /A/B Test done failed tester ann 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21
    22 23 255 : , [ ] { } "" {name: x, value: y} {key: k, type: float64, text: nan}
""".split()  # noqa: SIM905
COMMANDS = (
    *(f'{{kind: {kind}, run_id: @RUN, path: /A, outcome: done}}' for kind in range(24)),
    '{kind: 1, behavior: Test, autonomy: 3}',
    '{kind: 1, behavior: Test, autonomy: 1, executive_id: @EXECUTIVE, operator_id: ann}',
    '{kind: 1, behavior: Test, inputs: [{key: k, type: float64, text: "1"}], arguments: [{name: x, value: y}]}',
    '{kind: 4, run_id: @RUN, decision_id: "1"}',
    '{kind: 3, run_id: @RUN, autonomy: 0, path: /Both}',
    '{kind: 13, run_id: @RUN, behavior: Test}',
    '{kind: 20, run_id: @RUN, grantee: ann, operator_id: tester}',
    '{kind: 22, grantee: ann, operator_id: tester}',
    '{kind: 21, text: "a remark", reason: why}',
)

JOURNAL_WORDS = """
    "begin" "run" "behavior" "arguments" "inputs" "by" "autonomy" "position" "end" "commands" "path" "states" "levels"
    : , [ ] { } "" null true 0 1 -1 1e999 "x" "AA==" "\\ud800" "/A\\ud800"
""".split()  # noqa: SIM905
JOURNALS = (
    '{"begin": {"run": "r", "behavior": "Test", "arguments": [["x", "y"]], "inputs": [["k", "float64", "1.0", ""]], '
    '"by": "ann", "autonomy": 1}}\n{"run": "r", "position": {"active": ["/A"], "coming": [], "levels": {"/": 1}, '
    '"locked": ["/A"], "breakpoints": []}}\n{"commands": [["c", 1, ""]]}\n{"run": "r", "end": "x"}',
    '{"commands": [["c1", 2, "no"], ["c2", 1, ""]]}',
)


class Waiting(EventState):
    """Until an operator forces an outcome."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done', 'failed'])

    def execute(self, userdata: UserData) -> str | None:
        return None


def machine() -> OperatableStateMachine:
    root = OperatableStateMachine(outcomes=['done', 'failed'])
    with root:
        OperatableStateMachine.add('A', Waiting(), transitions={'done': 'B', 'failed': 'failed'})
        OperatableStateMachine.add('B', Waiting(), transitions={'done': 'done', 'failed': 'A'})
    return root


class CommandTarget(Target):
    """Each command is answered, or ignored for a reason, and the executive goes on."""

    words = tuple(COMMAND_WORDS)

    def __init__(self) -> None:
        self._bench = ExecutiveBench(behavior_of(machine))
        self._numbers = itertools.count(1)

    def seeds(self) -> list[str]:
        return list(COMMANDS)

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        bench = self._bench
        text = data.decode('utf-8', 'replace').replace('@RUN', bench.run_id or '""')
        text = text.replace('@EXECUTIVE', bench.status.executive_id)
        try:
            command = text_to_value(text, 'flexbt_msgs/ExecutiveCommand')
        except FlexbtError:
            counts['no message'] += 1
            return 'no message'
        if len(command.id) <= COMMAND_LENGTHS['id']:
            command.id = f'fuzzed-{next(self._numbers)}'
        fields = {name: getattr(command, name) for name in command.get_fields_and_field_types()}
        bench.send(**fields)
        if len(command.id) > COMMAND_LENGTHS['id'] or command.executive_id not in ('', bench.status.executive_id):
            bench.send(ExecutiveCommand.NOTE, id=(asked := f'after-{next(self._numbers)}'), text='is anybody there?')
            counts['ignored'] += 1
        else:
            asked = command.id
        result = bench.result(asked)
        counts['read' if result.code == CommandResult.APPLIED else 'refused'] += 1
        assert bench.status.state != ExecutiveStatus.UNKNOWN
        return command.kind, result.code, ' '.join(re.findall('[a-z]{3,}', result.reason)[:5])

    def close(self) -> None:
        self._bench.close()


class JournalTarget(Target):
    """A journal, each line of it numbered and with its checksum, or as it is; what is found in it can be asked for."""

    words = tuple(JOURNAL_WORDS)

    def __init__(self) -> None:
        self._directory = tempfile.TemporaryDirectory(prefix='fuzzed_journal_')

    def seeds(self) -> list[str]:
        return list(JOURNALS)

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        kinds: list[Hashable] = []
        for content in (data, _numbered(data)):
            file = Path(self._directory.name) / 'executive.journal'
            file.write_bytes(content)
            journal = RunJournal(self._directory.name, '/executive', lambda _problem: None, ManualClock())
            try:
                counts['refused' if journal.corruption else 'read'] += 1
                run = journal.interrupted
                if run is not None:
                    shown = (run.run_id, run.behavior, run.by, *run.active, *run.levels, *run.locked, *run.breakpoints)
                    _ = run.autonomy, [text.encode() for text in shown]
                    with contextlib.suppress(CommandRefusedError):
                        run.position()
                _ = [(result.command_id.encode(), result.reason.encode()) for result in journal.results]
                kinds.append((run is None, len(journal.results), journal.corruption.split(':')[-1][:40]))
                journal.sync(10.0)
            finally:
                journal.close()
            for left in Path(self._directory.name).iterdir():
                left.unlink()
        return tuple(kinds)

    def close(self) -> None:
        self._directory.cleanup()


def _numbered(data: bytes) -> bytes:
    """The lines that are JSON, as a journal has them."""
    lines = [encode_head()]
    for raw in data.decode('utf-8', 'replace').splitlines():
        try:
            lines.append(encode_line(len(lines), json.loads(raw)))
        except (ValueError, TypeError, RecursionError):
            continue
    return b''.join(lines)
