# SPDX-License-Identifier: BSD-3-Clause
"""What is loaded takes a bounded amount of memory: what was not used for the longest time is dropped, and told."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_msgs.action import BtExecute, BtLoad
from flexbt_msgs.msg import BtLoadReport
from flexbt_server.errors import UnknownTreeError
from flexbt_server.node_types import node_registry
from flexbt_server.trees.tree_memory import tree_size
from flexbt_server.trees.tree_store import FoundTree, TreeStore
from flexbt_testing.nodes.server_world import document, open_server_world
from flexbt_testing.waiting import DEADLINE

NODES = 1_300
"""Of a tree of some 0.8 MB, of which one fits into the least that may be allowed."""


def fail(point: str, error: Exception) -> None:
    raise error


@pytest.fixture(scope='module')
def registry() -> NodeRegistry:
    return node_registry(fail, 'jazzy')


@pytest.fixture
def store(registry: NodeRegistry, tmp_path: Path) -> TreeStore:
    """One that has room for three trees of so many nodes."""
    return TreeStore(registry, [tmp_path], 10_000_000, 256, 3_000_000)


def different(node: str, count: int = NODES) -> str:
    """Return nodes of different names: the reader keeps the attributes of equal ones once."""
    return ''.join(f'<{node} name="n{number}"/>' for number in range(count))


def large(tree: str, more: str = '') -> str:
    """Return a document with a tree of so many nodes."""
    return document(f'<Sequence>{more}{different("AlwaysSuccess")}</Sequence>', tree)


def load(store: TreeStore, xml: str) -> str:
    """Load a text, which has to be accepted; gives what is told."""
    (report,) = store.load([], xml)
    assert report.code == BtLoadReport.LOADED, report.errors
    return report.notice


def is_loaded(store: TreeStore, tree: str) -> bool:
    return store.library.find(tree) is not None


def test_the_least_recently_used_is_dropped_and_told(store: TreeStore) -> None:
    for tree in ('A', 'B', 'C'):
        assert load(store, large(tree)) == ''
    store.find('A')
    told = load(store, large('D'))
    assert told.endswith('the least recently used trees were dropped: B')
    assert [is_loaded(store, tree) for tree in 'ABCD'] == [True, False, True, True]
    with pytest.raises(UnknownTreeError, match=r"tree 'B' was dropped, as the least recently used one.*load it again"):
        store.find('B')
    load(store, large('B'))
    assert store.find('B').key.id == 'B'


def test_many_trees_are_no_more_than_three(store: TreeStore) -> None:
    for number in range(20):
        load(store, large(f'T{number}'))
    assert len(store.library.documents) == 3
    for number in range(17, 20):
        assert store.find(f'T{number}').key.id == f'T{number}'


def test_what_runs_stays(store: TreeStore) -> None:
    runs: list[FoundTree] = []
    for tree in ('A', 'B'):
        load(store, large(tree))
        runs.append(store.find(tree))
    for number in range(5):
        load(store, large(f'T{number}'))
    assert is_loaded(store, 'A') and is_loaded(store, 'B')
    runs.clear()
    for number in range(5):
        load(store, large(f'U{number}'))
    assert not is_loaded(store, 'A') and not is_loaded(store, 'B')


def test_what_the_server_was_configured_with_stays(store: TreeStore) -> None:
    load(store, large('Configured'))
    store.keep_loaded()
    for number in range(5):
        load(store, large(f'T{number}'))
    assert is_loaded(store, 'Configured')


def test_what_a_tree_is_made_of_stays_with_it(store: TreeStore) -> None:
    load(store, large('Part'))
    load(store, large('Whole', '<SubTree ID="Part"/>'))
    for number in range(5):
        store.find('Whole')
        load(store, large(f'T{number}'))
    assert is_loaded(store, 'Whole') and is_loaded(store, 'Part')
    load(store, large('U'))
    assert not is_loaded(store, 'Whole') and is_loaded(store, 'Part'), 'the whole first: it would be nothing without'


def test_a_file_that_was_dropped_is_loaded_again_by_its_name_and_by_that_of_its_tree(
    store: TreeStore, tmp_path: Path
) -> None:
    file = tmp_path / 'file.xml'
    file.write_text(large('FromFile'))
    for name in (str(file), 'FromFile'):
        assert store.find(str(file)).notice == '' or name == 'FromFile'
        for number in range(4):
            load(store, large(f'{name[:1]}{number}'.replace('/', 'x')))
        assert not is_loaded(store, 'FromFile')
        found = store.find(name)
        assert found.key.id == 'FromFile'
        assert 'least recently used trees were dropped' in found.notice
        del found  # it would be in use


@pytest.mark.parametrize('is_file', [True, False])
def test_a_tree_stays_that_is_asked_for_while_an_edit_of_its_parts_takes_room(
    store: TreeStore, tmp_path: Path, is_file: bool
) -> None:
    main, part = tmp_path / 'main.xml', tmp_path / 'part.xml'
    main.write_text(large('Main', '<SubTree ID="Part"/>'))
    part.write_text(document('<AlwaysSuccess/>', 'Part'))
    for file in (part, main):
        assert store.load([str(file)])[0].code == BtLoadReport.LOADED
    load(store, large('Other'))
    part.write_text(document(f'<Sequence>{different("AlwaysSuccess", 2 * NODES)}</Sequence>', 'Part'))
    found = store.find(str(main) if is_file else 'Main')
    assert (found.key.id, 'Part' in found.library.tree_ids()) == ('Main', True)
    assert [is_loaded(store, tree) for tree in ('Main', 'Part', 'Other')] == [True, True, False]
    assert found.notice.endswith('the least recently used trees were dropped: Other')


def test_what_can_have_no_room_is_refused_and_all_stays(store: TreeStore) -> None:
    load(store, large('A'))
    (report,) = store.load([], document(f'<Sequence>{different("Spin", 10 * NODES)}</Sequence>', 'TooLarge'))
    assert report.code == BtLoadReport.REFUSED
    assert '<xml>: the loaded trees would take 17 MB of memory; at most 3 MB are kept' in str(report.errors[0])
    assert is_loaded(store, 'A') and not is_loaded(store, 'TooLarge')


def test_a_run_keeps_only_what_it_is_made_of(store: TreeStore) -> None:
    for tree in ('A', 'B', 'C'):
        load(store, large(tree))
    assert list(store.find('B').library.tree_ids()) == ['B']


@pytest.mark.parametrize('node', [
    '<AlwaysSuccess/>', '<Wait/>', '<Spin/>', '<Wait wait_duration="1"/>', '<Inverter><AlwaysSuccess/></Inverter>',
    '<Wait _a="" _b="" _c=""/>', '<Script code="{};b:=2;c:=3;d:=4"/>', '<AlwaysSuccess _skipIf="{}" _post="{}"/>',
    '<AlwaysSuccess name="' + 'x' * 1000 + '"/>', '<AlwaysSuccess name="{}"/>',
])  # fmt: skip
def test_what_trees_take_is_known_about(registry: NodeRegistry, node: str) -> None:
    body = ''.join(node.replace('{}', f'a:={number}') for number in range(50_000 // len(node)))
    text = document(f'<Sequence>{body}</Sequence>')
    load_xml(document(node.replace('{}', 'a:=1')), 'before', registry)  # what is made once is there
    tracemalloc.start()
    try:
        known = load_xml(text, 'file', registry)
        taken, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    estimated = tree_size(known, len(text)).size
    assert 0.6 * taken < estimated < 2.5 * taken + 25_000, (taken, estimated)


def test_the_client_and_the_operator_are_told(capfd: pytest.CaptureFixture[str]) -> None:
    with open_server_world(max_loaded_memory=3_000_000) as world:
        for tree in ('A', 'B', 'C'):
            assert world.client.load(xml=large(tree)).message == ''
        result = world.client.load(xml=large('D'))
        assert result.code == BtLoad.Result.SUCCESS
        assert result.message.endswith('dropped: A')
        assert world.client.execute('D').result.code == BtExecute.Result.SUCCESS
        assert "tree 'A' was dropped" in world.client.execute('A').result.message
    assert 'trees were dropped: A' in capfd.readouterr().err


LIMITED = """
import resource
from pathlib import Path
from flexbt_testing.nodes.server_world import document, open_server_world

with open_server_world() as world:
    pages = int(Path('/proc/self/statm').read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 120_000_000, resource.RLIM_INFINITY))
    large = document('<Sequence>' + '<AlwaysSuccess/>' * 60_000 + '</Sequence>', 'Large')
    for _ in range(3):
        print(world.client.load(xml=large).message, flush=True)
    world.client.load_tree('<AlwaysSuccess/>', 'Small')
    print('continues', world.client.execute('Small').result.code, flush=True)
"""


def test_a_process_whose_address_space_is_limited_refuses_and_goes_on() -> None:
    done = subprocess.run(
        [sys.executable, '-c', LIMITED], capture_output=True, text=True, timeout=DEADLINE, check=False
    )
    *refusals, last = done.stdout.splitlines()
    assert last == f'continues {BtExecute.Result.SUCCESS}', done.stderr
    for line in refusals:
        assert 'nothing was loaded: <xml>: too little memory: to read it may take 1' in line
    assert len(refusals) == 3
    assert 'Traceback' not in done.stderr
