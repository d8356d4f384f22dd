# SPDX-License-Identifier: BSD-3-Clause
"""The log of a node: nothing in it forges a line or fills a disk, and a reader that stalls does not stop the node."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rcl_interfaces.msg import Log
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from flexbt_common.runtime import NodeRuntime
from flexbt_common.runtime.node_log import NodeLogger
from flexbt_testing.waiting import wait_until

_TALKER = """
import logging, sys
from flexbt_common.runtime import run_node

def setup(runtime):
    log = runtime.node.get_logger()

    def talk():
        library = logging.getLogger('library')
        library.warning('%d of them', 'two')
        library.error('a \x1b[31mred text')
        for number in range(800):
            log.info(f'line {number} ' + 'x' * 80)
            print('printed', number)
        with open(sys.argv[1], 'w') as done:
            done.write('done')
        go_on()

    def go_on():
        log.warning('still there')
        print('still printing')
        runtime.post_in(0.05, go_on)

    runtime.post(talk)

sys.exit(run_node('talker', setup, []))
"""


@pytest.fixture
def runtime() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('logging') as runtime:
        yield runtime


@pytest.fixture
def logged(runtime: NodeRuntime) -> list[str]:
    """What the node says on /rosout, which is what it writes everywhere."""
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


def test_a_node_whose_output_nobody_reads_goes_on_and_counts_what_it_drops(tmp_path: Path) -> None:
    done = tmp_path / 'done'
    process = subprocess.Popen([sys.executable, '-c', _TALKER, done], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    try:
        wait_until(done.exists)  # and not a byte of it was read
        assert process.stdout is not None
        read = _read_until(
            process.stdout.fileno(), b' messages missing here: nobody read', b' lines dropped: nobody read'
        )
        assert b'line 0 ' in read
        assert b'[WARN]' in read and b'[talker]: library: %d of them (TypeError(' in read
        assert b'[talker]: library: a \\e[31mred text' in read
    finally:
        process.terminate()
        process.communicate(timeout=30.0)
    assert process.returncode == 0


def _read_until(file: int, *texts: bytes) -> bytes:
    read = b''
    end = time.monotonic() + 60.0
    while not all(text in read for text in texts):
        assert time.monotonic() < end, read[-1000:]
        if select.select([file], [], [], 1.0)[0]:
            read += os.read(file, 65536)
    return read
