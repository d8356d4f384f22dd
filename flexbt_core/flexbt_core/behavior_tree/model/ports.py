# SPDX-License-Identifier: BSD-3-Clause
"""Ports: the typed inputs and outputs that a node class declares, and what an XML attribute says about one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, NamedTuple

from .port_types import PortType


class PortDirection(Enum):
    """Whether a node reads a port, writes it, or both."""

    INPUT = 'input'
    OUTPUT = 'output'
    INOUT = 'inout'


class _NoDefault(Enum):
    NO_DEFAULT = 'no default'


NO_DEFAULT: Final = _NoDefault.NO_DEFAULT


def with_branch(text: str, nav2_branch: str) -> str:
    """The text, and the branch of Nav2 that alone has what it describes; '' if all have it."""
    return f'{text} (Nav2 {nav2_branch} only)'.lstrip() if nav2_branch else text


@dataclass(frozen=True, slots=True)
class Port:
    """A port of a node class.

    ``type`` None accepts every type. ``default`` is used when the XML does not give the port: text as it could stand in
    the XML (a literal, or a ``{pointer}``), or a value. A required port that is not given is an error at load.
    ``literal`` is the type of a literal where that is more than ``type`` says, such as when a pointer may be to an
    entry of any type. Its values have to be immutable. ``nav2_branch`` is the branch of Nav2 for which a file that
    gives the port has to be written (see ``NodeRegistry``); '' where it may be any. A port that does not ``declare`` is
    one of whose type nothing is known: the entry that it points to is made, and gets its type, by others.
    """

    direction: PortDirection
    type: PortType | None = None
    default: Any = NO_DEFAULT
    description: str = ''
    required: bool = False
    literal: PortType | None = None
    nav2_branch: str = ''
    declares: bool = True

    @property
    def documentation(self) -> str:
        """The description, and the branch of Nav2 that alone has the port."""
        return with_branch(self.description, self.nav2_branch)

    @property
    def readable(self) -> bool:
        return self.direction is not PortDirection.OUTPUT

    @property
    def writable(self) -> bool:
        return self.direction is not PortDirection.INPUT


def input_port(
    type: PortType | None = None,
    *,
    default: Any = NO_DEFAULT,
    description: str = '',
    optional: bool = False,
    literal: PortType | None = None,
    nav2_branch: str = '',
) -> Port:
    """A port that the node reads. It has to be given in the XML, unless it has a default or is optional."""
    return Port(
        PortDirection.INPUT, type, default, description, default is NO_DEFAULT and not optional, literal, nav2_branch
    )


def output_port(
    type: PortType | None = None, *, default: str | None = None, description: str = '', nav2_branch: str = ''
) -> Port:
    """A port that the node writes. It need not be given; a default has to be a ``{pointer}``."""
    written = NO_DEFAULT if default is None else default
    return Port(PortDirection.OUTPUT, type, written, description, nav2_branch=nav2_branch)


def inout_port(
    type: PortType | None = None,
    *,
    default: Any = NO_DEFAULT,
    description: str = '',
    optional: bool = False,
    literal: PortType | None = None,
    nav2_branch: str = '',
) -> Port:
    """A port that the node reads and writes."""
    return Port(
        PortDirection.INOUT, type, default, description, default is NO_DEFAULT and not optional, literal, nav2_branch
    )


class PortValue(NamedTuple):
    """What the XML (or a default) says about one port: a literal, or a pointer to a blackboard key.

    ``literal`` is the value of the literal where it can be shared (or the default that is not text); otherwise the
    text is converted at each read.
    """

    text: str
    key: str | None = None
    literal: Any = NO_DEFAULT


def pointer_key(text: str, port_name: str) -> str | None:
    """The blackboard key that ``text`` points to, or None when it is a literal.

    Spaces around the braces do not count; those inside are part of the key. ``{=}`` and ``=`` mean the key of the same
    name as the port.
    """
    stripped = text.strip(' ')
    if stripped == '=':
        return port_name
    if len(stripped) < 3 or stripped[0] != '{' or stripped[-1] != '}':
        return None
    key = stripped[1:-1]
    return port_name if key == '=' else key
