# SPDX-License-Identifier: BSD-3-Clause
"""Any text goes through the middleware once it was made sendable, and text that was sendable is not changed."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import String

from flexbt_core.values import sendable

ANY_TEXT = st.text(st.characters(exclude_categories=()), max_size=40)


@given(ANY_TEXT)
def test_any_text_arrives_as_it_was_made(text: str) -> None:
    made = sendable(text)
    message = deserialize_message(serialize_message(String(data=made)), String)
    assert message.data == made
    assert len(made) == len(text)
    assert all(new == old or old == '\0' or '\ud800' <= old <= '\udfff' for new, old in zip(made, text, strict=True))


@given(ANY_TEXT, st.integers(0, 50))
def test_beginning_and_end_of_a_long_text_stay(text: str, limit: int) -> None:
    made = sendable(text, limit)
    if len(text) <= limit:
        assert made == sendable(text)
        return
    half = limit // 2
    assert made.startswith(sendable(text[:half]))
    assert f'({len(text) - 2 * half} characters left out)' in made
