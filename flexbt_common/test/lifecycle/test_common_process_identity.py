# SPDX-License-Identifier: BSD-3-Clause
"""Which process this is: read once in each."""

import os
import resource
import subprocess
import sys

import pytest

from flexbt_common.lifecycle.liveliness import ProcessIdentity


@pytest.mark.dds('processes of the system are told apart')
def test_a_process_is_read_once_and_a_fork_is_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    own = ProcessIdentity.own()
    assert own is ProcessIdentity.own() and own.pid == os.getpid() and not own.has_ended()
    with monkeypatch.context() as fork:
        fork.setattr(os, 'getpid', lambda: own.pid + 1)
        assert ProcessIdentity.own().pid == own.pid + 1
    assert ProcessIdentity.own() == own


@pytest.mark.dds('processes of the system are told apart')
def test_out_of_file_descriptors_nobody_is_taken_for_ended() -> None:
    own, held = ProcessIdentity.own(), []
    with subprocess.Popen([sys.executable, '-c', ''], stdin=subprocess.PIPE) as ended:
        gone = ProcessIdentity(own.host, ended.pid, '1')
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(limits[0], 1024), limits[1]))
    try:
        with pytest.raises(OSError, match='Too many open files'):
            while True:
                held.append(os.dup(0))
        has_ended = own.has_ended()
    finally:
        for file in held:
            os.close(file)
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert not has_ended and gone.has_ended()
