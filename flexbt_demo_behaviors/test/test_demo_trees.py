# SPDX-License-Identifier: BSD-3-Clause
"""The trees of the demonstrations load with the node types that the BT server has."""

from pathlib import Path

import pytest

from flexbt_core import TreeLibrary, load_xml
from flexbt_server.node_types import node_registry

PACKAGE = Path(__file__).parents[1] / 'flexbt_demo_behaviors'
FILES = sorted([*(PACKAGE / 'navigate').glob('*.xml'), *(PACKAGE / 'inspection').glob('*.xml')])


def fail_on_broken(point: str, error: Exception) -> None:
    raise AssertionError(f'{point}: {error}')


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.name)
def test_a_tree_loads_and_says_which_one_is_meant(file: Path) -> None:
    document = load_xml(file.read_bytes(), file.name, node_registry(fail_on_broken))
    assert document.main in document.trees


def test_all_trees_live_in_one_library_under_names_of_their_own() -> None:
    registry = node_registry(fail_on_broken)
    library = TreeLibrary().stage([load_xml(file.read_bytes(), file.name, registry) for file in FILES])
    assert set(library.tree_ids()) == {'Navigate', 'GlobalPlanner', 'Controller', 'Recovery', 'Inspection'}
