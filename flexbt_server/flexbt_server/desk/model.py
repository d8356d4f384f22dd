# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool model``: what node types there are, for editors: a TreeNodesModel, or an XML schema."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from xml.sax.saxutils import escape, quoteattr

from flexbt_server.behavior_tree import NodeKind, NodeManifest, Port, builtin_registry
from flexbt_server.behavior_tree.ports import NO_DEFAULT
from flexbt_server.desk import arguments
from flexbt_server.desk.errors import ExitCode
from flexbt_server.desk.schema import schema_lines


def model_lines(manifests: Iterable[NodeManifest]) -> Iterator[str]:
    """A document with a TreeNodesModel, as Groot2 imports it."""
    yield '<?xml version="1.0" encoding="UTF-8"?>'
    yield '<root BTCPP_format="4">'
    yield '  <TreeNodesModel>'
    for manifest in manifests:
        yield from _model(manifest)
    yield '  </TreeNodesModel>'
    yield '</root>'


def _model(manifest: NodeManifest) -> Iterator[str]:
    head = f'{manifest.kind.value} ID={quoteattr(manifest.id)}'
    inner = [_port(name, port) for name, port in manifest.ports.items()]
    if manifest.description:
        text = quoteattr(' '.join(manifest.description.split()))
        inner += ['<MetadataFields>', f'  <Metadata description={text}/>', '</MetadataFields>']
    if not inner:
        yield f'    <{head}/>'
        return
    yield f'    <{head}>'
    yield from (f'      {line}' for line in inner)
    yield f'    </{manifest.kind.value}>'


def _port(name: str, port: Port) -> str:
    tag = f'{port.direction.value}_port'
    kind = '' if port.type is None else f' type={quoteattr(port.type.name)}'
    default = '' if port.default is NO_DEFAULT else f' default={quoteattr(str(port.default))}'
    return f'<{tag} name={quoteattr(name)}{kind}{default}>{escape(port.description)}</{tag}>'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--builtin', action='store_true', help='also the nodes of BehaviorTree.CPP, which Groot2 knows')
    parser.add_argument(
        '--xsd',
        action='store_true',
        help='an XML schema of tree files instead, of all node types, for any XML editor',
    )
    arguments.add_node_types(parser, allow_unknown=False)


def run(options: argparse.Namespace) -> ExitCode:
    registry = arguments.registry(options, allow_unknown=False)
    manifests = sorted(
        (manifest for manifest in registry if manifest.kind is not NodeKind.SUBTREE), key=lambda manifest: manifest.id
    )
    if options.xsd:
        lines = schema_lines(manifests)
    else:
        known = builtin_registry()
        lines = model_lines(manifest for manifest in manifests if options.builtin or manifest.id not in known)
    for line in lines:
        print(line)
    return ExitCode.OK
