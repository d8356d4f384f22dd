# SPDX-License-Identifier: BSD-3-Clause
"""Findings of files that are refused: one fault does not hide the others."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.registry import NodeRegistry, node_skills
from flexbt_core.behavior_tree.model.errors import Source, TreeLoadError
from flexbt_core.behavior_tree.xml.parser import parse
from flexbt_server.node_types import node_registry
from flexbt_studio.documents.diagnostics import Checker, without
from flexbt_studio.documents.project import Project
from flexbt_studio.documents.text import applied
from flexbt_studio.documents.xml_document import XmlDocument

TREE = """\
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence>
      <Wait wait_duration="1"/>
      <Spin/>
      <Spin/>
      <Fallback name="try">
        <AlwaysSuccess/>
        <BackUp/>
      </Fallback>
    </Sequence>
  </BehaviorTree>
</root>
"""
TWICE, NEVER_TICKED = ('twice', 'Main/0/2'), ('unreachable', 'Main/0/3/1')


@pytest.fixture(scope='module')
def registry() -> NodeRegistry:
    return node_registry(lambda nodes, error: None)


@pytest.mark.parametrize('line_break', ['\n', '\r\n', '\r', '\x85', '\u2028', '\u2029'])
def test_a_fault_of_a_machine_is_told_at_its_place(tmp_path: Path, registry: NodeRegistry, line_break: str) -> None:
    project = Project(tmp_path)
    text = f'machine:\n  outcomes: [done]\n  states:\n    A: {{state: "a{line_break}  b"}}\n    B: {{state: Wrong}}\n'
    project.create('main.yaml', text)
    found = Checker(project, registry, node_skills(registry, lambda text: None)).findings('main.yaml')
    (span,) = [one.span for one in found if "'Wrong'" in one.record['message']]
    assert text[span.start : span.end] == 'Wrong'


@pytest.mark.parametrize(
    ('wrong', 'right', 'mended'),
    [
        ('GoHom', 'GoHome', 'GoHome'),
        ("'Go Hom'", 'Go Home', "'Go Home'"),
        ('Go Hom', 'Go Home', None),
        ('"Go & Se"', 'Go & See', None),
    ],
)
def test_the_fix_of_a_name_replaces_the_whole_name_or_is_not_there(
    tmp_path: Path, registry: NodeRegistry, wrong: str, right: str, mended: str | None
) -> None:
    text = (
        f'machine:\n  outcomes: [done]\n  states:\n    A: {{state: Wait, transitions: {{done: {wrong}}}}}\n'
        f'    {right}: {{state: Wait, transitions: {{done: done}}}}\n'
    )
    project = Project(tmp_path)
    project.create('main.yaml', text)
    found = Checker(project, registry, node_skills(registry, lambda text: None)).findings('main.yaml')
    (told,) = [one for one in found if f"did you mean '{right}'" in one.record['message']]
    assert [applied(text, fix.edits) for fix in told.fixes] == (
        [text.replace(f'{wrong}}}', f'{mended}}}')] if mended else []
    )


@pytest.mark.parametrize(
    ('fault', 'told', 'others'),
    [
        (('wait_duration', 'wait_durations'), 'did you mean', {TWICE, NEVER_TICKED}),
        (('<BackUp/>', '<BakUp/>'), 'BakUp', {TWICE}),
        (('</Sequence>', ''), 'does not close', {TWICE, NEVER_TICKED}),
        (('</root>', ''), 'never closed', {TWICE, NEVER_TICKED}),
        (('"1"/>', '"1"'), "unexpected '<'", {NEVER_TICKED}),
        (('<BackUp/>', '<'), 'write &lt;', {TWICE}),
        (('"try"', 'try'), 'quoted', {TWICE}),
    ],
)
def test_a_fault_is_told_with_what_is_found_in_the_rest(
    tmp_path: Path, registry: NodeRegistry, fault: tuple[str, str], told: str, others: set[tuple[str, str]]
) -> None:
    project = Project(tmp_path)
    project.create('main.xml', TREE.replace(*fault))
    found = Checker(project, registry, node_skills(registry, lambda text: None)).findings('main.xml')
    errors = [one for one in found if one.record['rule'] == 'refused']
    assert len(errors) == 1
    assert told in errors[0].record['message']
    assert others <= {(one.record['rule'], one.path) for one in found}
    text = project.open('main.xml').document.text
    assert all(text[one.span.start] == '<' for one in found if one.record['rule'] != 'refused')


@given(st.data())
def test_what_is_left_of_any_text_can_be_parsed(data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(TREE)))
    end = data.draw(st.integers(start, min(len(TREE), start + 40)))
    text = TREE[:start] + data.draw(st.text(st.sampled_from('<>/"= aW&;!-'), max_size=6)) + TREE[end:]
    document = XmlDocument(text, 'a.xml')
    starts = [node.offset for node in document.nodes]
    left_out = set(data.draw(st.lists(st.sampled_from(starts), max_size=2))) if starts else set()
    left, origins = without(document, left_out)
    try:
        root = parse(Source('a.xml', left))
    except TreeLoadError as error:
        raise AssertionError(f'{error}: {left}') from error
    waiting = [root]
    while waiting:
        element = waiting.pop()
        waiting += element.children
        if element.offset in origins:
            assert text.startswith(f'<{element.tag}', origins[element.offset])
