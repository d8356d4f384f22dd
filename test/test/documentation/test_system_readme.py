# SPDX-License-Identifier: BSD-3-Clause
"""The examples of the README, taken literally from its text: a tree, a state and a mission."""

import html
import os
import re
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from geometry_msgs.msg import PoseStamped

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import to_entry
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.definition import Child
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus, PendingDecision
from flexbt_testing.state_machines.bench import Bench
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack

ROOT = Path(__file__).parents[3]
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def example(heading: str, language: str) -> str:
    """Return the first block of a language in a section."""
    section = README[README.index(f'## {heading}\n') :]
    found = re.search(rf'^```{language}\n(.*?)^```$', section, re.MULTILINE | re.DOTALL)
    assert found is not None, f'{heading}: no {language}'
    return found[1]


def test_the_examples_are_short() -> None:
    for heading, language in (('A tree', 'xml'), ('A state', 'python'), ('A mission', 'python')):
        lines = [line for line in example(heading, language).splitlines() if line and not line.startswith('from ')]
        assert len(lines) <= 12, heading


def test_the_tree_recovers_without_a_robot(tmp_path: Path) -> None:
    """In a shell that knows of the workspace what the README says, and no more."""
    (tmp_path / 'deliver.xml').write_text(example('A tree', 'xml'), encoding='utf-8')
    sourced = re.search(r'Run `(.*?)` in a shell to use the commands below', README)
    assert sourced is not None
    script = f'{sourced[1]} && cd {shlex.quote(str(tmp_path))} && {example("A tree", "sh")}'
    environment = dict(os.environ)
    for name in ('PATH', 'PYTHONPATH'):
        places = environment.get(name, '').split(os.pathsep)
        environment[name] = os.pathsep.join(place for place in places if not Path(place).is_relative_to(ROOT))
    command = ['bash', '-c', script]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert re.search(r'IDLE +-> SUCCESS +BackUp', done.stdout)
    assert done.stdout.splitlines()[-1].startswith('SUCCESS')


def test_in_the_picture_of_the_screen_no_sign_depends_on_what_fonts_a_reader_has() -> None:
    """What is beyond ASCII may be wider in another font: it stands alone, at its cell; braille is drawn."""
    picture = (ROOT / 'docs' / 'images' / 'operator_screen.svg').read_text(encoding='utf-8')
    texts = re.findall(r'<text class="operator-r[^>]*>([^<]*)</text>', picture)
    assert len(texts) > 50 and 'd="M' in picture
    for text in map(html.unescape, texts):
        assert len(text) == 1 or re.fullmatch(r'[ -~\xa0]+', text), text
        assert not re.search(r'[\u2800-\u28ff]', text), text


def test_the_state_counts() -> None:
    names: dict[str, Any] = {}
    exec(example('A state', 'python'), names)  # noqa: S102 the text of this repository
    count = Child('Count', names['CountState'](3), {'more': 'Count', 'enough': 'finished'})
    bench = Bench(OperatableStateMachine(['finished'], children=[count], userdata={'count': 0}))
    assert bench.outcome == 'finished'
    assert [(path, outcome) for path, outcome, *_ in bench.transitions] == [('/Count', 'more')] * 2 + [
        ('/Count', 'enough')
    ]


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """Return the environment in which the package of the examples is installed."""
    package = tmp_path / 'deliveries'
    share = tmp_path / 'share' / 'deliveries'
    about = tmp_path / 'deliveries-1.0.dist-info'
    index = tmp_path / 'share' / 'ament_index' / 'resource_index' / 'packages'
    for directory in (package, share / 'trees', about, index):
        directory.mkdir(parents=True)
    (package / '__init__.py').touch()
    (index / 'deliveries').touch()
    (package / 'count_state.py').write_text(example('A state', 'python'), encoding='utf-8')
    (package / 'mission.py').write_text(example('A mission', 'python'), encoding='utf-8')
    (share / 'trees' / 'deliver.xml').write_text(example('A tree', 'xml'), encoding='utf-8')
    (about / 'METADATA').write_text('Metadata-Version: 2.1\nName: deliveries\nVersion: 1.0\n', encoding='utf-8')
    (about / 'entry_points.txt').write_text('[flexbt.behaviors]\ndeliveries = deliveries.mission:Deliveries\n')
    before = {name: os.environ.get(name, '') for name in ('PYTHONPATH', 'AMENT_PREFIX_PATH')}
    return {name: os.pathsep.join([str(tmp_path), value]) for name, value in before.items()}


@pytest.fixture
def probe() -> Iterator[Probe]:
    with NodeRuntime.open('operator') as runtime:
        yield Probe(runtime)


def test_the_mission_is_driven(installed: dict[str, str], probe: Probe, tmp_path: Path) -> None:
    def decision(kind: int) -> PendingDecision | None:
        decisions = probe.status.decisions
        return next((one for one in decisions if one.kind == kind), None)

    with Stack(tmp_path) as stack:
        stack.start('simulation', {'speed_factor': '5.0'})
        stack.start('stop_guard')
        for name in ('bt_server', 'onboard_executive'):
            stack.start(name, environment=installed)
        probe.wait_ready()
        probe.send(ExecutiveCommand.START, behavior='Deliveries', autonomy=2)
        for x, y in ((3.8, 1.2), (0.8, 4.45)):
            asked = probe.wait(lambda: decision(PendingDecision.INPUT), 'the decision about a goal')
            assert asked is not None and asked.prompt == 'Where to?'
            goal = PoseStamped()
            goal.header.frame_id = 'map'
            goal.pose.position.x, goal.pose.position.y, goal.pose.orientation.w = x, y, 1.0
            probe.send(ExecutiveCommand.ANSWER, decision_id=asked.id, inputs=[to_entry('goal', goal)])
            arrival = probe.wait(lambda: decision(PendingDecision.TRANSITION), 'the decision whether it counts')
            assert arrival is not None and (arrival.path, arrival.outcome) == ('/Drive', 'done')
            probe.send(ExecutiveCommand.CONFIRM, decision_id=arrival.id)
            probe.wait(lambda: decision(PendingDecision.TRANSITION) is None, 'the confirmation')
        probe.wait_state(ExecutiveStatus.IDLE)
        assert probe.status.outcome == 'finished'
