# SPDX-License-Identifier: BSD-3-Clause
"""Validates a document by an XML schema: the part of XSD 1.0 that the schema of tree files consists of."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.etree.ElementTree import Element, fromstring

XS = '{http://www.w3.org/2001/XMLSchema}'


class Schema:
    """A schema. What it cannot interpret raises."""

    def __init__(self, text: str) -> None:
        root = fromstring(text)  # noqa: S314
        self._named = {(child.tag.removeprefix(XS), child.get('name')): child for child in root}
        assert len(self._named) == len(root), 'a name is given twice'

    def errors(self, text: str) -> list[str]:
        """What is wrong with a document."""
        root = fromstring(text)  # noqa: S314
        declared = self._named.get(('element', root.tag))
        return [f'<{root.tag}> is not declared'] if declared is None else list(self._element(declared, root))

    def _element(self, declared: Element, element: Element) -> Iterator[str]:
        name = declared.get('type')
        kind = self._named['complexType', name] if name is not None else declared.find(f'{XS}complexType')
        assert kind is not None
        attributes = dict(self._attributes(kind))
        for name, attribute in attributes.items():
            value = element.get(name)
            if value is None:
                if attribute.get('use') == 'required':
                    yield f'<{element.tag}> lacks {name}'
            elif not self._fits(attribute.get('type', ''), value):
                yield f'<{element.tag}> has {name}="{value}"'
        if kind.find(f'{XS}anyAttribute') is None:
            yield from (f'<{element.tag}> has {name}' for name in element.keys() - attributes.keys())
        yield from self._content(kind, element)

    def _attributes(self, kind: Element) -> Iterator[tuple[str, Element]]:
        for child in kind:
            if child.tag == f'{XS}attribute':
                yield child.get('name', ''), child
            elif child.tag == f'{XS}attributeGroup':
                yield from self._attributes(self._named['attributeGroup', child.get('ref')])

    def _content(self, kind: Element, element: Element) -> Iterator[str]:
        particles = [child for child in kind if child.tag in (f'{XS}group', f'{XS}choice', f'{XS}sequence')]
        if not particles:
            yield from (f'<{element.tag}> contains <{child.tag}>' for child in element)
            return
        [particle] = particles
        if particle.tag == f'{XS}sequence':  # of anything
            assert [child.tag for child in particle] == [f'{XS}any']
            return
        group = self._named['group', particle.get('ref')].find(f'{XS}choice') if particle.get('ref') else particle
        assert group is not None
        least, most = int(particle.get('minOccurs', '1')), particle.get('maxOccurs', '1')
        if len(element) < least or (most != 'unbounded' and len(element) > int(most)):
            yield f'<{element.tag}> has {len(element)} children'
        choices = {choice.get('name'): choice for choice in group}
        assert len(choices) == len(group), 'a choice is not unique'
        for child in element:
            choice = choices.get(child.tag)
            if choice is None:
                yield f'<{element.tag}> contains <{child.tag}>'
            else:
                yield from self._element(choice, child)

    def _fits(self, type: str, value: str) -> bool:
        if type == 'xs:string':
            return True
        declared = self._named['simpleType', type]
        union = declared.find(f'{XS}union')
        if union is not None:
            return any(self._fits(member, value) for member in union.get('memberTypes', '').split())
        pattern = declared.find(f'{XS}restriction/{XS}pattern')
        assert pattern is not None
        return re.fullmatch(pattern.get('value', ''), value) is not None
