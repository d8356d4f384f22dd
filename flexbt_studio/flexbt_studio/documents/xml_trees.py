# SPDX-License-Identifier: BSD-3-Clause
"""The trees of an XML text as a graph, with a path for each node.

A node has a path: ``TREE/0`` is the root of a tree, ``TREE/0/2`` the third child of the root. ``TREE`` alone is the
tree, and ``''`` the element <root>. TREE is the ID of the tree. A tree without ID, with the ID of an earlier tree, or
with a ``/`` in its ID, or ``#`` before it, is called ``#N`` instead: the N-th tree of the file, from 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cached_property, lru_cache
from typing import Any, Final

from flexbt_core.behavior_tree.model.definition import tree_name_problem
from flexbt_core.behavior_tree.model.errors import ConversionError
from flexbt_core.behavior_tree.model.ports import bool_from_text, pointer_key
from flexbt_core.behavior_tree.xml.format3 import is_format_3
from flexbt_core.behavior_tree.xml.node_elements import NodeTypes
from flexbt_core.behavior_tree.xml.parser import unescape
from flexbt_core.values.text import did_you_mean, pluralize, short_repr
from flexbt_server.node_types import node_registry
from flexbt_studio.errors import GestureError

from .document import Document, Problem
from .text import LINE_BREAK, Span, TextEdit, applied
from .xml_keys import SUBTREES, KeyReader, node_type
from .xml_layout import Layout, Written
from .xml_spans import XmlElement

_PATH: Final = re.compile(r'([^/]*)((?:/[0-9]{1,7})*)')
PORT_TAGS: Final = {'input': 'input_port', 'output': 'output_port', 'inout': 'inout_port'}
_DIRECTIONS: Final = {tag: direction for direction, tag in PORT_TAGS.items()}


@lru_cache(maxsize=1)
def _installed_types() -> NodeTypes:
    return node_registry(lambda nodes, error: None)


class TreesInXml(Document):
    """The trees of an XML text as a graph, with what the edits of it need.

    ``types`` tells how many children nodes have, and which ports are scripts or keys; None for the installed node
    types.
    """

    language = 'xml'

    def __init__(self, text: str, file: str = '', types: NodeTypes | None = None) -> None:
        super().__init__(text, file)
        self._types = types

    @cached_property
    def types(self) -> NodeTypes:
        """The node types that are known."""
        return _installed_types() if self._types is None else self._types

    @cached_property
    def layout(self) -> Layout:
        """The elements of the text."""
        return Layout(self.text)

    @property
    def problems(self) -> list[Problem]:
        return self.layout.problems

    @cached_property
    def is_old(self) -> bool:
        """Whether the text is of format 3."""
        root = self._root
        return root is not None and is_format_3(root)

    @property
    def _root(self) -> XmlElement | None:
        tops = self.layout.tops
        return tops[0] if tops and tops[0].tag == 'root' else None

    def sections(self, tag: str) -> list[XmlElement]:
        """Return the elements of <root> with this tag."""
        return [] if self._root is None else [child for child in self._root.children if child.tag == tag]

    @cached_property
    def trees(self) -> dict[str, XmlElement]:
        """The <BehaviorTree> elements by the first part of the paths of their nodes."""
        found: dict[str, XmlElement] = {}
        for number, tree in enumerate(self.sections('BehaviorTree'), 1):
            id = tree.attributes.get('ID', '')
            is_usable = id and not id.startswith('#') and '/' not in id and id not in found
            found[id if is_usable else f'#{number}'] = tree
        return found

    @cached_property
    def subtrees(self) -> list[XmlElement]:
        """The sub-trees that the trees of this file use, in document order."""
        return [one for tree in self.trees.values() for one in tree.all() if one.tag in SUBTREES]

    def definition(self, id: str | None) -> XmlElement | None:
        """Return the tree that this ID means in this file: the last one; None if none has it."""
        return next((one for one in reversed(self.trees.values()) if one.attributes.get('ID', '') == id), None)

    def path_of(self, tree: XmlElement) -> str:
        """Return the path of a tree."""
        return next(path for path, one in self.trees.items() if one is tree)

    @cached_property
    def keys(self) -> KeyReader:
        """The reader of the keys that nodes name."""
        defaults: dict[str, list[tuple[str, str]]] = {}
        for model in self.models:
            for port in model.children if model.tag == 'SubTree' else ():
                name = port.attributes.get('name', '')
                key = pointer_key(port.attributes.get('default', ''), name)
                if key is not None and port.tag in PORT_TAGS.values():
                    defaults.setdefault(model.attributes.get('ID', ''), []).append((name, key))
        return KeyReader(self.text, self.types, defaults, bare=self.is_old)

    @cached_property
    def models(self) -> list[XmlElement]:
        """The elements of <TreeNodesModel>."""
        return [model for section in self.sections('TreeNodesModel') for model in section.children]

    # View.

    @cached_property
    def _view(self) -> dict[str, Any]:
        root = self._root
        return {
            'language': self.language,
            'format': '' if root is None else root.attributes.get('BTCPP_format', '3' if self.is_old else '4'),
            'main': '' if root is None else root.attributes.get('main_tree_to_execute', ''),
            'includes': [
                {**_values(one, path='path', package='ros_pkg'), 'span': [one.offset, one.end]}
                for one in self.sections('include')
            ],
            'models': [self._view_of_model(model) for model in self.models],
            'trees': [
                {
                    'id': tree.attributes.get('ID', ''),
                    'path': path,
                    'span': [tree.offset, tree.end],
                    'id_span': [*self.value_span(tree, 'ID')],
                    **self._view_of_comments(tree),
                }
                for path, tree in self.trees.items()
            ],
            'nodes': [*self._view_of_nodes()],
        }

    def _view_of_nodes(self) -> Iterator[dict[str, Any]]:
        for label, tree in self.trees.items():
            pending: list[tuple[str, str | None, XmlElement]] = []
            pending += [(f'{label}/{index}', None, child) for index, child in enumerate(tree.children)][::-1]
            while pending:
                path, parent, element = pending.pop()
                yield {
                    'path': path,
                    'tree': label,
                    'parent': parent,
                    'tag': element.tag,
                    'type': node_type(element),
                    'name': element.attributes.get('name', ''),
                    'span': [element.offset, element.end],
                    'open': [element.offset, element.open_end],
                    'attributes': [part.view(name) for name, part in element.parts.items()],
                    'collapsed': _is_true(element.attributes.get('_collapsed', '')),
                    'fault': element.fault,
                    **self._view_of_comments(element),
                }
                below = enumerate(nodes_of(element))
                pending += [(f'{path}/{index}', path, child) for index, child in below][::-1]

    def _view_of_comments(self, element: XmlElement) -> dict[str, Any]:
        layout = self.layout
        within = [] if element.is_empty else layout.comments_behind(element.open_end)
        spans = [*layout.comments_above(element), *within, *layout.comments_behind(element.end)]
        return {'comments': [self._comment(span) for span in spans], 'note': self._note(element)[0]}

    def _comment(self, span: Span) -> str:
        lines = LINE_BREAK.split(self.text[span.start + 4 : span.end - 3].strip())
        return '\n'.join(line.strip() for line in lines)

    def _note(self, element: XmlElement) -> tuple[str, Span | None]:
        """Return the note of an element and where it is: all comments above it, or else the one behind it."""
        layout = self.layout
        spans = layout.comments_above(element) or layout.comments_behind(element.end)[:1]
        if not spans:
            return '', None
        return '\n'.join(self._comment(span) for span in spans), Span(spans[0].start, spans[-1].end)

    def _view_of_model(self, model: XmlElement) -> dict[str, Any]:
        ports = [port for port in model.children if port.tag in _DIRECTIONS]
        shown = [
            {
                **_values(port, name='name', type='type'),
                'direction': _DIRECTIONS[port.tag],
                'default': port.attributes.get('default'),
                'description': unescape(self.text[port.open_end : port.close]).strip(),
                'span': [port.offset, port.end],
            }
            for port in ports
        ]
        return {**_values(model, id='ID'), 'kind': model.tag, 'span': [model.offset, model.end], 'ports': shown}

    def value_span(self, element: XmlElement, name: str) -> Span:
        part = element.parts.get(name)
        return Span(element.open_end, element.open_end) if part is None else Span(part.value_start, part.value_end)

    # Places by path.

    def at(self, path: str) -> XmlElement:
        """Return the element at a path. Raises GestureError if there is none."""
        found = _PATH.fullmatch(path)
        element = None
        if found is not None and self._root is not None:
            element = self._root if path == '' else self.trees.get(found.group(1))
            for index in found.group(2).split('/')[1:]:
                below = [] if element is None else nodes_of(element)
                element = below[int(index)] if int(index) < len(below) else None
        if element is None:
            hint = '' if '/' in path else did_you_mean(path, list(self.trees))
            raise GestureError(f'there is no node {short_repr(path)} in this file{hint}')
        return element

    def _readable(self, path: str, *, wholly: bool = True) -> XmlElement:
        """Return the element at a path. Raises GestureError if it, or with ``wholly`` a part of it, cannot be read."""
        element = self.at(path)
        self._check(element, wholly=wholly)
        return element

    def _check(self, element: XmlElement, *, wholly: bool = True) -> None:
        reason = element.fault or self.layout.problem_in(element.offset, element.end if wholly else element.open_end)
        if reason:
            line, _ = self.layout.position(element.offset)
            raise GestureError(f'{element} of line {line} cannot be edited here: {reason}; fix the text first')

    def _node(self, path: str, *, wholly: bool = True) -> XmlElement:
        """Return the node at a path, which is neither a tree nor <root>."""
        element = self._readable(path, wholly=wholly)
        if '/' not in path:
            raise GestureError(f'{short_repr(path)} is no node of a tree; its root is {short_repr(path + "/0")}')
        return element

    def _tree(self, path: str, *, wholly: bool = True) -> XmlElement:
        element = self._readable(path, wholly=wholly)
        if path not in self.trees:
            raise GestureError(f'{short_repr(path)} is no tree of this file{did_you_mean(path, list(self.trees))}')
        return element

    def _document_root(self) -> XmlElement:
        if self._root is None:
            raise GestureError('the file has no <root>; begin it with <root BTCPP_format="4">')
        self._check(self._root, wholly=False)
        return self._root

    # Parts of gestures.

    def _insertion(
        self, parent: XmlElement, index: int, written: Written, *, without: XmlElement | None = None, gap: str = ''
    ) -> list[TextEdit]:
        """Return the edits that insert text among the nodes of ``parent``, which can be read there."""
        self._check(parent, wholly=False)
        siblings = [child for child in parent.children if child is not without]
        if not 0 <= index <= len(siblings):
            raise GestureError(f'[index] must be from 0 to {len(siblings)} in {parent}, not {short_repr(index)}')
        for sibling in siblings[max(index - 1, 0) : index + 1]:
            self._check(sibling)
        return self.layout.insertion(parent, index, written, without=without, gap=gap)

    def _check_room(self, parent: XmlElement, count: int) -> None:
        """Raise GestureError if the element cannot have this number of children."""
        if parent.tag == 'BehaviorTree':
            most: int | None = 1
        elif parent.tag in SUBTREES:
            most = 0
        elif parent.parent is None:
            raise GestureError('nodes are put into a tree, not beside the trees')
        else:
            manifest = self.types.get(node_type(parent))
            most = 1 if parent.tag == 'Decorator' else None if manifest is None else manifest.children[1]
        if most is not None and count > most:
            what = 'a tree has 1 root' if parent.tag == 'BehaviorTree' else f'{parent} has at most {most} children'
            raise GestureError(f'{what}, and this would be {pluralize(count, "child", "children")}; use a Sequence')

    def _check_tree_id(self, id: str) -> None:
        """Raise GestureError if a new tree cannot have this ID."""
        problem = tree_name_problem(id)
        if not problem and any(tree.attributes.get('ID') == id for tree in self.trees.values()):
            problem = f'this file has a tree [{id}] already'
        if not problem and id in self.types:
            problem = f'[{id}] is the name of a node type'
        if problem:
            raise GestureError(f'{problem}; choose another ID')

    def tree_uses(self, id: str) -> list[Span]:
        """Return the spans that name a tree: of sub-trees, models, and the main tree; not that of the tree itself."""
        root = self._root
        if root is None:
            return []
        named = [root] if root.attributes.get('main_tree_to_execute') == id else []
        spans = [self.value_span(one, 'main_tree_to_execute') for one in named]
        others = (one for one in (*self.subtrees, *self.models) if one.tag in SUBTREES)
        return [*spans, *(self.value_span(one, 'ID') for one in others if one.attributes.get('ID') == id)]

    def clip(self, node: str) -> str:
        """Return the text of a node with its comments, without its indentation, for a clipboard.

        Raises:
            GestureError: there is no such node, or it cannot be read.
        """
        layout = self.layout
        block = layout.block(self._readable(node))
        text = layout.lifted(block, layout.indentation(block.start), '')
        return LINE_BREAK.sub('\n', text)

    def gesture(self, name: str, arguments: dict[str, Any]) -> list[TextEdit]:
        """Return the edits that carry out a gesture. Raises GestureError, also if the text could not be read after."""
        edits = super().gesture(name, arguments)
        after = Layout(applied(self.text, edits)).problems
        if len(after) > len(self.problems):
            raise GestureError(f'{name} cannot be done here: {after[0].message}')
        return edits


def nodes_of(element: XmlElement) -> list[XmlElement]:
    """Return the children that are nodes; the <remap> of sub-trees in format 3 are none."""
    if element.tag not in SUBTREES:
        return element.children
    return [child for child in element.children if child.tag != 'remap']


def _values(element: XmlElement, **names: str) -> dict[str, str]:
    """Return the values of attributes under other names; '' for absent ones."""
    return {name: element.attributes.get(attribute, '') for name, attribute in names.items()}


def _is_true(text: str) -> bool:
    try:
        return bool_from_text(text)
    except ConversionError:
        return False
