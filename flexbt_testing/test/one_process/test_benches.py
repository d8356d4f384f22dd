# SPDX-License-Identifier: BSD-3-Clause
"""What a test on a bench says when it fails."""

from __future__ import annotations

import pytest

from flexbt_core import EventState, UserData
from flexbt_testing.nodes.state_bench import StateBench


class Waiting(EventState):
    """A state that says what is wrong, and waits for ever."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'])

    def on_enter(self, userdata: UserData) -> None:
        self.log_warn('the door is closed')

    def execute(self, userdata: UserData) -> None:
        return None


def test_a_state_that_does_not_end_is_told_with_what_it_has_said(capfd: pytest.CaptureFixture[str]) -> None:
    with StateBench() as bench:
        run = bench.run_state(Waiting)
        with pytest.raises(AssertionError, match=r"end of the run, in /State; said: .*'the door is closed'"):
            run.wait()
    assert '/State: the door is closed\n' in capfd.readouterr().err
