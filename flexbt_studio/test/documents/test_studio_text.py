# SPDX-License-Identifier: BSD-3-Clause
"""Edits, their inverse, and positions as editors and the page count them."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_studio.documents.text import Lines, TextEdit, applied, difference, inverse
from flexbt_studio.server.page_text import PageText, shown

TEXTS = st.text(st.sampled_from('ab\n\r<é€😀'), max_size=30)


@st.composite
def edited(draw: st.DrawFn) -> tuple[str, list[TextEdit]]:
    """Return a text and edits of it that do not overlap."""
    text = draw(TEXTS)
    places = sorted(draw(st.lists(st.integers(0, len(text)), max_size=8)))
    pairs = zip(places[::2], places[1::2], strict=False)
    return text, [TextEdit(start, end, draw(TEXTS)) for start, end in pairs]


@given(edited())
def test_the_inverse_gives_the_text_back(case: tuple[str, list[TextEdit]]) -> None:
    text, edits = case
    assert applied(applied(text, edits), inverse(text, edits)) == text


@given(TEXTS, TEXTS)
def test_a_difference_leads_from_one_text_to_the_other(before: str, after: str) -> None:
    assert applied(before, difference(before, after)) == after


@pytest.mark.parametrize('edit', [TextEdit(2, 1, ''), TextEdit(0, 9, ''), TextEdit(-1, 0, '')])
def test_an_edit_outside_of_the_text_is_refused(edit: TextEdit) -> None:
    with pytest.raises(ValueError, match='not within'):
        applied('abc', [edit])


def test_edits_that_overlap_are_refused() -> None:
    with pytest.raises(ValueError, match='overlaps'):
        applied('abcdef', [TextEdit(0, 3, 'x'), TextEdit(2, 4, 'y')])


@given(TEXTS, st.integers(0, 30))
def test_positions_agree_with_a_count_by_lines(text: str, offset: int) -> None:
    offset = min(offset, len(text))
    if text[offset - 1 : offset + 1] == '\r\n':
        return  # within a line break there is no position
    before = re.split('\r\n|\r|\n', text[:offset])
    expected = len(before) - 1, len(before[-1].encode('utf-16-le')) // 2
    lines = Lines(text)
    assert lines.position(offset) == expected
    assert lines.offset(*expected) == offset


@given(TEXTS, st.integers(0, 30))
def test_the_page_counts_utf_16_units_of_the_text_that_it_shows(text: str, offset: int) -> None:
    offset = min(offset, len(text))
    if text[offset - 1 : offset + 1] == '\r\n':
        return
    page = PageText(text)
    expected = len(shown(text[:offset]).encode('utf-16-le')) // 2
    assert page.to_page(offset) == expected
    assert page.from_page(expected) == offset


@given(edited(), st.sampled_from(['\n', '\r\n']))
def test_an_edit_of_the_page_does_in_the_text_what_it_does_there(
    case: tuple[str, list[TextEdit]], line_break: str
) -> None:
    page_text = shown(case[0])
    edits = [TextEdit(*one[:2], shown(one.text)) for one in case[1] if one.end <= len(page_text)]
    text = page_text.replace('\n', line_break)
    units = PageText(page_text).edits_to_page(edits)  # the same places, in UTF-16 units
    assert shown(applied(text, PageText(text).edits_from_page(units))) == applied(page_text, edits)


@given(st.text(st.sampled_from('ab\n\r😀😁'), max_size=12), st.data())
def test_an_edit_of_units_keeps_the_text_that_the_page_shows(text: str, data: st.DataObject) -> None:
    page = shown(text).encode('utf-16-le')
    for _ in range(3):
        start = data.draw(st.integers(0, len(page) // 2))
        end = data.draw(st.integers(start, len(page) // 2))
        written = data.draw(st.sampled_from(['', 'x', '\n', '\n\n', '\ude00', '\ud83d', '😁']))
        page = page[: 2 * start] + written.encode('utf-16-le', 'surrogatepass') + page[2 * end :]
        text = applied(text, PageText(text).edits_from_page([[start, end, written]]))
        page = page.decode('utf-16-le', 'replace').encode('utf-16-le')  # no half of a character can be saved
        assert shown(text).encode('utf-16-le') == page
