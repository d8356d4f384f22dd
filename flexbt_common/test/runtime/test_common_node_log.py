# SPDX-License-Identifier: BSD-3-Clause
"""The log of a node: nothing in it forges a line or fills a disk, and a reader that stalls does not stop the node."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rcl_interfaces.msg import Log
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from flexbt_common.runtime.node_log import NodeLogger
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system.python_processes import logged_python_process
from flexbt_testing.waiting import wait_until

_TALKER = """
import logging, subprocess, sys
from flexbt_common.runtime.node_runtime import run_node

def setup(runtime):
    log, children = runtime.node.get_logger(), []

    def talk():
        library = logging.getLogger('library')
        library.warning('%d of them', 'two')
        library.error('a \x1b[31mred text')
        for number in range(120):
            log.info(f'line {number} ' + 'x' * 15_000)
            print('printed', number, 'y' * 15_000)
        children.append(subprocess.Popen(['sh', '-c', "head -c 200000 /dev/zero | tr '\\\\0' c"]))
        with open(sys.argv[1], 'w') as done:
            done.write('done')
        go_on()

    def go_on():
        log.warning(f'still there; the exit code of the child: {children[0].poll()}')
        print('still printing')
        runtime.post_in(0.05, go_on)

    runtime.post(talk)

sys.exit(run_node('talker', setup, []))
"""

_PRINTER = """
import sys
from flexbt_common.runtime.node_log import StandardStreams

with StandardStreams():
    for number in range(400):
        print(number, 'y' * 5_000)
    open(sys.argv[1], 'w').close()
    open(sys.argv[1] + '.read').close()
print('after')
"""


@pytest.fixture
def runtime() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('logging') as runtime:
        yield runtime


@pytest.fixture
def logged(runtime: NodeRuntime) -> list[str]:
    """Return what the node says on /rosout, which is what it writes everywhere."""
    heard: list[str] = []
    latched = QoSProfile(depth=1000, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)

    def listen() -> None:
        runtime.node.create_subscription(Log, '/rosout', lambda line: heard.append(line.msg), latched)

    runtime.call(listen)
    return heard


def test_what_others_have_written_neither_colours_nor_forges_a_line(runtime: NodeRuntime, logged: list[str]) -> None:
    runtime.node.get_logger().error('map \x1b[31mred\n[FATAL] [1.0] [executive]: forged \u202eback\r')
    runtime.node.get_logger().get_child('part').warning('a\x07b\n    c')
    wait_until(lambda: len(logged) >= 2)
    assert logged == [
        'map \\e[31mred\n    [FATAL] [1.0] [executive]: forged \\u{202e}back\\r',
        'a\\x07b\n    c',
    ]


def test_a_node_that_is_made_to_log_without_end_drops_messages_and_reports_it(
    runtime: NodeRuntime, logged: list[str]
) -> None:
    log = NodeLogger(runtime.node.get_logger().name, burst=2_000, rate=2_000)
    for number in range(1_000):
        log.info(f'{number:09}' + 'x' * 90)
    log.error('an error has an allowance of its own')
    wait_until(lambda: 'an error has an allowance of its own' in logged)
    assert len(logged) < 100

    def is_reported() -> bool:
        log.info('there is room again')
        return any('messages dropped: this node logged more than 2000 characters a second' in line for line in logged)

    wait_until(is_reported)


def test_two_severities_and_a_throttle_are_told_apart_by_the_place_that_logs(
    runtime: NodeRuntime, logged: list[str]
) -> None:
    log = runtime.node.get_logger()
    for number in range(5):
        log.warning(f'throttled {number}', throttle_duration_sec=60.0)
        log.error(f'every {number}')
    wait_until(lambda: 'every 4' in logged)
    assert logged == ['throttled 0', *(f'every {number}' for number in range(5))]


@pytest.mark.dds('another process takes part')
@pytest.mark.parametrize('kind', ['pipe', 'socket', 'terminal'])
def test_a_node_whose_output_nobody_reads_goes_on_and_its_children_wait(tmp_path: Path, kind: str) -> None:
    done = tmp_path / 'done'
    reading, writing = _ends(kind)
    process = logged_python_process(['-c', _TALKER, str(done)], writing)
    try:
        wait_until(done.exists)  # and not a byte of it was read
        assert os.get_blocking(writing)  # who has the output besides waits for its reader, as usual
        read = _read_until(
            reading,
            b' cut or missing here: nobody read',
            b' lines dropped: nobody read',
            b'the exit code of the child: 0',
        )
        assert b'line 0 ' in read and read.count(b'c') >= 200_000
        assert re.search(rb'\n(\x1b\[33m)?\[WARN\] \[[0-9.]+\] \[talker\]: [0-9]+ messages? cut or missing here', read)
        assert b'[WARN]' in read and b'[talker]: library: %d of them (TypeError(' in read
        assert b'[talker]: library: a \\e[31mred text' in read
        process.send_signal(signal.SIGTERM)
        while process.poll() is None:
            if select.select([reading], [], [], 0.01)[0]:
                os.read(reading, 65536)
        assert process.wait() == 0
    finally:
        process.kill()
        os.close(reading)
        os.close(writing)


@pytest.mark.dds('another process takes part')
def test_a_line_that_is_begun_is_ended_and_each_that_is_missing_is_counted(tmp_path: Path) -> None:
    full, read_fifo = tmp_path / 'full', tmp_path / 'full.read'
    os.mkfifo(read_fifo)
    reading, writing = os.pipe()
    process = logged_python_process(['-c', _PRINTER, str(full)], writing)
    os.close(writing)
    try:
        wait_until(full.exists)
        open(read_fifo, 'w').close()  # noqa: PTH123
        with os.fdopen(reading, 'rb') as output:
            *lines, last = output.read().decode().splitlines()
        printed = [line for line in lines if re.fullmatch('[0-9]+ y{5000}', line)]
        (dropped,) = [line for line in lines if line not in printed]
        assert dropped == f'... {400 - len(printed)} lines dropped: nobody read this output'
        assert (last, process.wait()) == ('after', 0)
    finally:
        process.kill()


def _ends(kind: str) -> tuple[int, int]:
    """Descriptors to read what is written to the other one."""
    if kind == 'socket':
        reading, writing = socket.socketpair()
        return reading.detach(), writing.detach()
    return os.pipe() if kind == 'pipe' else pty.openpty()


def _read_until(file: int, *texts: bytes) -> bytes:
    read = b''
    end = time.monotonic() + 60.0
    while not all(text in read for text in texts):
        assert time.monotonic() < end, read[-1000:]
        if select.select([file], [], [], 1.0)[0]:
            read += os.read(file, 65536)
    return read
