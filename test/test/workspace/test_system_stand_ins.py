# SPDX-License-Identifier: BSD-3-Clause
"""The stand-ins in underlay/ are what ROS 2 Jazzy has under these names, and are built only where it is missing.

`jazzy_interfaces.txt` tells of each interface the type hash (RIHS01 of REP 2016), by which two nodes see whether theirs
is the same, and in the order of the definition its constants and defaults, which the hash leaves out.
"""

import importlib
import json
import re
from pathlib import Path

import pytest
from ament_index_python.packages import get_package_share_directory

ROOT = Path(__file__).parents[3]
UNDERLAY = ROOT / 'underlay'
VALUE = re.compile(r'^[^\s#]+[ \t]+(\w+)(?:[ \t]*=[ \t]*|[ \t]+)([^\s#]+)', re.MULTILINE)
"""A line of a definition: a type, a name, and the value of a constant or the default of a field."""


def recorded() -> dict[str, tuple[str, list[str]]]:
    """Hash, constants and defaults of each interface."""
    lines = Path(__file__).with_name('jazzy_interfaces.txt').read_text(encoding='utf-8').splitlines()
    rows = [line.split() for line in lines if not line.startswith('#')]
    return {name: (type_hash, values) for name, type_hash, *values in rows}


RECORDED = recorded()
DEFINITIONS = {
    str(file.relative_to(UNDERLAY).with_suffix('')): file
    for kind in ('msg', 'srv', 'action')
    for file in UNDERLAY.glob(f'*/{kind}/*.{kind}')
}


def test_all_interfaces_are_there() -> None:
    assert set(DEFINITIONS) == set(RECORDED)


@pytest.mark.parametrize('name', RECORDED)
def test_constants_and_defaults(name: str) -> None:
    values = VALUE.findall(DEFINITIONS[name].read_text(encoding='utf-8'))
    assert [f'{word}={value}' for word, value in values] == RECORDED[name][1]


@pytest.mark.parametrize('name', RECORDED)
def test_type_hashes(name: str) -> None:
    package, _, interface = name.partition('/')
    share = Path(get_package_share_directory(package))
    if not share.is_relative_to(ROOT):
        pytest.skip(f'{package} is that of the ROS installation')
    hashes = json.loads((share / f'{interface}.json').read_text(encoding='utf-8'))['type_hashes']
    assert {entry['type_name']: entry['hash_string'] for entry in hashes}[name] == RECORDED[name][0]


def test_only_what_is_missing_is_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / 'tools')
    workspace = importlib.import_module('workspace.layout').Layout(ROOT)
    for package in ('nav_msgs', 'simulation_interfaces', 'tf2_msgs'):
        (tmp_path / 'share' / package).mkdir(parents=True)
        (tmp_path / 'share' / package / 'package.xml').touch()
    stand_ins = workspace.stand_ins([ROOT / 'nowhere', tmp_path])
    assert [package.name for package in stand_ins] == ['geographic_msgs', 'nav2_msgs']
    assert [package.path.parent for package in stand_ins] == [UNDERLAY, UNDERLAY]
    assert (UNDERLAY / 'COLCON_IGNORE').exists()
    assert not {'geographic_msgs', 'nav2_msgs', 'simulation_interfaces', 'tf2_msgs'} & {
        package.name for package in workspace.packages()
    }
