# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``security_policy``: an SROS2 policy for the robot, its operators and its observers, as XML.

``ros2 security generate_artifacts -k KEYSTORE -p FILE`` takes it (https://docs.ros.org/en/jazzy/Concepts/Intermediate/About-Security.html).
The format is version 0.2.0 of sros2's ``policy.xsd``.
"""

from __future__ import annotations

import argparse
import itertools
import re
import sys
from collections.abc import Iterator, Sequence
from typing import Final
from xml.etree import ElementTree

from flexbt_common.command_line import SuggestingArgumentParser, run_program
from flexbt_common.interfaces import INTERFACES, ROLES, InterfaceKind
from flexbt_tools.errors import ExitCode

OFFERING: Final = {InterfaceKind.TOPIC: 'publish', InterfaceKind.SERVICE: 'reply', InterfaceKind.ACTION: 'execute'}
USING: Final = {InterfaceKind.TOPIC: 'subscribe', InterfaceKind.SERVICE: 'request', InterfaceKind.ACTION: 'call'}
"""Permission elements of a policy, by kind of interface."""

_NAMESPACE: Final = re.compile(r'/|(/[A-Za-z_][A-Za-z0-9_]*)+')


def permissions(node: str) -> Iterator[tuple[InterfaceKind, str, list[str]]]:
    """Yield the permissions of a node as (kind, policy element, sorted names), each kind and element once."""
    for kind, (words, role) in itertools.product(InterfaceKind, ((OFFERING, 'offered_by'), (USING, 'used_by'))):
        allowed = sorted({one.name for one in INTERFACES if one.kind is kind and node in getattr(one, role)})
        if allowed:
            yield kind, words[kind], allowed


def policy(namespaces: Sequence[str]) -> ElementTree.Element:
    """Return the policy of robots in these namespaces: an enclave ``NAMESPACE/ROLE`` for each namespace and role."""
    root = ElementTree.Element('policy', version='0.2.0')
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for namespace, (role, nodes) in itertools.product(namespaces, ROLES.items()):
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=f'{namespace.rstrip("/")}/{role}')
        profiles = ElementTree.SubElement(enclave, 'profiles')
        for node in nodes:
            profile = ElementTree.SubElement(profiles, 'profile', ns=namespace, node=node)
            for kind, word, allowed in permissions(node):
                rule = ElementTree.SubElement(profile, f'{kind.value}s', {word: 'ALLOW'})
                for name in allowed:
                    ElementTree.SubElement(rule, kind.value).text = name
    return root


def _namespace(text: str) -> str:
    if not _NAMESPACE.fullmatch(text):
        raise argparse.ArgumentTypeError(f'{text!r} is not an absolute namespace; write it as /robot1')
    return text


def main(words: Sequence[str] | None = None) -> int:
    """Run ``security_policy`` and return its exit code."""
    return run_program('security_policy', lambda: _write(words))


def _write(words: Sequence[str] | None) -> int:
    parser = SuggestingArgumentParser(prog='security_policy', description='An SROS2 policy for robots, as XML.')
    parser.add_argument(
        'namespaces',
        nargs='*',
        type=_namespace,
        metavar='NAMESPACE',
        help='namespace of a robot, such as /robot1 (default: /)',
    )
    root = policy(parser.parse_args(words).namespaces or ['/'])
    ElementTree.indent(root)
    sys.stdout.write('<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding='unicode') + '\n')
    return ExitCode.OK
