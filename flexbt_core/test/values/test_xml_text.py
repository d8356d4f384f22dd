# SPDX-License-Identifier: BSD-3-Clause
"""What is written into a document is what a parser reads."""

from xml.etree import ElementTree

from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.values.text import xml_attribute, xml_text

CHARACTERS = st.characters(exclude_categories=['Cc', 'Cs'], exclude_characters='\ufffe\uffff')


@given(st.text(st.sampled_from('&<>"\'\n\t; a#1') | CHARACTERS))
def test_a_parser_reads_what_was_written(text: str) -> None:
    document = f'<a b={xml_attribute(text)} c={xml_attribute(chr(13))}>{xml_text(text)}</a>'
    read = ElementTree.fromstring(document)  # noqa: S314
    assert (read.get('b'), read.get('c'), read.text or '') == (text, '\r', text)
