# SPDX-License-Identifier: BSD-3-Clause
"""The errors of flexbt_common.

flexbt_core.errors.FlexbtError
├── UnknownTypeError        no installed type has that name
├── ValueConversionError    a value does not fit its type
├── LimitExceededError      a message exceeds a limit
├── ResourceError           a file cannot be used
├── TopicTypeError          a topic has another type
├── TransformError          no transform between two frames is known
└── UnfitParameterError     a parameter has no value that can work
"""

from __future__ import annotations

from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import short_repr


class UnknownTypeError(FlexbtError):
    """No installed type has the name ``type``."""

    def __init__(self, type: str, message: str) -> None:
        super().__init__(message)
        self.type = type


class ValueConversionError(FlexbtError):
    """The value of ``key``, shown as ``text``, does not fit ``type``; ``reason`` has place and cause."""

    def __init__(self, key: str, type: str, text: str, reason: str) -> None:
        super().__init__(f'{key or "value"}: cannot take {short_repr(text)} as {type or "a value"}: {reason}')
        self.key = key
        self.type = type
        self.text = text
        self.reason = reason


class LimitExceededError(FlexbtError):
    """A message from another process exceeds a limit; the text names the field and the limit."""


class ResourceError(FlexbtError):
    """The file ``name`` cannot be used."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f'{name}: {message}')
        self.name = name


class TopicTypeError(FlexbtError):
    """A topic cannot be used with ``type``, since this process already uses it with another type."""

    def __init__(self, topic: str, type: str, others: list[str]) -> None:
        super().__init__(
            f'topic {topic} has the type {", ".join(others)} and cannot be used as {type}; use another topic'
        )
        self.topic = topic
        self.type = type


class TransformError(FlexbtError):
    """No transform between two frames is known at a time, or a received transform is invalid.

    ``is_early``: the transform may be known in a moment.
    """

    def __init__(self, message: str, *, is_early: bool = False) -> None:
        super().__init__(message)
        self.is_early = is_early


class UnfitParameterError(FlexbtError):
    """The parameter ``name`` has no value that its type and its limits allow."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(f'parameter {name!r}: {message}')
        self.name = name
