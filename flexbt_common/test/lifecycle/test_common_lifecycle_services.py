# SPDX-License-Identifier: BSD-3-Clause
"""The lifecycle of a part that stands in for a managed node, asked as a lifecycle manager does."""

from __future__ import annotations

from flexbt_common.lifecycle import LifecycleServices
from flexbt_common.runtime import NodeRuntime
from flexbt_testing.nodes.lifecycle_client import LifecycleClient


def test_a_manager_takes_it_through_its_states() -> None:
    told: list[bool] = []
    with NodeRuntime.open('host', namespace='/robot1') as host, NodeRuntime.open('manager') as runtime:
        part = host.call(lambda: LifecycleServices(host.node, 'amcl', told.append))
        manager = LifecycleClient(runtime, '/robot1/amcl')
        assert manager.state() == part.label == 'active'
        for transition, succeeds, state in (
            ('activate', False, 'active'),
            ('deactivate', True, 'inactive'),
            (99, False, 'inactive'),
            ('cleanup', True, 'unconfigured'),
            (1, True, 'inactive'),  # configure
            (3, True, 'active'),  # activate
            ('shutdown', True, 'finalized'),
            ('configure', False, 'finalized'),
        ):
            assert manager.change(transition) is succeeds
            assert manager.state() == state
        assert told == [False, True, False]
