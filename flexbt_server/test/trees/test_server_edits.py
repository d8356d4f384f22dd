# SPDX-License-Identifier: BSD-3-Clause
"""Files that are edited: taken over by the next run, whatever part of the tree they are; not when they are broken."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_msgs.action import BtExecute
from flexbt_msgs.msg import BtLoadReport
from flexbt_server.errors import UnknownTreeError
from flexbt_server.trees.tree_store import FoundTree, TreeStore
from flexbt_testing.nodes.server_world import document, open_server_world

BROKEN = '<root BTCPP_format="4"><BehaviorTree ID="X"><Nowhere/></BehaviorTree></root>'


def leaf(version: object, tree: str = 'Main') -> str:
    return document(f'<AlwaysSuccess name="{version}"/>', tree)


def including(*files: str, body: str = '<SubTree ID="Inner"/>', tree: str = 'Main') -> str:
    includes = ''.join(f'<include path="{file}"/>' for file in files)
    return document(body, tree).replace('<BehaviorTree', f'{includes}<BehaviorTree', 1)


def names_in(library: TreeLibrary, key: TreeKey) -> list[str]:
    """Name of the leaves of a tree, sub-trees resolved."""
    names = []
    for node in library.definition(key).nodes():
        if node.tree_id is not None:
            target = library.find(node.tree_id, key.file)
            assert target is not None
            names += names_in(library, target)
        elif not node.children:
            names.append(node.name)
    return names


class Files:
    """A directory, a store that reads from it, and the number of files that it has read."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.store = TreeStore(builtin_registry(), [directory], 1_000_000, 100)
        self.reads = 0
        read = self.store._files.read

        def counted(name: str) -> object:
            self.reads += 1
            return read(name)

        self.store._files.read = counted  # type: ignore[method-assign, assignment]

    def path(self, name: str) -> str:
        return str(self.directory / name)

    def write(self, name: str, text: str) -> str:
        path = self.directory / name
        path.parent.mkdir(exist_ok=True)
        before = path.stat().st_ctime_ns if path.exists() else 0
        path.write_text(text)
        while path.stat().st_ctime_ns == before:  # the clock of the file system may be coarse
            path.write_text(text)
        return str(path)

    def find(self, name: str) -> FoundTree:
        return self.store.find(name if '.' not in name else self.path(name))

    def leaves(self, name: str) -> list[str]:
        found = self.find(name)
        assert found.notice == ''
        return names_in(found.library, found.key)


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def test_an_included_file_that_has_changed_is_taken_over(files: Files) -> None:
    files.write('main.xml', including('parts/outer.xml'))
    files.write('parts/outer.xml', including('inner.xml', body='<AlwaysSuccess/>', tree='Outer'))
    files.write('parts/inner.xml', leaf('old', 'Inner'))
    assert files.leaves('main.xml') == ['old']
    files.write('parts/inner.xml', leaf('new', 'Inner'))
    assert files.leaves('main.xml') == ['new']
    assert files.leaves('Main') == ['new']


def test_a_load_sees_that_an_included_file_has_changed(files: Files) -> None:
    main = files.write('main.xml', including('inner.xml'))
    files.write('inner.xml', leaf('old', 'Inner'))
    assert files.store.load([main])[0].code == BtLoadReport.LOADED
    assert files.store.load([main])[0].code == BtLoadReport.UNCHANGED
    files.write('inner.xml', leaf('new', 'Inner'))
    assert files.store.load([main])[0].code == BtLoadReport.LOADED
    files.write('inner.xml', BROKEN)
    assert files.store.load([main])[0].code == BtLoadReport.REFUSED
    Path(files.path('inner.xml')).unlink()
    assert files.store.load([main])[0].code == BtLoadReport.REFUSED


def test_the_file_of_a_sub_tree_that_has_changed_is_taken_over(files: Files) -> None:
    inner = files.write('inner.xml', leaf('old', 'Inner'))
    other = files.write('other.xml', leaf('other', 'Other'))
    assert {report.code for report in files.store.load([inner, other])} == {BtLoadReport.LOADED}
    files.store.load([], document('<SubTree ID="Inner"/>', 'Text'))
    files.write('inner.xml', leaf('new', 'Inner'))
    files.write('other.xml', BROKEN)  # which is no part of the tree
    assert files.leaves('Text') == ['new']


def test_a_file_that_an_xml_text_includes_is_taken_over(files: Files) -> None:
    inner = files.write('inner.xml', leaf('old', 'Inner'))
    assert files.store.load([], including(inner))[0].code == BtLoadReport.LOADED
    assert files.leaves('Main') == ['old']
    files.write('inner.xml', leaf('new', 'Inner'))
    assert files.leaves('Main') == ['new']


@pytest.mark.parametrize('broken', [BROKEN, '<root', '', None])
@pytest.mark.parametrize('which', ['main.xml', 'inner.xml'])
def test_a_broken_edit_keeps_what_was_good_and_is_told(files: Files, which: str, broken: str | None) -> None:
    texts = {'main.xml': including('inner.xml'), 'inner.xml': leaf('good', 'Inner')}
    for name, text in texts.items():
        files.write(name, text)
    assert files.leaves('main.xml') == ['good']
    if broken is None:
        Path(files.path(which)).unlink()
    else:
        files.write(which, broken)
    for name in ('main.xml', 'Main'):
        found = files.find(name)
        assert names_in(found.library, found.key) == ['good']
        assert which in found.notice
        assert 'last good version' in found.notice
    # As long as nothing changes it is not tried again.
    reads = files.reads
    assert which in files.find('Main').notice
    assert files.reads == reads
    for name, text in texts.items():
        files.write(name, text.replace('good', 'repaired'))
    assert files.leaves('main.xml') == ['repaired']


def test_a_file_that_was_never_good_is_refused(files: Files) -> None:
    files.write('main.xml', BROKEN)
    with pytest.raises(UnknownTreeError, match='Nowhere'):
        files.find('main.xml')
    files.write('main.xml', leaf('good'))
    assert files.leaves('main.xml') == ['good']


def test_an_edit_of_two_files_that_fit_only_together_is_taken_over(files: Files) -> None:
    inner = files.write('inner.xml', leaf('old', 'Inner'))
    main = files.write('main.xml', document('<SubTree ID="Inner"/>'))
    files.store.load([inner, main])
    files.write('main.xml', document('<SubTree ID="Renamed"/>'))
    assert 'Renamed' in files.find('Main').notice
    files.write('inner.xml', leaf('new', 'Renamed'))
    assert files.leaves('Main') == ['new']


def test_a_change_that_is_taken_over_does_not_change_which_tree_is_meant(files: Files) -> None:
    shadowed = '<BehaviorTree ID="Main"><AlwaysSuccess name="shadowed"/></BehaviorTree>'
    text = document('<AlwaysSuccess name="1"/>', 'Inner').replace('<BehaviorTree', f'{shadowed}<BehaviorTree', 1)
    lower = files.write('lower.xml', text)
    upper = files.write('upper.xml', document('<SubTree ID="Inner"/>'))
    files.store.load([lower, upper])
    assert files.leaves('Main') == ['1']
    files.write('lower.xml', text.replace('"1"', '"2"'))
    assert files.leaves('Main') == ['2']
    assert files.find('Main').key.file == upper


def test_files_that_have_not_changed_are_not_read(files: Files) -> None:
    main = files.write('main.xml', including('inner.xml'))
    files.write('inner.xml', leaf('x', 'Inner'))
    files.leaves('main.xml')
    reads = files.reads
    files.leaves('main.xml')
    files.leaves('Main')
    assert files.reads == reads
    library = files.store.library
    os.utime(main)  # touched
    files.leaves('Main')
    assert files.reads == reads + 2
    assert files.store.library is library
    files.leaves('Main')
    assert files.reads == reads + 2


def test_an_edit_that_hides_is_seen(files: Files) -> None:
    main = files.write('main.xml', leaf('old'))
    assert files.leaves('main.xml') == ['old']
    status = Path(main).stat()
    files.write('main.xml', leaf('new'))
    os.utime(main, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert Path(main).stat().st_mtime_ns == status.st_mtime_ns
    assert files.leaves('main.xml') == ['new']


@pytest.mark.parametrize('link', ['current', 'current.xml'])
def test_a_link_that_leads_to_another_file_is_taken_over(files: Files, link: str) -> None:
    """A deployment that replaces the link to a version replaces no file."""
    within = '' if link.endswith('.xml') else '/main.xml'
    for version in (1, 2):
        file = Path(files.write(f'{version}/main.xml', leaf(version)))
        new = files.directory / 'new'
        new.symlink_to(file if not within else file.parent)
        new.replace(files.directory / link)
        assert files.leaves(f'{link}{within}') == [str(version)]


def test_an_include_that_is_left_out_is_not_looked_at_any_more(files: Files) -> None:
    files.write('main.xml', including('inner.xml', body='<AlwaysSuccess name="main"/>'))
    files.write('inner.xml', leaf('x', 'Inner'))
    files.leaves('main.xml')
    files.write('main.xml', leaf('alone'))
    assert files.leaves('main.xml') == ['alone']
    files.write('inner.xml', BROKEN)
    assert files.leaves('main.xml') == ['alone']


def test_a_tree_that_a_loaded_file_has_now_is_found(files: Files) -> None:
    main = files.write('main.xml', leaf('x'))
    files.store.load([main])
    with pytest.raises(UnknownTreeError, match='Later'):
        files.find('Later')
    files.write('main.xml', leaf('x', 'Later'))
    assert files.leaves('Later') == ['x']
    with pytest.raises(UnknownTreeError, match='Main'):
        files.find('Main')


PARTS = ('main.xml', 'a.xml', 'b.xml', 'c.xml')


def part(name: str, version: int) -> str:
    """Write files of which main includes a and runs what b has, which includes c."""
    match name:
        case 'main.xml':
            subtrees = '<SubTree ID="A"/><SubTree ID="B"/>'
            return including('a.xml', body=f'<Sequence><AlwaysSuccess name="main{version}"/>{subtrees}</Sequence>')
        case 'a.xml':
            return leaf(f'a{version}', 'A')
        case 'b.xml':
            body = f'<Sequence><AlwaysSuccess name="b{version}"/><SubTree ID="C"/></Sequence>'
            return including('c.xml', body=body, tree='B')
        case _:
            return leaf(f'c{version}', 'C')


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(PARTS), st.sampled_from(['edit', 'edit', 'break', 'delete', 'touch', 'find', 'find'])
        ),
        max_size=25,
    )
)
def test_any_history_of_edits_ends_with_the_newest_that_are_good(
    tmp_path_factory: pytest.TempPathFactory, history: list[tuple[str, str]]
) -> None:
    files = Files(tmp_path_factory.mktemp('edits'))
    for name in PARTS:
        files.write(name, part(name, 0))
    files.store.load([files.path('b.xml'), files.path('main.xml')])
    good, taken = dict.fromkeys(PARTS, True), dict.fromkeys(PARTS, 0)
    current = dict(taken)
    for version, (name, deed) in enumerate([*history, ('', 'find')], 1):
        match deed:
            case 'edit':
                files.write(name, part(name, version))
                good[name], current[name] = True, version
            case 'break':
                files.write(name, BROKEN)
                good[name] = False
            case 'delete':
                Path(files.path(name)).unlink(missing_ok=True)
                good[name] = False
            case 'touch' if Path(files.path(name)).exists():
                os.utime(files.path(name))
            case 'find':
                found = files.find('Main')
                if all(good.values()):
                    taken = dict(current)
                    assert found.notice == ''
                else:
                    assert 'last good version' in found.notice
                expected = [f'{part_name.removesuffix(".xml")}{taken[part_name]}' for part_name in PARTS]
                assert names_in(found.library, found.key) == expected


def test_on_the_server_the_result_and_the_log_tell_of_an_edit_that_was_not_taken_over(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    files = Files(tmp_path)
    main = files.write('main.xml', including('inner.xml'))
    inner = files.write('inner.xml', document('<AlwaysFailure name="good"/>', 'Inner'))
    with open_server_world(allowed_directories=[str(tmp_path)], default_tree=main) as world:
        assert world.client.execute('').result.message == 'Inner::1/good: AlwaysFailure returned FAILURE'
        files.write('inner.xml', BROKEN)
        result = world.client.execute('').result
        assert result.code == BtExecute.Result.FAILURE
        assert result.failed_node == 'Inner::1/good'
        assert f'last good version runs: {inner}:1:' in result.message
        files.write('inner.xml', leaf('good', 'Inner'))
        result = world.client.execute('').result
        assert (result.code, result.message) == (BtExecute.Result.SUCCESS, '')
    assert 'last good version runs' in capfd.readouterr().err
