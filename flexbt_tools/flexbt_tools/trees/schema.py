# SPDX-License-Identifier: BSD-3-Clause
"""An XML schema (XSD 1.0) of tree files in format 4.

Editors use it to complete and check nodes in compact form (``<Wait .../>``). A schema cannot make attributes depend on
an ``ID``, so it accepts any attribute in the explicit form (``<Action ID="Wait" .../>``) and in <SubTree>.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

from flexbt_core.behavior_tree.model.definition import PRE_POST_ATTRIBUTES, NodeManifest
from flexbt_core.behavior_tree.model.ports import BOOL, NO_DEFAULT, Port, PortType
from flexbt_core.behavior_tree.model.status import NodeKind
from flexbt_core.values.text import xml_attribute, xml_text

_EXPLICIT: Final = (NodeKind.ACTION, NodeKind.CONDITION, NodeKind.CONTROL, NodeKind.DECORATOR)
_METADATA: Final = ('_description', '_fullpath', '_uid')
_NAME: Final = re.compile(r'[^\W\d][\w.-]*')

_HEAD: Final = r"""<?xml version="1.0" encoding="UTF-8"?>
<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema">
  <xs:element name="root">
    <xs:complexType>
      <xs:choice minOccurs="0" maxOccurs="unbounded">
        <xs:element name="include">
          <xs:complexType>
            <xs:attribute name="path" type="xs:string" use="required"/>
            <xs:attribute name="ros_pkg" type="xs:string"/>
          </xs:complexType>
        </xs:element>
        <xs:element name="BehaviorTree">
          <xs:complexType>
            <xs:group ref="node"/>
            <xs:attribute name="ID" type="xs:string"/>
            <xs:anyAttribute processContents="skip"/>
          </xs:complexType>
        </xs:element>
        <xs:element name="TreeNodesModel">
          <xs:complexType>
            <xs:sequence>
              <xs:any minOccurs="0" maxOccurs="unbounded" processContents="skip"/>
            </xs:sequence>
            <xs:anyAttribute processContents="skip"/>
          </xs:complexType>
        </xs:element>
      </xs:choice>
      <xs:attribute name="BTCPP_format" type="xs:string" use="required"/>
      <xs:attribute name="main_tree_to_execute" type="xs:string"/>
      <xs:anyAttribute processContents="skip"/>
    </xs:complexType>
  </xs:element>
  <xs:simpleType name="pointer">
    <xs:restriction base="xs:string">
      <xs:pattern value=" *(\{.+\}|=) *"/>
    </xs:restriction>
  </xs:simpleType>
  <xs:simpleType name="integer">
    <xs:restriction base="xs:string">
      <xs:pattern value="-?[0-9].*"/>
    </xs:restriction>
  </xs:simpleType>
  <xs:simpleType name="real">
    <xs:restriction base="xs:string">
      <xs:pattern value="-?(\.?[0-9]|[iI][nN][fF]|[nN][aA][nN]).*"/>
    </xs:restriction>
  </xs:simpleType>
  <xs:simpleType name="bool">
    <xs:restriction base="xs:string">
      <xs:pattern value="0|1|true|True|TRUE|false|False|FALSE"/>
    </xs:restriction>
  </xs:simpleType>
  <xs:simpleType name="integer_or_pointer">
    <xs:union memberTypes="pointer integer"/>
  </xs:simpleType>
  <xs:simpleType name="real_or_pointer">
    <xs:union memberTypes="pointer real"/>
  </xs:simpleType>
  <xs:simpleType name="bool_or_pointer">
    <xs:union memberTypes="pointer bool"/>
  </xs:simpleType>"""


def schema_lines(manifests: Sequence[NodeManifest]) -> Iterator[str]:
    """Yield the schema of files with nodes of these types."""
    # A name that is not a valid element name can only be written in explicit form.
    manifests = [manifest for manifest in manifests if _NAME.fullmatch(manifest.id)]
    yield from _HEAD.splitlines()
    yield '  <xs:attributeGroup name="of_any_node">'
    for attribute in ('name', *sorted(PRE_POST_ATTRIBUTES), *_METADATA):
        yield f'    <xs:attribute name="{attribute}" type="xs:string"/>'
    yield '  </xs:attributeGroup>'
    yield '  <xs:group name="node">'
    yield '    <xs:choice>'
    for kind in _EXPLICIT:
        yield from _open_element(kind.value, children=True)
    yield from _open_element(NodeKind.SUBTREE.value, children=False)
    for manifest in manifests:
        yield f'      <xs:element name={xml_attribute(manifest.id)} type={xml_attribute(f"{manifest.id}_node")}/>'
    yield '    </xs:choice>'
    yield '  </xs:group>'
    for manifest in manifests:
        yield from _node_type(manifest)
    yield '</xs:schema>'


def _open_element(name: str, *, children: bool) -> Iterator[str]:
    yield f'      <xs:element name="{name}">'
    yield '        <xs:complexType>'
    if children:
        yield '          <xs:group ref="node" minOccurs="0" maxOccurs="unbounded"/>'
    yield '          <xs:attribute name="ID" type="xs:string" use="required"/>'
    yield '          <xs:anyAttribute processContents="skip"/>'
    yield '        </xs:complexType>'
    yield '      </xs:element>'


def _node_type(manifest: NodeManifest) -> Iterator[str]:
    yield f'  <xs:complexType name={xml_attribute(f"{manifest.id}_node")}>'
    if manifest.documentation:
        yield from _documentation(manifest.documentation, '    ')
    least, most = manifest.children
    if most != 0:
        bound = 'unbounded' if most is None else most
        yield f'    <xs:group ref="node" minOccurs="{least}" maxOccurs="{bound}"/>'
    for name, port in manifest.ports.items():
        if _NAME.fullmatch(name):
            yield from _port(name, port)
    yield '    <xs:attributeGroup ref="of_any_node"/>'
    yield '  </xs:complexType>'


def _port(name: str, port: Port) -> Iterator[str]:
    required = ' use="required"' if port.required else ''
    head = f'xs:attribute name={xml_attribute(name)} type="{_type_name(port)}"{required}'
    if not port.documentation and port.default is NO_DEFAULT:
        yield f'    <{head}/>'
        return
    default = '' if port.default is NO_DEFAULT else f' (default: {port.default})'
    yield f'    <{head}>'
    yield from _documentation(f'{port.documentation}{default}', '      ')
    yield '    </xs:attribute>'


def _type_name(port: Port) -> str:
    if not port.readable:
        return 'pointer'
    kind: PortType | None = port.literal or port.type
    if kind is BOOL:
        return 'bool_or_pointer'
    if kind is not None and kind.category in ('integer', 'real'):
        return f'{kind.category}_or_pointer'
    return 'xs:string'


def _documentation(text: str, indent: str) -> Iterator[str]:
    shown = xml_text(' '.join(text.split()))
    yield f'{indent}<xs:annotation><xs:documentation>{shown}</xs:documentation></xs:annotation>'
