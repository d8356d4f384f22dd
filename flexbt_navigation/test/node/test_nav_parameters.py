# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of navigation that are wrong: told with their name, and nothing else happens."""

from __future__ import annotations

import pytest

from flexbt_common.errors import UnfitParameterError
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_navigation.parameters import declare_navigation_parameters


@pytest.mark.parametrize(
    'footprint',
    [
        '[[0.2, 0.2], [NaN, 0.1], [-0.2, 0.0]]',
        '[[0.2, 0.2], [Infinity, 0.1], [-0.2, 0.0]]',
        f'[[0.2, 0.2], [1{"0" * 400}, 0.1], [-0.2, 0.0]]',
        '[' * 100_000,
        '[[1, 2, 3]]',
        '{"a": 1}',
        'x' * 100_000,
    ],
    ids=['nan', 'infinity', 'huge', 'nested', 'shape', 'object', 'long'],
)
def test_a_footprint_that_is_none_is_refused_by_its_name(footprint: str) -> None:
    with NodeRuntime.open('navigation', parameters={'footprint': footprint}) as runtime:
        with pytest.raises(UnfitParameterError, match="parameter 'footprint'") as refused:
            runtime.call(lambda: declare_navigation_parameters(runtime.node))
        assert len(str(refused.value)) < 500
