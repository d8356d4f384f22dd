# SPDX-License-Identifier: BSD-3-Clause
"""Which process this is: read once in each."""

import os

import pytest

from flexbt_common.liveness.process_identity import ProcessIdentity


def test_a_process_is_read_once_and_a_fork_is_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    own = ProcessIdentity.own()
    assert own is ProcessIdentity.own() and own.pid == os.getpid() and not own.has_ended()
    with monkeypatch.context() as fork:
        fork.setattr(os, 'getpid', lambda: own.pid + 1)
        assert ProcessIdentity.own().pid == own.pid + 1
    assert ProcessIdentity.own() == own
