# SPDX-License-Identifier: BSD-3-Clause
"""What is told of who else publishes on a topic."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from flexbt_console.link.executive_sender import senders_problem


@pytest.mark.parametrize(
    ('nodes', 'told'),
    [
        ([('/a/', 'x'), ('/', 'y')], ' (/a/x, /y);'),
        ([('_NODE_NAMESPACE_UNKNOWN_', '_NODE_NAME_UNKNOWN_'), ('/', 'y')], ' (/y);'),
        ([('_NODE_NAMESPACE_UNKNOWN_', '_NODE_NAME_UNKNOWN_')] * 2, '/status;'),
    ],
)
def test_executives_are_named_as_far_as_their_names_are_known(nodes: list[tuple[str, str]], told: str) -> None:
    publishers = [SimpleNamespace(node_namespace=namespace, node_name=name) for namespace, name in nodes]
    node = SimpleNamespace(resolve_topic_name=lambda t: f'/{t}', get_publishers_info_by_topic=lambda t: publishers)
    assert told in senders_problem(node, 'status', 2)
    assert 'end all but one (a killed one leaves within 30 s)' in senders_problem(node, 'status', 2)
    assert not senders_problem(node, 'status', 1)
