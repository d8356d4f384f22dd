# SPDX-License-Identifier: BSD-3-Clause
"""``flexbt doctor``: what is wrong with this computer and this robot, how one sees it, and what to do.

Each check yields findings. It never changes anything.
"""

from __future__ import annotations

import math
import os
import shutil
import socket
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum
from importlib.metadata import distributions
from itertools import chain
from pathlib import Path
from typing import Any, Final, NamedTuple

from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState

from flexbt_common import names
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.errors import TransformError
from flexbt_common.files import USER_DIRECTORY, home_path
from flexbt_common.interfaces import CONSOLES, RECORDERS
from flexbt_common.middleware.fastdds import FAST_DDS
from flexbt_common.middleware.implementation import ZENOH, implementation, losses
from flexbt_common.names import node_of
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.transform_listener import TransformListener
from flexbt_core.values.text import did_you_mean, pluralize
from flexbt_msgs.msg import ExecutiveStatus
from flexbt_onboard.link.robot_state import POSE_TYPES

from .graph import Graph, observe, parameters

OURS: Final = (names.BT_SERVER, names.ONBOARD_EXECUTIVE, names.STOP_GUARD)
"""Nodes of FlexBT that a robot runs."""
NAV2_ACTIONS: Final = (
    *chain.from_iterable(names.ACTIONS_OF_SERVERS.values()),
    names.NAVIGATE_TO_POSE,
    names.NAVIGATE_THROUGH_POSES,
    names.FOLLOW_WAYPOINTS,
)
"""Actions of Nav2. Their types are in nav2_msgs/action, and have the same names in camel case."""
NEEDED: Final = (names.COMPUTE_PATH_TO_POSE, names.FOLLOW_PATH)
"""Actions without which no tree of ours drives."""
STAMPED: Final = 'geometry_msgs/msg/TwistStamped'
"""Type of velocity commands if enable_stamped_cmd_vel is true."""
LITTLE_DISK: Final = 500_000_000
"""Free bytes below which a disk counts as nearly full."""
BUFFER: Final = 4_194_304
"""Receive buffer of the network that large messages need, bytes."""
MOST_OFFSET: Final = 0.5
"""Largest difference between the clocks of two computers, s."""
PATIENCE: Final = 3.0
"""Time for an answer after which a node counts as hanging, s."""
OLD_TRANSFORM: Final = 2.0
"""Age at which the newest transform of the robot is too old, s."""
MOST_DOMAIN: Final = 232
"""The last domain that has ports."""
SHARED_DOMAINS: Final = range(102, 215)
"""Domains whose ports are among those that Linux gives to connections (net.ipv4.ip_local_port_range)."""
ROUTER: Final = '127.0.0.1', 7447
"""Address at which nodes look for the router of Zenoh, unless they are told otherwise."""


class Level(Enum):
    """The weight of a finding."""

    OK = 'ok'
    WARNING = 'warning'
    ERROR = 'error'


class Finding(NamedTuple):
    """The result of a check: what is so, and what to do about it; '' if nothing."""

    level: Level
    what: str
    remedy: str = ''
    check: str = ''


def ok(what: str) -> Finding:
    return Finding(Level.OK, what)


def warning(what: str, remedy: str) -> Finding:
    return Finding(Level.WARNING, what, remedy)


def error(what: str, remedy: str) -> Finding:
    return Finding(Level.ERROR, what, remedy)


def _of(check: str, findings: Iterable[Finding]) -> Iterator[Finding]:
    """Yield the findings with the name of their check."""
    return (one._replace(check=check) for one in findings)


# This computer.


def machine_findings(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Check what needs no other node: middleware, versions, environment, disks, buffers."""
    yield from _of('middleware', _middleware(environment))
    if implementation() == ZENOH:
        yield from _of('router', router_findings(environment))
    yield from _of('versions', _versions())
    yield from _of('domain', _domain(environment))
    yield from _of('reach', _reach(environment))
    yield from _of('disk', _disks(environment))
    shared = Path('/dev/shm')  # noqa: S108 - where Fast DDS has its memory
    yield from _of('buffers', _buffers(Path('/proc/sys/net/core/rmem_max'), shared))


def _middleware(environment: Mapping[str, str]) -> Iterator[Finding]:
    distribution = environment.get('ROS_DISTRO', 'without ROS_DISTRO')
    yield ok(f'{implementation()}, ROS 2 {distribution}, Python {sys.version.split()[0]}')
    if lost := '; '.join(losses()):
        remedy = f'nothing, if that is acceptable; else set RMW_IMPLEMENTATION={FAST_DDS} on all computers'
        yield warning(f'{implementation()}: {lost}', remedy)


def router_findings(environment: Mapping[str, str], address: tuple[str, int] = ROUTER) -> Iterator[Finding]:
    """Check that nodes reach the router of Zenoh, without which they do not discover each other."""
    if told := [name for name in ('ZENOH_SESSION_CONFIG_URI', 'ZENOH_CONFIG_OVERRIDE') if environment.get(name)]:
        yield ok(f'where it is depends on {" and ".join(told)}; not checked')
        return
    where = f'{address[0]}:{address[1]}'
    try:
        socket.create_connection(address, 1.0).close()
    except OSError as problem:
        remedy = 'ros2 run rmw_zenoh_cpp rmw_zenohd, on each computer; connect these routers to each other'
        yield error(f'no router of Zenoh at {where} ({problem.strerror or problem})', remedy)
        return
    yield ok(f'there is a router at {where}')


def _versions() -> Iterator[Finding]:
    versions: dict[str, list[str]] = {}
    for one in distributions():
        name = (one.metadata['Name'] or '').replace('-', '_')
        if name.startswith('flexbt_'):
            versions.setdefault(one.version, []).append(name)
    if len(versions) > 1:
        told = '; '.join(f'{version}: {", ".join(sorted(packages))}' for version, packages in sorted(versions.items()))
        yield error(f'packages of FlexBT have different versions: {told}', 'build all of them anew')
    elif versions:
        (version,) = versions
        yield ok(f'FlexBT {version}')


def _domain(environment: Mapping[str, str]) -> Iterator[Finding]:
    domain = environment.get('ROS_DOMAIN_ID', '') or '0'
    remedy = 'use a number from 0 to 101, the same on all computers'
    if not domain.isdecimal() or int(domain) > MOST_DOMAIN:
        yield error(f'ROS_DOMAIN_ID={domain}', remedy)
    elif int(domain) in SHARED_DOMAINS:
        yield warning(f'ROS_DOMAIN_ID={domain}: its ports may be taken by connections of this computer', remedy)
    else:
        yield ok(f'ROS_DOMAIN_ID {domain}')


def _reach(environment: Mapping[str, str]) -> Iterator[Finding]:
    reach = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE') or 'SUBNET'
    peers = environment.get('ROS_STATIC_PEERS', '')
    only_here = ['ROS_LOCALHOST_ONLY=1'] if environment.get('ROS_LOCALHOST_ONLY') == '1' else []
    if reach not in ('SUBNET', 'SYSTEM_DEFAULT', 'OFF'):  # rcl takes any other value for LOCALHOST
        only_here.append(f'ROS_AUTOMATIC_DISCOVERY_RANGE={reach}')
    if only_here:
        yield warning(
            f'nodes of other computers are not found ({", ".join(only_here)})',
            'for a robot and a laptop: unset ROS_LOCALHOST_ONLY, and set ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET',
        )
    elif reach == 'OFF':
        yield warning(f'ROS_AUTOMATIC_DISCOVERY_RANGE={reach}: no node is found', 'unset it, or set it to SUBNET')
    else:
        yield ok(f'discovery range {reach}{f", and {peers}" if peers else ""}')


def _disks(environment: Mapping[str, str]) -> Iterator[Finding]:
    logs = home_path(environment.get('ROS_LOG_DIR') or f'{environment.get("ROS_HOME") or "~/.ros"}/log')
    places = [('event log and recordings', home_path(USER_DIRECTORY), 'HOME'), ('logs of ROS', logs, 'ROS_LOG_DIR')]
    for use, place, variable in places:
        existing = next(one for one in (place, *place.parents) if os.access(one, os.F_OK))
        free = shutil.disk_usage(existing).free
        if not (existing.is_dir() and os.access(existing, os.W_OK)):
            what = 'cannot be written' if existing.is_dir() else 'is not a directory'
            yield error(f'{existing} ({use}) {what}', f'set {variable} to a directory that this user may write')
        elif free < LITTLE_DISK:
            remedy = 'remove old files; event_log_size, event_log_files and btlog_keep bound those of FlexBT'
            yield warning(f'{place} ({use}) has {free / 1e6:.0f} MB left', remedy)
        else:
            yield ok(f'{place} ({use}) has {free / 1e9:.1f} GB left')


def _buffers(receive: Path, shared: Path) -> Iterator[Finding]:
    try:
        size = int(receive.read_text(encoding='ascii'))
    except (OSError, ValueError):  # not Linux, or a container that hides it
        size = BUFFER
    if size < BUFFER:
        yield warning(
            f'net.core.rmem_max is {size} bytes: large messages (maps, images) get lost on a network',
            f'sudo sysctl -w net.core.rmem_max={BUFFER}, and write it into /etc/sysctl.d/60-ros.conf',
        )
    else:
        yield ok('the receive buffer of the network is large enough')
    if shared.exists():
        free = shutil.disk_usage(shared).free
        if free < 64_000_000:
            yield warning(
                f'{shared} has {free / 1e6:.0f} MB left: Fast DDS falls back to the network',
                f'remove files of dead processes (rm {shared}/fastrtps_*); in a container set --shm-size=512m',
            )


# The robot.


class RobotCheck:
    """The checks of one robot. ``namespace`` is that of its nodes and of the node of ``runtime``: '' or ``/robot1``."""

    def __init__(self, runtime: NodeRuntime, namespace: str, seconds: float) -> None:
        self._runtime = runtime
        self._namespace = namespace
        self._seconds = seconds
        self._status: list[tuple[float, ExecutiveStatus]] = []
        self._graph: Graph
        self._frames = 'map', 'base_link'
        self._pose_topic: str = names.POSE
        self._cmd_vel_topic: str = names.CMD_VEL

    def _name(self, name: str) -> str:
        return name if name.startswith('/') else f'{self._namespace}/{name}'

    def findings(self) -> Iterator[Finding]:
        """Check discovery, nodes, clocks, transforms, servers, topics and the offset of the robot's clock."""
        node = self._runtime.node
        qos = names.transient_local_qos()
        self._runtime.call(
            lambda: node.create_subscription(
                ExecutiveStatus,
                self._name(names.EXECUTIVE_STATUS),
                lambda status: self._status.append((time.time(), status)),
                qos,
            )
        )
        listener = self._runtime.call(lambda: TransformListener.of(self._runtime))
        self._graph = observe(self._runtime, self._seconds)
        yield from _of('discovery', self._discovery())
        if not self._graph.nodes:
            return
        asked = [name for name in dict.fromkeys(self._graph.nodes) if f'{name}/get_parameters' in self._graph.services]
        answers = parameters(self._runtime, asked, 'use_sim_time', PATIENCE)
        simulated = {node: value for node, value in answers.items() if value is not None}  # nodes of micro-ROS lack it
        yield from _of('nodes', self._nodes([node for node in asked if node not in answers]))
        yield from _of('clock', self._clocks(simulated))
        self._read_settings()
        transforms = list(self._transforms(listener, any(simulated.values())))
        yield from _of('transforms', transforms)
        yield from _of('pose', self._poses(transforms[-1].level is Level.OK))
        yield from _of('velocity', self._velocities())
        yield from _of('servers', self._servers())
        yield from _of('topics', self._topics())
        yield from _of('link', self._offset(simulated))

    def _read_settings(self) -> None:
        """Read the topics and frames of the executive, which stops the robot; without it, these are its defaults."""
        executive = self._name(names.ONBOARD_EXECUTIVE)
        if executive not in self._graph.nodes:
            return

        def setting(name: str, default: str) -> str:
            value = parameters(self._runtime, [executive], name, PATIENCE).get(executive)
            return default if value is None else str(value)

        self._frames = setting('global_frame', self._frames[0]), setting('robot_base_frame', self._frames[1])
        self._pose_topic = setting('pose_topic', self._pose_topic)
        self._cmd_vel_topic = setting('cmd_vel_topic', self._cmd_vel_topic)

    def _discovery(self) -> Iterator[Finding]:
        graph = self._graph
        if not graph.nodes:
            yield error(
                f'no other node was found within {self._seconds:g} s',
                'start the robot; check that ROS_DOMAIN_ID and RMW_IMPLEMENTATION are the same on both computers, and '
                'that the network passes multicast (else set ROS_STATIC_PEERS to the address of the robot)',
            )
            return
        yield ok(f'{pluralize(len(graph.nodes), "node")} found')
        for name in graph.duplicates:
            if name.rpartition('/')[2] not in CONSOLES:  # each operator, page and alert service is one
                yield error(f'several nodes are called {name}', 'stop the ones that were left running')
        in_namespace = [name for name in graph.nodes if name.startswith(f'{self._namespace}/')]
        if self._namespace and not in_namespace:
            spaces = sorted({name.rpartition('/')[0] for name in graph.nodes if name.count('/') > 1})
            near = did_you_mean(self._namespace, spaces, f'; there is {", ".join(spaces) or "none"}')
            yield error(f'no node is in the namespace {self._namespace}', f'check --namespace{near}')

    def _nodes(self, silent: Sequence[str]) -> Iterator[Finding]:
        """``silent`` are nodes that do not answer."""
        if silent:
            yield error(f'{_few(silent)} did not answer a request for a parameter', 'restart it: it hangs')
        links = self._runtime.call(lambda: ServiceLinks(self._runtime))
        for name in OURS:
            full = self._name(name)
            if full not in self._graph.nodes:
                other = [one for one in self._graph.nodes if one.endswith(f'/{name}')]
                there = f'; there is {", ".join(other)}: use --namespace' if other else ''
                yield warning(f'{full} does not run{there}', 'ros2 launch flexbt_bringup robot.launch.py')
                continue
            if f'{full}/get_state' not in self._graph.services:
                yield ok(f'{full} runs')
                continue
            outcome = service_outcome(links.link(GetState, f'{full}/get_state'), GetState.Request(), PATIENCE)
            if outcome.response is None:
                yield error(f'{full} does not answer: {outcome.reason}', 'restart it; its log says why it hangs')
            elif outcome.response.current_state.id != State.PRIMARY_STATE_ACTIVE:
                label = outcome.response.current_state.label
                yield error(
                    f'{full} is {label}, not active',
                    f'ros2 lifecycle set {full} configure, then activate; its log says why it did not start',
                )
            else:
                yield ok(f'{full} is active')

    def _clocks(self, simulated: Mapping[str, Any]) -> Iterator[Finding]:
        yes = [node for node, value in simulated.items() if value]
        clocks = {node_of(one) for one in self._graph.publishers.get(names.CLOCK, ())}
        no = [node for node, value in simulated.items() if not value and node not in clocks]
        if yes and not clocks:
            yield error(
                f'use_sim_time is true for {_few(yes)}, and nobody publishes {names.CLOCK}: their time stands still',
                'set use_sim_time to false on a real robot, or start the simulation',
            )
        elif yes and no:
            few, value = (no, 'true') if len(no) <= len(yes) else (yes, 'false')
            yield error(
                f'use_sim_time is true for {_few(yes)} and false for {_few(no)}: stamps do not fit each other',
                f'set use_sim_time to {value} for {_few(few)}',
            )
        elif clocks and no:
            yield warning(
                f'{names.CLOCK} is published, and use_sim_time is false for {_few(no)}',
                'set use_sim_time to true for them, or stop what publishes the clock',
            )
        elif simulated:
            yield ok('all nodes use simulated time' if yes else "all nodes use the computers' clocks")

    def _transforms(self, listener: TransformListener, is_simulated: bool) -> Iterator[Finding]:
        for topic in (names.TF, names.TF_STATIC):
            if not self._graph.is_published(self._name(topic)):
                yield warning(
                    f'nobody publishes {self._name(topic)}',
                    'start the localization and robot_state_publisher; in a namespace remap /tf to tf',
                )
        end = time.monotonic() + self._seconds
        world, robot = self._frames
        while True:
            try:
                moment = self._runtime.call(lambda: self._newest(listener))
                break
            except TransformError as unknown:
                if time.monotonic() >= end:
                    yield error(
                        f'no pose of {robot} in {world}: {unknown}',
                        'start the localization and robot_state_publisher; if frames have other names, set '
                        'global_frame and robot_base_frame for all nodes of FlexBT',
                    )
                    return
                time.sleep(0.05)
        age = time.time() - moment
        if not is_simulated and math.isfinite(moment) and age > OLD_TRANSFORM:
            yield error(
                f'the newest transform from {world} to {robot} is {age:.1f} s old',
                'check that the localization runs, and that the clocks of all computers are the same (chrony)',
            )
        else:
            yield ok(f'{robot} is known in {world}')

    def _newest(self, listener: TransformListener) -> float:
        listener.buffer.lookup(*self._frames)
        return listener.buffer.latest(*self._frames)

    def _poses(self, has_transform: bool) -> Iterator[Finding]:
        """``has_transform`` is True if the transforms have a pose that is up to date."""
        sources = [self._name(topic) for topic in dict.fromkeys((self._pose_topic, names.AMCL_POSE, names.ODOM))]
        found = ['the transforms'] if has_transform else []
        for topic in sources:
            types = sorted({one.topic_type for one in self._graph.publishers.get(topic, ())})
            if POSE_TYPES.keys() & types:
                found.append(topic)
            elif types:
                yield error(
                    f'{topic} has the type {", ".join(types)}, expected {", ".join(POSE_TYPES)}',
                    'set pose_topic to the topic that has the pose',
                )
        if found:
            yield ok(f'the pose of the robot comes from {", ".join(found)}')
        else:
            yield warning(
                f'there is no transform, and nobody publishes {", ".join(sources)}: nobody notices that the robot '
                'moves after a STOP',
                'start the localization or the odometry, or set pose_topic to the topic that has the pose',
            )

    def _velocities(self) -> Iterator[Finding]:
        topic = self._name(self._cmd_vel_topic)
        ours = {self._name(name) for name in (*OURS, *RECORDERS)}
        bases = [one for one in self._graph.subscriptions.get(topic, ()) if node_of(one) not in ours]
        if not bases:
            yield warning(
                f'nobody listens to {topic}: a STOP cannot command zero velocity',
                'start the base, or set cmd_vel_topic to the topic that it listens to',
            )
            return
        taken = sorted({one.topic_type for one in bases})
        needed = str(STAMPED in taken).lower()
        senders = [one for one in self._graph.publishers.get(topic, ()) if node_of(one) in ours]
        deaf = sorted({node_of(one) for one in senders if one.topic_type not in taken})
        for node in deaf:
            yield error(
                f'{_few(sorted({node_of(one) for one in bases}))} takes {", ".join(taken)} on {topic}, and {node} '
                'sends another type: a STOP cannot command zero velocity',
                f'set enable_stamped_cmd_vel to {needed} for {node}, and restart it',
            )
        if not deaf:
            yield ok(f'{topic} takes {", ".join(taken)}, as with enable_stamped_cmd_vel: {needed}')

    def _servers(self) -> Iterator[Finding]:
        actions = self._graph.actions
        served = [name for name in NAV2_ACTIONS if self._name(name) in actions]
        for name in served:
            short = 'BackUp' if name == names.BACKUP else name.title().replace('_', '')
            types, wanted = actions[self._name(name)], f'nav2_msgs/action/{short}'
            if types != (wanted,):  # a leaf that calls a server of another type adds its own
                yield error(
                    f'{self._name(name)} has the type {", ".join(types)}, expected {wanted}',
                    'give trees the name of another server (server_name), or use CallAction with its type',
                )
        for name in NEEDED:
            if self._name(name) not in actions:
                others = [one for one in actions if one.endswith(f'/{name}')]
                there = f'; there is {", ".join(others)}' if others else ''
                yield warning(
                    f'there is no action {self._name(name)}: trees that drive fail{there}',
                    "start Nav2's servers, or use names of your own (flexbt manifest --from-graph)",
                )
        if served:
            yield ok(f'{pluralize(len(served), "action")} of Nav2')

    def _topics(self) -> Iterator[Finding]:
        bad = 0
        for topic, types in self._graph.topics.items():
            if len(types) > 1 and topic != self._name(self._cmd_vel_topic):
                bad += 1
                users = {node_of(one) for one in (*self._graph.publishers[topic], *self._graph.subscriptions[topic])}
                yield error(
                    f'{topic} has several types: {", ".join(types)} ({_few(sorted(users))})',
                    'give one of the two topics another name',
                )
        for topic, publisher, subscriber, reason in self._graph.misfits():
            bad += 1
            yield error(f'{subscriber} hears nothing of {publisher} on {topic}', reason)
        if not bad:
            yield ok(f'{pluralize(len(self._graph.topics), "topic")}: types and qualities of service fit')

    def _offset(self, simulated: Mapping[str, Any]) -> Iterator[Finding]:
        executive = self._name(names.ONBOARD_EXECUTIVE)
        if executive not in self._graph.nodes or simulated.get(executive, True):
            return
        end = time.monotonic() + self._seconds
        while len(self._status) < 2 and time.monotonic() < end:
            time.sleep(0.05)
        late = [received - status.stamp.sec - status.stamp.nanosec * 1e-9 for received, status in self._status[1:]]
        if not late:
            yield error(
                f'no status of {executive} within {self._seconds:g} s',
                'check that both computers have the same FlexBT, and that the network passes UDP',
            )
            return
        offset = min(late)
        if abs(offset) > MOST_OFFSET:
            yield warning(
                f"the robot's clock differs by {-offset:.1f} s from that of this computer",
                'synchronize both (chrony or systemd-timesyncd): stamps of poses and transforms do not fit else',
            )
        else:
            yield ok(f'the status of the robot arrives, {max(0.0, offset) * 1000:.0f} ms after it was sent')


def _few(nodes: Sequence[str], most: int = 4) -> str:
    more = f' and {len(nodes) - most} more' if len(nodes) > most else ''
    return f'{", ".join(nodes[:most])}{more}'
