# SPDX-License-Identifier: BSD-3-Clause
"""Bad XML at the door of a real BT server: refused within a second, with file, line and reason; the rest goes on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_msgs.msg import BtLoadReport
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack
from flexbt_testing.waiting import uncontended_time

REFUSED_WITHIN = 1.0

GOOD = '<root BTCPP_format="4"><BehaviorTree ID="Good"><AlwaysSuccess/></BehaviorTree></root>'


def tree(body: str) -> str:
    return f'<root BTCPP_format="4">\n  <BehaviorTree ID="Bad">\n    {body}\n  </BehaviorTree>\n</root>\n'


HOSTILE = {
    'malformed': (tree('<Sequence><AlwaysSuccess></Sequence>'), 'AlwaysSuccess'),
    'truncated': (tree('<Sequence>')[:60], ''),
    'entity_bomb': (
        '<!DOCTYPE lol [<!ENTITY a "lol"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>\n'
        + tree('<AlwaysSuccess name="&b;"/>'),
        '',
    ),
    'external_entity': ('<!DOCTYPE x SYSTEM "file:///etc/passwd">\n' + tree('<AlwaysSuccess/>'), ''),
    'deep': (tree('<Inverter>' * 300 + '<AlwaysSuccess/>' + '</Inverter>' * 300), ''),
    'large': (tree('<Sequence>' + '<AlwaysSuccess/>\n' * 600_000 + '</Sequence>'), ''),
    'unknown_node': (tree('<AlwaysSucces/>'), 'AlwaysSuccess'),
    'missing_port': (tree('<Repeat><AlwaysSuccess/></Repeat>'), 'num_cycles'),
    'recursive': (tree('<SubTree ID="Bad"/>'), 'recurs'),
    'no_tree': ('<root BTCPP_format="4"/>', ''),
    'not_xml': ('behaviour: tree', ''),
    'not_utf8': ('', ''),
}


@pytest.fixture(scope='module')
def allowed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp('allowed')
    for name, (text, _) in HOSTILE.items():
        content = b'<root>\xff\xfe</root>' if name == 'not_utf8' else text.encode()
        (directory / f'{name}.xml').write_bytes(content)
    return directory


@pytest.fixture(scope='module')
def probe(tmp_path_factory: pytest.TempPathFactory, allowed: Path) -> Iterator[Probe]:
    with Stack(tmp_path_factory.mktemp('logs')) as stack, NodeRuntime.open('probe') as runtime:
        stack.start('bt_server', {'use_sim_time': 'false', 'allowed_directories': f"['{allowed}']"})
        probe = Probe(runtime)
        loaded = probe.call(BtLoad, 'bt_loader', BtLoad.Goal(xml=GOOD))
        assert loaded.result is not None
        assert loaded.result.code == BtLoad.Result.SUCCESS
        yield probe


def still_works(probe: Probe) -> None:
    outcome = probe.call(BtExecute, 'bt_executor', BtExecute.Goal(behavior_tree='Good'))
    assert outcome.result is not None
    assert outcome.result.code == BtExecute.Result.SUCCESS


@pytest.mark.parametrize('name', sorted(HOSTILE))
def test_hostile_xml_is_refused_in_time_with_its_reason(name: str, probe: Probe, allowed: Path) -> None:
    file = str(allowed / f'{name}.xml')
    began = uncontended_time()
    outcome = probe.call(BtLoad, 'bt_loader', BtLoad.Goal(files=[file]))
    assert uncontended_time() - began < REFUSED_WITHIN
    assert outcome.result is not None
    assert outcome.result.code == BtLoad.Result.FAILURE
    (report,) = outcome.result.reports
    assert report.code == BtLoadReport.REFUSED
    first = report.errors[0]
    assert first.file == file
    assert first.line >= 1
    assert first.message
    assert HOSTILE[name][1] in ' '.join(f'{error.node} {error.message}' for error in report.errors)
    still_works(probe)


def test_all_or_nothing(probe: Probe, allowed: Path) -> None:
    (allowed / 'fine.xml').write_text(GOOD.replace('"Good"', '"Fine"'))
    files = [str(allowed / 'fine.xml'), str(allowed / 'unknown_node.xml')]
    outcome = probe.call(BtLoad, 'bt_loader', BtLoad.Goal(files=files))
    assert outcome.result is not None
    assert [report.code for report in outcome.result.reports] == [BtLoadReport.VALID, BtLoadReport.REFUSED]
    run = probe.call(BtExecute, 'bt_executor', BtExecute.Goal(behavior_tree='Fine'))
    assert run.result is not None
    assert run.result.code == BtExecute.Result.ERROR
    assert "'Fine'" in run.result.message
    still_works(probe)


@pytest.mark.parametrize(
    ('file', 'reason'),
    [
        ('/etc/passwd', 'outside the allowed directories'),
        ('flexbt_demo_behaviors/../../../../../../etc/passwd', '..'),
        ('flexbt_demo_behaviors/navigate/missing.xml', 'no such file'),
        ('no_such_package/tree.xml', 'no installed package'),
    ],
)
def test_files_out_of_bounds_are_refused(file: str, reason: str, probe: Probe) -> None:
    outcome = probe.call(BtLoad, 'bt_loader', BtLoad.Goal(files=[file]))
    assert outcome.result is not None
    assert outcome.result.code == BtLoad.Result.FAILURE
    assert reason in outcome.result.reports[0].errors[0].message
    still_works(probe)
