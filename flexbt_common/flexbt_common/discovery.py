# SPDX-License-Identifier: BSD-3-Clause
"""Settings of DDS discovery: the environment of this process before its first node, and of the processes it starts."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping, MutableMapping
from pathlib import Path
from typing import Final

from ament_index_python.packages import get_package_share_directory
from ament_index_python.search_paths import get_search_paths

RANGE: Final = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_IS_FASTDDS_3: Final = any(Path(prefix, 'lib', 'libfastdds.so').exists() for prefix in get_search_paths())
PROFILE: Final = 'FASTDDS_DEFAULT_PROFILES_FILE' if _IS_FASTDDS_3 else 'FASTRTPS_DEFAULT_PROFILES_FILE'
"""Variable that names the profile. Fast DDS 3 (ROS 2 Kilted) renamed it, its library, and an element of profiles."""


def profile(name: str) -> Path:
    """Return the path of an included Fast DDS profile: this_computer, network, radio_robot or radio_console."""
    directory = Path(get_package_share_directory('flexbt_common')) / 'config'
    return directory / ('fastdds3' if _IS_FASTDDS_3 else '') / f'{name}.xml'


def only_this_computer(environment: MutableMapping[str, str] = os.environ) -> None:
    """Set ``environment`` so that processes discover each other quickly, and only on this computer.

    This uses a profile without shared memory for Fast DDS, and the discovery range LOCALHOST for other middleware.
    """
    if environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp') == 'rmw_fastrtps_cpp':
        environment.update({RANGE: 'SYSTEM_DEFAULT', PROFILE: str(profile('this_computer'))})
    else:
        environment[RANGE] = 'LOCALHOST'


def check_loopback(environment: Mapping[str, str] = os.environ) -> None:
    """Raise OSError if the profile this_computer is set and no loopback interface is up: the processes would wait for
    each other silently."""
    if Path(environment.get(PROFILE, '')).name != 'this_computer.xml':
        return
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.settimeout(2.0)
        try:
            probe.bind(('127.0.0.1', 0))
            probe.connect(probe.getsockname())
            probe.send(b'.')
            probe.recv(1)
        except OSError as error:
            raise OSError(
                f'no loopback interface: a datagram to 127.0.0.1 does not arrive ({error}), and the processes find '
                'each other by it; have it brought up: ip link set lo up'
            ) from error
