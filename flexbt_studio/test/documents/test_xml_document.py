# SPDX-License-Identifier: BSD-3-Clause
"""XML documents: a gesture does what it means to the trees, and touches nothing else of the text."""

from __future__ import annotations

import inspect
import random
from pathlib import Path
from typing import Any

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from xml_gestures import Trial

from flexbt_core.behavior_tree.model.errors import Source, TreeLoadError
from flexbt_core.behavior_tree.xml.parser import parse
from flexbt_studio.documents.text import applied, inverse
from flexbt_studio.documents.xml_document import XmlDocument
from flexbt_studio.documents.xml_text import MOST_PROBLEMS
from flexbt_studio.errors import GestureError

PHASES = (Phase.explicit, Phase.reuse, Phase.generate)
"""Shrinking is left out: it takes minutes, and texts are small."""
ROOT = Path(__file__).parents[3]
FILES = [
    file
    for folder in ('flexbt_server/behavior_trees', 'flexbt_demo_behaviors/flexbt_demo_behaviors')
    for file in sorted((ROOT / folder).rglob('*.xml'))
]


def tree(content: str) -> str:
    return f'<root BTCPP_format="4">\n  <BehaviorTree ID="T">\n{content}\n  </BehaviorTree>\n</root>\n'


def with_other_layout(text: str, layout: str) -> str:
    """Return the same trees with other line breaks and indentation."""
    if layout == 'crlf':
        return text.replace('\n', '\r\n')
    if layout == 'tabs':
        return '\n'.join('\t' * ((len(line) - len(line.lstrip())) // 2) + line.lstrip() for line in text.split('\n'))
    if layout == 'one line' and '<!--' not in text:
        return ''.join(line.strip() + ' ' * (not line.rstrip().endswith('>')) for line in text.split('\n'))
    return text


def check_reading(text: str) -> XmlDocument:
    """Check that the document finds what the engine's parser finds: its elements, or its problem."""
    document = XmlDocument(text)
    try:
        root = parse(Source('', text))
    except TreeLoadError as error:
        (first,) = error.errors
        source = Source('', text)
        places = [(*source.position(one.span.start), one.message) for one in document.problems]
        assert (first.line, first.column, first.message) in places or len(places) > MOST_PROBLEMS
        return document
    assert not document.problems
    pending, expected = [root], []
    while pending:
        element = pending.pop()
        expected.append((element.tag, element.offset, element.attributes, element.offsets))
        pending += reversed(element.children)
    found = list(document.tops[0].all())
    assert [(one.tag, one.offset, one.attributes, one.offsets) for one in found] == expected
    for element in found:
        assert text[element.open_end - 1] == text[element.end - 1] == '>'
        assert element.is_empty or text.startswith(f'</{element.tag}', element.close)
    for node in document.view()['nodes']:
        assert document.at(node['path']).offset == node['span'][0]
        for attribute in node['attributes']:
            start, end = attribute['span']
            assert text[start - 1] == text[end] and text[start - 1] in '"\''
    return document


@pytest.mark.parametrize('layout', ['as it is', 'crlf', 'tabs', 'one line'])
@pytest.mark.parametrize('file', FILES, ids=lambda file: file.stem)
def test_random_gestures_on_files(file: Path, layout: str) -> None:
    text = with_other_layout(file.read_text(encoding='utf-8'), layout)
    check_reading(text)
    Trial(text, len(text)).run(5)


def test_files_are_there() -> None:
    assert len(FILES) >= 12


_BLANKS = st.sampled_from(['', ' ', '\n', '\n  ', '\n\t', '\n\n    ', '\r\n  ', ' \n'])
_FILLING = st.sampled_from(
    ['', '', '', '<!-- c -->', '<!--> <b/> -->', '<!--a\n  b-->', 'text', '<![CDATA[<x>]]>', '<?pi x?>']
)
_VALUES = st.sampled_from(['1', '{k}', 'a && b', 'a < b', '', "it's", 'x\n  y', '&lt;', '&#10;', '>', '<b/>'])


@st.composite
def elements(draw: st.DrawFn, depth: int = 0) -> str:
    tag = draw(st.sampled_from(['Sequence', 'A', 'Fallback', 'Inverter', 'Action', 'ns:b.c-d']))
    names = draw(st.lists(st.sampled_from(['x', 'y', 'name', '_skipIf', 'ID']), unique=True, max_size=3))
    attributes = ''.join(
        f'{draw(_BLANKS) or " "}{name}{draw(st.sampled_from(["=", " = "]))}"{draw(_VALUES)}"' for name in names
    )
    start = f'<{tag}{attributes}{draw(st.sampled_from(["", " ", chr(10)]))}'
    if depth > 3 or draw(st.booleans()):
        return f'{start}/>'
    return f'{start}>{draw(content(depth + 1))}</{tag}>'


@st.composite
def content(draw: st.DrawFn, depth: int = 0) -> str:
    parts = draw(st.lists(st.tuples(_BLANKS, _FILLING, _BLANKS, elements(depth), _BLANKS, _FILLING), max_size=3))
    return ''.join(''.join(part) for part in parts) + draw(_BLANKS)


@settings(max_examples=40, deadline=None, phases=PHASES)
@given(st.lists(content(), min_size=1, max_size=2), _BLANKS, st.integers(0, 1000))
def test_random_gestures_on_any_layout(trees: list[str], between: str, seed: int) -> None:
    """Comments and blanks anywhere, several elements on a line, texts, CDATA, odd tags."""
    inner = between.join(f'<BehaviorTree ID="T{number}">{one}</BehaviorTree>' for number, one in enumerate(trees))
    text = f'<root>{between}{inner}{between}</root>'
    check_reading(text)
    Trial(text, seed).run(8)


@pytest.mark.parametrize(
    ('name', 'arguments', 'before', 'after'),
    [
        # A comment above belongs to an element if it begins a line and no empty line is between.
        ('remove', {'node': 'T/0/0'}, '<S>\n<!-- a -->\n<A/>\n<B/>\n</S>', '<S>\n<B/>\n</S>'),
        ('remove', {'node': 'T/0/0'}, '<S>\n<!-- s -->\n\n<A/>\n<B/>\n</S>', '<S>\n<!-- s -->\n\n<B/>\n</S>'),
        ('remove', {'node': 'T/0/1'}, '<S>\n<A/> <!-- a -->\n<B/>\n</S>', '<S>\n<A/> <!-- a -->\n</S>'),
        ('remove', {'node': 'T/0/0'}, '<S>\n<A/> <!-- a -->\n<B/>\n</S>', '<S>\n<B/>\n</S>'),
        ('remove', {'node': 'T/0/0'}, '<S> <!-- s -->\n<A/>\n<B/>\n</S>', '<S> <!-- s -->\n<B/>\n</S>'),
        ('remove', {'node': 'T/0/1'}, '<S>\n<A/> <!-- a --> <B/>\n</S>', '<S>\n<A/> <!-- a -->\n</S>'),
        # Empty lines do not pile up.
        ('remove', {'node': 'T/0/1'}, '<S>\n<A/>\n\n<B/>\n\n<C/>\n</S>', '<S>\n<A/>\n\n<C/>\n</S>'),
        # An element without children is closed at once, and opened for a child.
        ('remove', {'node': 'T/0/0'}, '<S>\n  <A/>\n</S>', '<S/>'),
        ('remove', {'node': 'T/0/0'}, '<S>\n  <A/>\n  <!-- c -->\n\n  text\n</S>', '<S>\n  <!-- c -->\n\n  text\n</S>'),
        ('add_node', {'parent': 'T/0', 'index': 0, 'xml': '<A/>'}, '<S />', '<S>\n  <A/>\n</S>'),
        ('add_node', {'parent': 'T/0', 'index': 0, 'xml': '<A/>'}, '<S></S>', '<S>\n  <A/>\n</S>'),
        # On one line things stay on one line.
        ('add_node', {'parent': 'T/0', 'index': 1, 'xml': '<X/>'}, '<S><A/><B/></S>', '<S><A/><X/><B/></S>'),
        ('add_node', {'parent': 'T/0', 'index': 1, 'xml': '<X/>'}, '<S> <A/> <B/> </S>', '<S> <A/> <X/> <B/> </S>'),
        ('wrap', {'node': 'T/0/0', 'xml_type': 'W', 'values': {}}, '<S><A/></S>', '<S><W><A/></W></S>'),
        ('unwrap', {'node': 'T/0'}, '<W><A/></W>', '<A/>'),
        # Lines within values, texts and CDATA stay where they are.
        (
            'wrap',
            {'node': 'T/0', 'xml_type': 'W', 'values': {'n': '3'}},
            '    <!-- c\n      d -->\n    <A x="1\n  2"\n       y="3">\n      t\n\n      <![CDATA[\n    ]]>\n    </A>',
            '    <W n="3">\n      <!-- c\n        d -->\n      <A x="1\n  2"\n         y="3">\n      t\n\n'
            '        <![CDATA[\n    ]]>\n      </A>\n    </W>',
        ),
        # Values: only what changes; escapes only where needed; each on its line if the others are.
        ('set_value', {'node': 'T/0', 'name': 'x', 'value': 'a && c'}, '<A x="a && b"/>', '<A x="a && c"/>'),
        ('set_value', {'node': 'T/0', 'name': 'x', 'value': 'a < c'}, '<A x="a &lt; b"/>', '<A x="a &lt; c"/>'),
        ('set_value', {'node': 'T/0', 'name': 'x', 'value': '"&lt;"'}, "<A x='1'/>", '<A x=\'"&amp;lt;"\'/>'),
        ('set_value', {'node': 'T/0', 'name': 'x', 'value': 'a\nc'}, '<A x="a\nb"/>', '<A x="a\nc"/>'),
        ('set_value', {'node': 'T/0', 'name': 'x', 'value': 'a\nc'}, '<A x="a"/>', '<A x="a&#10;c"/>'),
        ('set_value', {'node': 'T/0', 'name': 'y', 'value': '2'}, '<A\n  x="1"\n/>', '<A\n  x="1"\n  y="2"\n/>'),
        ('set_value', {'node': 'T/0', 'name': 'x', 'value': None}, '<A x="1" y="2"/>', '<A y="2"/>'),
        # Types and forms.
        ('set_type', {'node': 'T/0', 'type': 'B', 'form': ''}, '<Action ID="A" x="1"></Action>', '<B x="1"></B>'),
        ('set_type', {'node': 'T/0', 'type': 'B', 'form': 'SubTree'}, '<A x="1"/>', '<SubTree ID="B" x="1"/>'),
        ('set_type', {'node': 'T/0', 'type': 'B', 'keep': ['y']}, '<A x="1" y="2" _z="3"/>', '<B y="2" _z="3"/>'),
        # Notes.
        ('set_comment', {'node': 'T/0/0', 'text': 'n'}, '<S>\n <A/>\n</S>', '<S>\n <!-- n -->\n <A/>\n</S>'),
        ('set_comment', {'node': 'T/0/0', 'text': 'n'}, '<S><A/></S>', '<S><A/> <!-- n --></S>'),
        (
            'set_comment',
            {'node': 'T/0/0', 'text': 'n\nm'},
            '<S>\n <!--a-->\n <A/></S>',
            '<S>\n <!-- n\n      m -->\n <A/></S>',
        ),
        ('set_comment', {'node': 'T/0/0', 'text': None}, '<S>\n <!-- a -->\n <A/></S>', '<S>\n <A/></S>'),
        ('set_comment', {'node': 'T/0/0', 'text': None}, '<S>\n <A/> <!-- a -->\n</S>', '<S>\n <A/>\n</S>'),
        # Keys: in pointers, scripts (not in their texts), ports that name a key, calls and models.
        (
            'rename_key',
            {'tree': 'T', 'old': 'k', 'new': 'key'},
            '<S><Script code="k := \'k\' .. j"/><A k="{=}" x=" {k} " y="k"/>'
            '<SetBlackboard value="k" output_key="k"/></S>',
            '<S><Script code="key := \'k\' .. j"/><A k="{key}" x=" {key} " y="k"/>'
            '<SetBlackboard value="k" output_key="key"/></S>',
        ),
        (
            'rename_key',
            {'tree': 'T', 'old': 'k', 'new': 'key'},
            '<S _skipIf="k &lt; 2 && k2"><SubTree ID="U" k="{k}" k2="k"/></S>',
            '<S _skipIf="key &lt; 2 && k2"><SubTree ID="U" k="{key}" k2="k"/></S>',
        ),
    ],
)
def test_exact_text(name: str, arguments: dict[str, Any], before: str, after: str) -> None:
    text = tree(before)
    edits = XmlDocument(text).gesture(name, arguments)
    assert applied(text, edits) == tree(after)
    assert applied(tree(after), inverse(text, edits)) == text


FORMAT_3 = """<root main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <SequenceStar>
      <SubTree ID="Sub" port="k" other="k2" __shared_blackboard="false">
        <remap internal="third" external="k"/>
      </SubTree>
      <A x="{k}"/>
    </SequenceStar>
  </BehaviorTree>
  <BehaviorTree ID="Sub"><A y="{port}"/></BehaviorTree>
</root>
"""


def test_format_3() -> None:
    """Sub-trees name keys without braces."""
    document = XmlDocument(FORMAT_3)
    view = document.view()
    assert view['format'] == '3' and [node['path'] for node in view['nodes']] == [
        'Main/0',
        'Main/0/0',
        'Main/0/1',
        'Sub/0',
    ]
    renamed = applied(FORMAT_3, document.gesture('rename_key', {'tree': 'Main', 'old': 'k', 'new': 'n'}))
    assert renamed == FORMAT_3.replace('"k"', '"n"').replace('{k}', '{n}')
    renamed = applied(FORMAT_3, document.gesture('rename_key', {'tree': 'Sub', 'old': 'port', 'new': 'n'}))
    assert renamed == FORMAT_3.replace('port=', 'n=').replace('{port}', '{n}')
    inlined = applied(FORMAT_3, document.gesture('inline', {'node': 'Main/0/0'}))
    assert '<A y="{k}"/>\n      <A x="{k}"/>' in inlined


def test_paths_of_trees_are_unambiguous() -> None:
    ids = ['', ' ID="A"', ' ID="A"', ' ID="a/0"', ' ID="#1"', ' ID="B"']
    text = (
        '<root>'
        + ''.join(f'<BehaviorTree{id}><X n="{number}"/></BehaviorTree>' for number, id in enumerate(ids))
        + '</root>'
    )
    nodes = XmlDocument(text).view()['nodes']
    assert [node['path'] for node in nodes] == ['#1/0', 'A/0', '#3/0', '#4/0', '#5/0', 'B/0']
    for number, node in enumerate(nodes):
        edits = XmlDocument(text).gesture('set_value', {'node': node['path'], 'name': 'n', 'value': 'new'})
        assert applied(text, edits) == text.replace(f'n="{number}"', 'n="new"')


BROKEN = tree("""    <Sequence>
      <A x="1"/>
      <B y="2>
      <C z="3"/>
      <Fallback>
        <D/>
    </Sequence>""")


def test_the_rest_of_a_broken_text_is_viewed_and_edited() -> None:
    document = check_reading(BROKEN)
    nodes = {node['path']: node['type'] for node in document.view()['nodes']}
    assert list(nodes.values()) == ['Sequence', 'A', 'B', 'C', 'Fallback', 'D']
    edits = document.gesture('set_value', {'node': 'T/0/2', 'name': 'z', 'value': '4'})
    assert applied(BROKEN, edits) == BROKEN.replace('z="3"', 'z="4"')
    for node in ('T/0/1', 'T/0/3'):
        with pytest.raises(GestureError, match='fix the text first'):
            document.gesture('remove', {'node': node})
    with pytest.raises(GestureError, match='fix the text first'):
        document.gesture('add_node', {'parent': 'T/0', 'index': 2, 'xml': '<X/>'})


_MARKS = [
    '<',
    '>',
    '"',
    "'",
    '/',
    '<A',
    '<!--',
    '-->',
    '&',
    '\0',
    '=',
    '</A>',
    '<a b',
    '<![CDATA[',
    '<?',
    '<!DOCTYPE x>',
    '\n',
]


@settings(max_examples=60, deadline=None, phases=PHASES)
@given(
    st.sampled_from([*(file.read_text(encoding='utf-8')[:3000] for file in FILES), BROKEN, FORMAT_3]),
    st.lists(st.tuples(st.integers(0, 3000), st.sampled_from(_MARKS), st.integers(0, 9)), max_size=4),
    st.integers(0, 10**6),
)
def test_damaged_texts(text: str, damages: list[tuple[int, str, int]], seed: int) -> None:
    """Reading finds the problem of the engine's parser; gestures do not make it worse."""
    for place, mark, length in damages:
        text = text[:place] + mark + text[place + length :]
    document = check_reading(text)
    paths = [node['path'] for node in document.view()['nodes']] or ['']
    chance = random.Random(seed)
    for name, arguments in (
        ('remove', {}),
        ('move', {'parent': chance.choice(paths), 'index': chance.randint(0, 2)}),
        ('wrap', {'xml_type': 'W', 'values': {}}),
        ('unwrap', {}),
        ('set_comment', {'text': 'note'}),
        ('set_value', {'name': 'x', 'value': 'v'}),
        ('extract', {'id': 'New'}),
    ):
        try:
            edits = document.gesture(name, {'node': chance.choice(paths), **arguments})
        except GestureError:
            continue
        after = applied(text, edits)
        assert len(XmlDocument(after).problems) <= len(document.problems)
        assert applied(after, inverse(text, edits)) == text


_JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=9)
    | st.sampled_from(['T', 'T/0', '<A/>']),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(max_examples=15, deadline=None, phases=PHASES)
@given(st.data())
def test_nonsense_is_refused(data: st.DataObject) -> None:
    document = XmlDocument(tree('<S k="{k}"><A/></S>'))
    wanted = {
        'node': 'T/0',
        'parent': 'T/0',
        'tree': 'T',
        'index': 0,
        'xml': '<A/>',
        'ports': [],
        'values': {},
        'name': 'k',
    }
    for name in document.gestures():
        arguments = {}
        for argument in inspect.signature(getattr(document, name)).parameters:
            is_good = argument in wanted and data.draw(st.booleans())
            arguments[argument] = wanted[argument] if is_good else data.draw(_JSON)
        try:
            edits = document.gesture(name, arguments)
        except GestureError as error:
            assert str(error)
        else:
            check_reading(applied(document.text, edits))


@pytest.mark.parametrize(
    'text',
    [
        '<a>' * 20_000,
        '<a>' * 258 + '</b>' * 10_000,
        '<!--' * 10_000,
        '<a b="\n' * 10_000,
        '<' * 10_000,
        '<a' + ' b=""' * 10_000,
        '<root><BehaviorTree>' + '\r<a/>' * 5_000 + '</BehaviorTree></root>',
        '<a/>' * 300_000,
        '\0' * 10_000,
        '',
    ],
    ids=lambda text: f'{text[:8]!r}',
)
def test_hostile_texts(text: str) -> None:
    document = check_reading(text) if len(text) < 1 << 20 else XmlDocument(text)
    document.view()
    assert len(document.problems) <= MOST_PROBLEMS + 1
    with pytest.raises(GestureError):
        document.gesture('remove', {'node': '#1/0/99999'})
