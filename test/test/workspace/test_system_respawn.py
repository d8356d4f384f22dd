# SPDX-License-Identifier: BSD-3-Clause
"""What a launch file or a demonstration starts is started again when it dies, but not for ever; a script tells it."""

from __future__ import annotations

import importlib.util
import re
import runpy
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from flexbt_demo_behaviors.demonstration.demo_processes import DemoSettings, Process, demo_processes
from flexbt_demo_behaviors.demonstration.process_group import EndedProcess, ProcessGroup
from flexbt_demo_behaviors.demonstration.report import DemoError, Timeline
from flexbt_demo_behaviors.demonstration.running import RunOptions, open_session
from flexbt_demo_behaviors.goals import main as goals
from flexbt_demo_behaviors.nav2_robot import main as nav2_robot
from flexbt_demo_behaviors.nav2_robot.main import PROGRAM
from flexbt_demo_behaviors.night_watch.watch import open_watch

LAUNCH_FILES = sorted(Path(__file__).parents[3].glob('flexbt_*/launch/*.launch.py'))
EXECUTABLES = Path(__file__).parents[3] / 'docs' / 'reference' / 'executables.md'


class Described:
    """Notes what a launch file gives to one of the classes of `launch`, which no wheel has."""

    def __init__(self, *given: Any, **options: Any) -> None:
        self.given, self.options = given, options

    def perform(self, context: Mapping[str, str]) -> str:
        """Return the value of an argument of the launch file."""
        return context[self.given[0]]


class Argument(Described):
    """An argument of a launch file."""


class Function(Described):
    """Gives actions for the arguments."""


class Node(Described):
    """A node that is to be started."""


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Provide what launch files import, whether there is an installation or not."""
    contents: Mapping[str, Mapping[str, type]] = {
        'launch': {'LaunchContext': dict, 'LaunchDescription': Described},
        'launch.actions': {'DeclareLaunchArgument': Argument, 'OpaqueFunction': Function},
        'launch.substitutions': {'LaunchConfiguration': Described},
        'launch_ros': {},
        'launch_ros.actions': {'Node': Node},
    }
    for name, classes in contents.items():
        module = ModuleType(name)
        vars(module).update(classes)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.find_spec('flexbt_demo_behaviors.demonstration.launching')
    assert spec is not None and spec.loader is not None
    launching = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, launching)
    spec.loader.exec_module(launching)


def nodes_of(file: Path) -> list[Node]:
    """Return the nodes that a launch file starts when it is given no arguments."""
    (actions,) = runpy.run_path(str(file))['generate_launch_description']().given
    context = {action.given[0]: action.options['default_value'] for action in actions if isinstance(action, Argument)}
    nodes = [action for action in actions if isinstance(action, Node)]
    for action in actions:
        if isinstance(action, Function):
            nodes += action.options['function'](context)
    return nodes


@pytest.mark.usefixtures('launch')
@pytest.mark.parametrize('file', LAUNCH_FILES, ids=lambda file: file.name)
def test_a_launch_file_gives_a_node_only_parameters_that_it_has(file: Path) -> None:
    _, *sections = re.split(r'(?m)^\*\*`(\w+)`\*\*', EXECUTABLES.read_text(encoding='utf-8'))
    texts = dict(zip(sections[::2], sections[1::2], strict=True))
    known = {
        name: {
            'use_sim_time',
            *re.findall(r'(?m)^- `([\w.]+)`', text),
            *re.findall(r'`([\w.]+)`', ' '.join(re.findall(r'(?m)^As for .*', text))),
        }
        for name, text in texts.items()
    }
    known['simulation'] |= known['simulator'] | known['navigation']  # it has their nodes
    for name in ('bt_server', 'onboard_executive'):
        known[name].add('autostart')
    for node in nodes_of(file):
        name = node.options['executable']
        for parameters in filter(lambda given: isinstance(given, dict), node.options.get('parameters', [])):
            assert set(parameters) <= known.get(name, set(parameters)), name


@pytest.mark.usefixtures('launch')
@pytest.mark.parametrize('file', LAUNCH_FILES, ids=lambda file: file.name)
def test_every_node_of_a_launch_file_is_there_and_is_started_again_but_the_program_that_ends(file: Path) -> None:
    nodes = nodes_of(file)
    assert len(nodes) >= (1 if file.name == 'operator.launch.py' else 3)
    for node in nodes:
        process = Process(node.options['package'], node.options['executable'])
        assert Path(process.command()[0]).is_file()
        limits = node.options.get('respawn_delay', 0.0) > 0.0 and node.options.get('respawn_max_retries', -1) > 0
        is_program = (process.package, process.executable) == (PROGRAM.package, PROGRAM.executable)
        assert (node.options.get('respawn', False), limits) == (not is_program, not is_program), process


@dataclass
class Dying(ProcessGroup):
    """Starts nothing, notes what should be started again, and tells that the first has died."""

    started: dict[str, bool] = field(default_factory=dict)

    def start(
        self, name: str, command: Sequence[str], environment: Mapping[str, str] | None = None, respawn: bool = False
    ) -> None:
        self.started[name] = respawn

    def watch(self, listener: Callable[[EndedProcess], None]) -> None:
        name, respawn = next(iter(self.started.items()))
        listener(EndedProcess(name, -9, self.log_directory / f'{name}.log', respawn))


def begin_demonstration(group: ProcessGroup, options: RunOptions) -> None:
    with open_session(group, demo_processes(DemoSettings()), 'script', Timeline()):
        pass


def begin_watch(group: ProcessGroup, options: RunOptions) -> None:
    with open_watch(group, 1.0, Timeline()):
        pass


@pytest.mark.parametrize(
    ('begin', 'count'),
    [
        (begin_demonstration, 5),
        (begin_watch, 9),
        (lambda group, options: nav2_robot._run(options, group, Timeline()), 4),
        (lambda group, options: goals._run(options, group, Timeline()), 4),
    ],
    ids=['demo', 'night_watch', 'nav2_robot', 'goals'],
)
def test_each_process_of_a_demonstration_is_started_again_and_its_script_tells_that_it_has_died(
    begin: Callable[[ProcessGroup, RunOptions], None], count: int, tmp_path: Path
) -> None:
    group = Dying(tmp_path)
    with group, pytest.raises(DemoError, match=r'process \w+ ended with signal 9; it is started'):
        begin(group, RunOptions(interactive=False, speed=1.0, output=tmp_path))
    assert list(group.started.values()) == [True] * count
