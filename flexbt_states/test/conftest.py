# SPDX-License-Identifier: BSD-3-Clause
"""What the tests run states with."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from flexbt_testing.nodes.state_bench import StateBench


@pytest.fixture
def bench() -> Iterator[StateBench]:
    """Run states, with action servers that do what the test says."""
    with StateBench() as bench:
        yield bench
