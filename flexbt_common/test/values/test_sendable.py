# SPDX-License-Identifier: BSD-3-Clause
"""Any text goes through the middleware once it was made sendable, and text that was sendable is not changed."""

from __future__ import annotations

import re
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String

from flexbt_core.values.text import sanitize_for_message

ANY_TEXT = st.text(st.characters(exclude_categories=()), max_size=40)


@given(ANY_TEXT)
def test_any_text_arrives_as_it_was_made(text: str) -> None:
    made = sanitize_for_message(text)
    message = deserialize_message(serialize_message(String(data=made)), String)
    assert message.data == made
    without_bytes = re.sub('[\udc80-\udcff]', '', text)
    assert len(without_bytes) <= len(made) <= len(text)
    kept = [character for character in text if character != '\0' and not '\ud800' <= character <= '\udfff']
    assert not Counter(kept) - Counter(made)
    assert sanitize_for_message(made) == made


@given(ANY_TEXT, st.integers(0, 50))
def test_beginning_and_end_of_a_long_text_stay(text: str, limit: int) -> None:
    made = sanitize_for_message(text, limit)
    if len(text) <= limit:
        assert made == sanitize_for_message(text)
        return
    half = limit // 2
    assert made.startswith(sanitize_for_message(text[:half]))
    assert f'({len(text) - 2 * half} characters left out)' in made


@pytest.mark.parametrize('text', ['Grüße ☃', 'a', '日本', '\U0001f600'])
def test_bytes_of_utf_8_that_the_locale_lacks_are_what_was_written(text: str) -> None:
    as_argument = text.encode('utf-8').decode('ascii', 'surrogateescape')  # of sys.argv where the locale is C
    assert sanitize_for_message(as_argument) == text
    assert sanitize_for_message(f'{as_argument}\udcff\ud800') == f'{text}\ufffd\ufffd'
