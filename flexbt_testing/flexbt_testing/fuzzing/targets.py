# SPDX-License-Identifier: BSD-3-Clause
"""Fuzzing targets: readers of YAML, values, scripts and tree files, and an executive's commands and journal."""

from __future__ import annotations

import collections
import contextlib
import itertools
import json
import math
import re
import tempfile
from collections.abc import Callable, Hashable, Mapping
from pathlib import Path
from typing import Any, Final

from flexbt_common.values.entries import Encoding, from_entry, text_to_value, to_entry, value_to_text
from flexbt_core.behavior_tree.engine.function_nodes import simple_action, simple_condition, simple_decorator
from flexbt_core.behavior_tree.engine.leaf import StatefulAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, TreeLoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_core.values.yaml_data import YamlError, load_yaml
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveStatus
from flexbt_onboard.commands.command_bounds import COMMAND_LENGTHS
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.persistence.journal import encode_head, encode_line
from flexbt_onboard.persistence.run_journal import RunJournal
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees import random_trees
from flexbt_testing.behavior_trees.bt_tool import ACCEPTED, CORPUS, STOCK_TREES
from flexbt_testing.hostile_yaml import HOSTILE_YAML
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_tools.tree_checks.check import findings

from .fuzzer import Target

YAML_WORDS = r"""
    - ? : , [ ] { } & * ! !! | > ' " % @ ` # --- ... &a *a << ~ null true yes 0x1F 0o17 1_000 1:30 .inf .nan -.inf 1e999
    !!binary !!set !!omap !!timestamp !!int !!float !!python/name:os.system 2026-02-30 key: "\x00" "\ud800"
""".split()  # noqa: SIM905

SCRIPT_WORDS = """
    a b c := = == != < > <= >= && || ! ~ + - * / .. & | ^ ? : ; ( ) 'x' '' true false 1 0x1F 1e999 2.5 -1
    99999999999999999999 += -= *= /= SUCCESS RUNNING @g
""".split()  # noqa: SIM905

VALUE_TYPES = (
    'bool', 'int8', 'uint64', 'int64', 'float32', 'float64', 'string', 'wstring', 'byte', 'float64[]', 'string[]',
    'uint8[]', 'geometry_msgs/PoseStamped', 'geometry_msgs/PoseStamped[]', 'nav_msgs/Path', 'std_msgs/ColorRGBA',
    'builtin_interfaces/Duration', 'nonsense/Type',
)  # fmt: skip
VALUE_TEXTS = (
    'true', '-1', '18446744073709551615', '1.5', 'nan', '[1, 2, 3]', '{x: 1, y: 2}', '"text"', 'a: {b: [c, {d: 1}]}',
    '{header: {frame_id: map}, pose: {position: {x: 3.8, y: 1.2}}}', '[{pose: {position: {x: 1}}}, {}]',
    '{sec: 1, nanosec: 5}', '{"poses": [{"pose": {"orientation": {"w": 1.0}}}]}', 'json:[1, 2]', '1 2 0.5',
)  # fmt: skip


class YamlTarget(Target):
    """:func:`load_yaml`, with and without aliases."""

    words = tuple(YAML_WORDS)

    def seeds(self) -> list[str]:
        return [*HOSTILE_YAML.values(), *VALUE_TEXTS]

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        text = data.decode('utf-8', 'replace')
        kinds: list[Hashable] = []
        for aliases in (False, True):
            try:
                value = load_yaml(text, aliases=aliases)
            except YamlError as error:
                counts['refused'] += 1
                kinds.append(str(error).rsplit(':', 1)[-1][:40])
            else:
                counts['read'] += 1
                kinds.append(_shape(value))
        return tuple(kinds)


class ValueTarget(Target):
    """Typed values, converted to text and binary data and back. The first line of a text names the type."""

    words = (*YAML_WORDS, *VALUE_TYPES)

    def seeds(self) -> list[str]:
        return [f'{type}\n{text}' for type in VALUE_TYPES for text in VALUE_TEXTS]

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        type, _, text = data.decode('utf-8', 'replace').partition('\n')
        try:
            value = text_to_value(text, type)
        except FlexbtError as error:
            counts['refused'] += 1
            return type[:40], str(error).split(':')[0][:30]
        counts['read'] += 1
        again = text_to_value(value_to_text(value, type), type)
        assert _same(again, value), (value, again)
        assert _same(from_entry(to_entry('key', value, type, Encoding.BINARY)), value)
        return type[:40], _shape(value)


class ScriptTarget(Target):
    """Scripts: parsed, then run on a blackboard with some entries."""

    words = tuple(SCRIPT_WORDS)

    def __init__(self) -> None:
        self._scripts = ScriptLibrary()

    def seeds(self) -> list[str]:
        texts = [random_trees.script_case(seed)['xml'] for seed in range(60)]
        quoted = [part for text in texts for part in text.split('"')[1::2]]
        return sorted(
            {part.replace('&lt;', '<').replace('&gt;', '>').replace('&amp;', '&') for part in quoted if ' ' in part}
        )

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        board = Blackboard()
        for key, value in {'a': 1, 'b': 2.5, 'c': 'text', 'd': True}.items():
            board.set(key, value)
        try:
            script = self._scripts.script(data.decode('utf-8', 'replace'))
            script.bind(board).run()
        except BehaviorTreeError as error:
            counts['refused'] += 1
            return str(error).split(':')[-1][:40]
        counts['read'] += 1
        return tuple(sorted(board.keys()))[:6]


def _shape(value: Any, depth: int = 3) -> Hashable:
    """Return the types of a value's parts, to some depth."""
    if depth and isinstance(value, dict):
        return ('dict', *sorted({str(_shape(one, depth - 1)) for one in value.values()}))
    if depth and isinstance(value, list | tuple):
        return ('list', *sorted({str(_shape(one, depth - 1)) for one in value}))
    return type(value).__name__


def _same(one: Any, other: Any) -> bool:
    """Return whether two values are equal; NaN is NaN."""
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one) and math.isnan(other):
        return True
    if hasattr(one, 'get_fields_and_field_types'):
        return all(_same(getattr(one, name), getattr(other, name)) for name in one.get_fields_and_field_types())
    if isinstance(one, list | tuple) or hasattr(one, 'tolist'):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other)


# Behavior-tree files: for any text, the reader returns a document, or errors with places in that text.
#
# A document is then checked as ``bt_tool`` does, built into a tree, and ticked. The texts come from Nav2's trees if
# they are available, from random trees of all nodes, and from hostile documents.

LONGEST_RUN = 60_000
"""Maximum size of a file whose trees are ticked, characters."""
WORDS = r"""
    < > /> </ " ' & &lt; &#65; &#x110000; &#xD800; ; { } {=} {@a} {} = <!-- --> <![CDATA[ ]]> <?xml?> <!DOCTYPE ]>
    ID="Main" name="" _skipIf="a==1" _onHalted="b:=2" _while="true" _autoremap="true" num_cycles="3" BTCPP_format="3"
    -1 1e999 99999999999999999999 0x 1;2;3 json:[1 json:{'a':1} nan true := && || ? : ( ) += <TreeNodesModel>
    <SubTree_ID="Main"/> <include_path="a.xml"/> <Action_ID="AlwaysSuccess"/> <BehaviorTree_ID="T">
    <root_BTCPP_format="4"> <Sequence> </Sequence> </BehaviorTree> </root>""".replace('_ID', ' ID').split()


class Act(StatefulAction):
    """A leaf of the random trees, like the next classes."""

    def on_start(self) -> NodeStatus:
        return NodeStatus.RUNNING

    def on_running(self) -> NodeStatus:
        return NodeStatus.SUCCESS

    def on_halted(self) -> None:
        pass


def _registry() -> NodeRegistry:
    """Return the nodes of the server and of the random trees."""

    def refuse(source: str, error: Exception) -> None:
        raise error

    registry = node_registry(refuse)
    registry.register('Act', Act)
    registry.register('Sync', simple_action(lambda node: NodeStatus.SUCCESS))
    registry.register('Cond', simple_condition(lambda node: False))
    registry.register('Deco', simple_decorator(lambda status, node: status))
    return registry


def _seeds() -> list[str]:
    texts = [file.read_text() for file in STOCK_TREES]
    texts += [random_trees.wheel_case(seed)['xml'] for seed in range(40)]
    texts += [random_trees.script_case(seed)['xml'] for seed in range(40)]
    hostile = [content for content, _ in CORPUS.values()] + list(ACCEPTED.values())
    texts += [content.decode('utf-8', 'replace') for content in hostile if len(content) < 5000]
    return texts


class XmlTarget(Target):
    """A target that reads a document with :func:`load_xml`, then checks it and runs its trees."""

    words = tuple(WORDS)

    def __init__(self) -> None:
        self._registry = _registry()

    def seeds(self) -> list[str]:
        return _seeds()

    def read(self, data: bytes, counts: collections.Counter[str]) -> Hashable:
        includes = dict.fromkeys(['a.xml', 'b.xml'], data)

        def include(path: str, package: str | None, including: str) -> tuple[str, bytes]:
            if path not in includes:
                raise FileNotFoundError(path)
            return path, includes[path]

        try:
            document = load_xml(data, 'file.xml', self._registry, include=include)
            library = TreeLibrary([document])
        except TreeLoadError as error:
            counts['refused'] += 1
            assert error.errors
            lines = data.count(b'\n') + data.count(b'\r') + 1
            for reason in error.errors:
                assert 1 <= reason.line <= lines + 3 and reason.column >= 1, reason
                str(reason).encode()
            return tuple(sorted({' '.join(re.findall('[a-z]{3,}', reason.message)[:4]) for reason in error.errors})[:3])
        counts['read'] += 1
        if document.main is not None and len(data) <= LONGEST_RUN:
            self._run(library, document.main, counts)
        return ('read', *(node.manifest.id for tree in document.trees.values() for node in tree.nodes()))

    def _run(self, library: TreeLibrary, main: str, counts: collections.Counter[str]) -> None:
        for shared in (False, True):
            for finding in findings(library, (), shared=shared):
                assert finding.place.line >= 1
        with contextlib.suppress(BehaviorTreeError):
            clock = ManualClock()
            tree = Tree(library, main, blackboard=Blackboard(), clock=clock, max_rounds=20)
            try:
                for _ in range(3):
                    if tree.tick_once() is not NodeStatus.RUNNING:
                        break
                    clock.advance(0.1)
            finally:
                tree.halt()
            counts['ticked'] += 1


# Inputs of an executive: commands that a real operator sends on its topics, and the journal of an earlier process.

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
    """A state that waits until an operator forces an outcome."""

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
    """Commands: each is answered, or ignored for a reason, and the executive continues."""

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
    """A journal, as raw text or with a number and a checksum on each line. Its contents are then queried."""

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
            journal = RunJournal(file, lambda _problem: None, ManualClock())
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
    """Return the lines that are JSON, in the format of a journal."""
    lines = [encode_head()]
    for raw in data.decode('utf-8', 'replace').splitlines():
        try:
            lines.append(encode_line(len(lines), json.loads(raw)))
        except (ValueError, TypeError, RecursionError):
            continue
    return b''.join(lines)


# The targets by name.

TARGETS: Final[Mapping[str, Callable[[], Target]]] = {
    'xml': XmlTarget,
    'yaml': YamlTarget,
    'script': ScriptTarget,
    'value': ValueTarget,
    'command': CommandTarget,
    'journal': JournalTarget,
}
"""Factories of the targets by name."""
