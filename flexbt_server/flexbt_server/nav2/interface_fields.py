# SPDX-License-Identifier: BSD-3-Clause
"""Goals and requests of Nav2, whose fields differ between its branches: by what the installed interfaces have."""

from __future__ import annotations

from typing import Any

from flexbt_common.values import message_type_name
from flexbt_server.leaves import ActionLeaf, ServiceNode


def set_ports(leaf: ActionLeaf | ServiceNode, message: Any, *names: str) -> None:
    """Give fields the values of the ports of the same names, which the interfaces of some branch have.

    One that the installed interfaces lack is left out. People are told so, once, where a tree gives the port another
    value than its default.
    """
    for name in names:
        if has_field(leaf, message, name):
            value = leaf.get_input_or(name, None)
            if value is not None:
                setattr(message, name, value)


def has_field(leaf: ActionLeaf | ServiceNode, message: Any, port: str) -> bool:
    """Whether the message has the field of this port; tells people when a tree gives a port for nothing."""
    if hasattr(message, port):
        return True
    given = leaf.port_text(port)
    if given is not None and given != leaf.ports[port].default:
        leaf.host.warn_once(
            f'{leaf.id}: the port [{port}] has no effect: {message_type_name(type(message))}, as it is installed, has '
            f'no field of this name'
        )
    return False
