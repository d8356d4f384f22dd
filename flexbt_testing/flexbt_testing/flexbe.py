# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's tests of states and behaviors (``.test`` files, ``PyTester``), run on FlexBT's engine.

``python3 -m flexbt_testing.flexbe FILE.test ...`` runs files. The exit code is 1 if a test fails.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import re
import sys
import traceback
import unittest
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Final

import yaml
from ament_index_python.packages import get_package_share_directory

from flexbt_common.values.value_types import from_plain, resolve_type
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.operator_commands import confirm
from flexbt_core.state_machine.model.autonomy import DecisionKind
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_core.values.text import short_repr, truncate_middle
from flexbt_core.values.text_files import read_text
from flexbt_core.values.yaml_data import YamlError, compose_yaml, construct_yaml
from flexbt_flexbe import shim
from flexbt_flexbe.api.behavior import Behavior
from flexbt_flexbe.hosted_behavior import without_harmless_faults
from flexbt_onboard.behaviors.run_context import current_run
from flexbt_testing.nodes.state_bench import Run, StateBench

from .waiting import wait_until

_KEYS: Final = frozenset({'path', 'class', 'name', 'import_only', 'params', 'input', 'output', 'outcome'})
_NEEDS: Final = frozenset({'launch', 'data', 'wait_cond', 'require_launch_success'})
"""Test requirements that are not supported here."""

_SEQUENCE: Final = 'tag:yaml.org,2002:seq'
_MAPPING: Final = 'tag:yaml.org,2002:map'
_OBJECT: Final = 'tag:yaml.org,2002:python/object/new:'
_NO_WORD: Final = re.compile(r'\W')
_MESSAGE: Final = re.compile(r'(?P<package>\w+)\.msg\._\w+\.(?P<name>\w+)')


class StateTestError(FlexbtError):
    """A file of FlexBE's tests cannot be used."""


@dataclass(frozen=True)
class StateTest:
    """The content of a file: the class under test and the expectations. ``outcome`` is '' for ``import_only``."""

    file: Path
    module: str
    class_name: str
    import_only: bool
    parameters: Mapping[str, Any]
    inputs: Mapping[str, Any]
    outputs: Mapping[str, Any]
    outcome: str


def read_state_test(file: Path) -> StateTest:
    """Read a test.

    A text that begins with ``lambda`` is a function, ``None`` is None, and ``//x`` is the text ``/x``. The only Python
    objects are ROS messages, in the form in which PyYAML writes them.

    Raises:
        StateTestError: the file does not exist, is not YAML, has unknown keys, lacks a key, or
            needs something that is not supported here.
    """
    try:
        node = compose_yaml(read_text(file), aliases=True)
        content = {} if node is None else _plain(node)
    except (OSError, FlexbtError, ValueError) as error:
        raise StateTestError(f'{file}: {error}') from None
    if not isinstance(content, dict):
        raise StateTestError(f'{file}: a test is a mapping of {", ".join(sorted(_KEYS))}, not {short_repr(content)}')
    if needed := sorted(_NEEDS & content.keys()):
        raise StateTestError(
            f'{file}: {", ".join(needed)}: nodes and data that a test needs are not started here; '
            'write it in Python, with the action servers and publishers of flexbt_testing.nodes.state_bench'
        )
    if unknown := sorted(map(str, content.keys() - _KEYS)):
        raise StateTestError(f'{file}: unknown keys {", ".join(unknown)}; known are {", ".join(sorted(_KEYS))}')
    import_only = content.get('import_only', False) is True
    module, class_name = _subject(file, content)
    if 'outcome' not in content and not import_only:
        raise StateTestError(f'{file}: outcome is missing; name the one that is expected')
    values = {
        key: {name: _value(file, value) for name, value in _mapping(file, content, key).items()}
        for key in ('params', 'input', 'output')
    }
    outcome = str(content.get('outcome', ''))
    return StateTest(
        file, module, class_name, import_only, values['params'], values['input'], values['output'], outcome
    )


def _subject(file: Path, content: Mapping[str, Any]) -> tuple[str, str]:
    """Return module and class. The name of a behavior implies both, as in FlexBE's editor."""
    path = content.get('path')
    if not isinstance(path, str):
        raise StateTestError(f'{file}: path is missing; give the module of the class')
    if 'class' in content:
        return path, str(content['class'])
    if 'name' not in content:
        raise StateTestError(f'{file}: class is missing; give it, or the name of a behavior')
    name = str(content['name'])
    return f'{path}.{_NO_WORD.sub("_", name.lower())}_sm', f'{_NO_WORD.sub("", name)}SM'


def _mapping(file: Path, content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = content.get(key) or {}
    if not isinstance(value, dict) or not all(isinstance(name, str) for name in value):
        raise StateTestError(f'{file}: {key} has to be a mapping of names to values, not {short_repr(value)}')
    return value


def _value(file: Path, value: Any) -> Any:
    if not isinstance(value, str):
        return value
    if value == 'None':
        return None
    if value.startswith('//'):
        return value[1:]
    return _function(file, value) if value.startswith('lambda ') else value


def _function(file: Path, text: str) -> Any:
    """Return a function written in a test. Its author also wrote the code under test."""
    try:
        tree = ast.parse(text, mode='eval')
    except SyntaxError as error:
        raise StateTestError(f'{file}: {short_repr(text)} is not a function: {error.msg}') from None
    if not isinstance(tree.body, ast.Lambda):
        raise StateTestError(f'{file}: {short_repr(text)} is not a function')
    return eval(compile(tree, str(file), 'eval'), {})  # noqa: S307


def _plain(node: yaml.Node) -> Any:
    """Return plain data, with the messages in it."""
    if node.tag.startswith(_OBJECT):
        found = _MESSAGE.fullmatch(node.tag.removeprefix(_OBJECT))
        if found is None:
            raise YamlError(node.start_mark, f'{node.tag.removeprefix(_OBJECT)} is not a ROS message; no other is made')
        return from_plain(_fields(node), resolve_type(f'{found["package"]}/msg/{found["name"]}'))
    if isinstance(node, yaml.SequenceNode) and node.tag == _SEQUENCE:
        return [_plain(item) for item in node.value]
    if isinstance(node, yaml.MappingNode) and node.tag == _MAPPING:
        return {key: _plain(value) for key, value in _entries(node).items()}
    return construct_yaml(node)


def _fields(node: yaml.Node) -> Any:
    """Return a message's fields as plain data: the second item of its state, with underscores before the names."""
    if isinstance(node, yaml.SequenceNode):
        return [_fields(item) for item in node.value]
    if not isinstance(node, yaml.MappingNode):
        return construct_yaml(node)
    entries = _entries(node)
    if node.tag.startswith(_OBJECT):
        state = entries.get('state')
        if not isinstance(state, yaml.SequenceNode) or len(state.value) != 2:
            raise YamlError(node.start_mark, 'a message has a state: None, and a mapping of its fields')
        return _fields(state.value[1])
    return {str(key).removeprefix('_'): _fields(value) for key, value in entries.items() if key != '_check_fields'}


def _entries(node: yaml.MappingNode) -> dict[Any, yaml.Node]:
    entries: dict[Any, yaml.Node] = {}
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise YamlError(key.start_mark, 'a key has to be a name')
        name = construct_yaml(key)
        if name in entries:
            raise YamlError(key.start_mark, f'{name!r} is there twice')
        entries[name] = value
    return entries


# Run a FlexBE test of a state or behavior on the engine of FlexBT.

SECONDS: Final = 10.0
"""Maximum duration of a test run, s."""


def run_state_test(test: StateTest, bench: StateBench, seconds: float = SECONDS) -> list[str]:
    """Run a test and return its failures, none if it passes.

    A state runs in a separate machine. A behavior runs unsupervised, as in FlexBE: all transitions pass, whatever
    autonomy they require.
    """
    try:
        subject = _load(test)
    except StateTestError as error:
        return [str(error)]
    if test.import_only:
        return []
    run = bench.run(partial(_machine, test, subject))
    try:
        wait_until(lambda: _has_ended(run), 'it gave no outcome', seconds)
    except AssertionError as error:
        run.stop()
        return [str(error), *run.errors().splitlines()]
    if run.refusal is not None:
        return [run.refusal]
    problems = []
    if run.outcome != test.outcome:
        why = [text for text in (run.message, run.errors()) if text]
        problems.append(f'its outcome is {run.outcome!r}, not {test.outcome!r}' + ''.join(f'; {text}' for text in why))
    given = run.outputs
    for key, expected in test.outputs.items():
        if key not in given:
            problems.append(f'it has not written {key!r}')
        elif given[key] != expected:
            problems.append(
                f'{key!r} is {truncate_middle(repr(given[key]), 200)}, not {truncate_middle(repr(expected), 200)}'
            )
    return problems


def _load(test: StateTest) -> type[Any]:
    """Return the class under test.

    Raises:
        StateTestError: it cannot be imported, or is neither state nor behavior.
    """
    where = f'class {test.class_name} of {test.module}'
    try:
        shim.install()
        found = getattr(importlib.import_module(test.module), test.class_name, None)
    except (Exception, SystemExit) as error:  # foreign code may raise anything when it is imported
        raise StateTestError(f'{where} cannot be imported: {"".join(traceback.format_exception_only(error))}') from None
    if not (isinstance(found, type) and issubclass(found, EventState | Behavior)):
        raise StateTestError(f'{where} is neither an EventState nor a Behavior, but {short_repr(found)}')
    return found


def _machine(test: StateTest, subject: type[Any]) -> OperatableStateMachine:
    """Return the machine to run for a test. Call it on the thread of the run."""
    if issubclass(subject, EventState):
        state = subject(**test.parameters)
        machine = OperatableStateMachine(outcomes=list(state.outcomes))
        with machine:
            OperatableStateMachine.add('State', state, {outcome: outcome for outcome in state.outcomes})
    else:
        machine = _machine_of_behavior(test, subject)
    for key, value in test.inputs.items():
        machine.userdata[key] = value
    machine.output_keys = tuple(dict.fromkeys((*machine.output_keys, *test.outputs)))
    return machine


def _machine_of_behavior(test: StateTest, subject: type[Any]) -> OperatableStateMachine:
    run = current_run()
    behavior = subject(node=run.services.runtime.node)
    for name, value in test.parameters.items():
        if not behavior.set_parameter(name, value):
            raise StateTestError(f'the behavior has no parameter {name!r}')
    machine = behavior.create()
    if not isinstance(machine, OperatableStateMachine):
        raise StateTestError(f'create() gave {short_repr(machine)}, which is not a state machine')
    without_harmless_faults(machine, partial(run.log, Severity.WARN, ''))
    return machine


def _has_ended(run: Run) -> bool:
    for decision in run.decisions():
        if decision.kind is DecisionKind.TRANSITION:
            run.behavior_run.command(None, confirm, run.behavior_run.decision_number(decision.id))
    return run.outcome is not None or run.refusal is not None


# FlexBE's base class of test cases that run ``.test`` files of a package.


class PyTester(unittest.TestCase):
    """A case runs ``.test`` files: derive from it, and call :meth:`run_test`.

    Name the package, and the folder of the files in its share::

        class TestStates(PyTester):
            @classmethod
            def setUpClass(cls):
                PyTester._package = 'my_flexbe_states'
                PyTester._tests_folder = 'tests'
                super().setUpClass()

            def test_wait(self):
                self.run_test('wait')
    """

    _package: ClassVar[str | None] = None
    _tests_folder: ClassVar[str | None] = None
    _file_path: ClassVar[str | None] = None

    @classmethod
    def setUpClass(cls) -> None:
        """Find the folder.

        Raises:
            StateTestError: package and folder were not named before.
        """
        super().setUpClass()
        if PyTester._package is None or PyTester._tests_folder is None:
            raise StateTestError(
                f'{cls.__name__}: set PyTester._package and PyTester._tests_folder in setUpClass(), '
                'before it calls that of its base'
            )
        PyTester._file_path = str(Path(get_package_share_directory(PyTester._package), PyTester._tests_folder))

    def setUp(self) -> None:
        """Make a node."""
        self._bench = StateBench()
        self.addCleanup(self._bench.close)
        self.node: Any = self._bench.runtime.node

    def run_test(self, test_name: str, timeout_sec: float | None = None, max_cnt: int | None = 50) -> None:
        """Run ``test_name.test`` within a time limit. ``max_cnt``, FlexBE's limit on ticks, has no effect."""
        assert PyTester._file_path is not None
        try:
            test = read_state_test(Path(PyTester._file_path, f'{test_name}.test'))
        except StateTestError as error:
            self.fail(str(error))
        problems = run_state_test(test, self._bench, SECONDS if timeout_sec is None else timeout_sec)
        self.assertEqual(problems, [], f'{test.file} failed')


# Run files with FlexBE tests: ``python3 -m flexbt_testing.flexbe FILE.test ...``.


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Run FlexBE's tests of states and behaviors.")
    parser.add_argument('files', nargs='+', type=Path, metavar='FILE.test')
    parser.add_argument('--timeout', type=float, default=SECONDS, help='seconds for each (default %(default)g)')
    given = parser.parse_args(arguments)
    failed = 0
    for file in given.files:
        try:
            with StateBench() as bench:
                problems = run_state_test(read_state_test(file), bench, given.timeout)
        except StateTestError as error:
            problems = [str(error).removeprefix(f'{file}: ')]
        failed += bool(problems)
        print(f'{"FAILED" if problems else "passed"}  {file}')
        for problem in problems:
            print('\n'.join(f'        {line}' for line in problem.splitlines()))
    print(f'{len(given.files) - failed} of {len(given.files)} passed')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
