# SPDX-License-Identifier: BSD-3-Clause
"""Behavior trees in XML as documents: the graph, with a path for each node, and the gestures that edit it.

A node has a path: ``TREE/0`` is the root of a tree, ``TREE/0/2`` the third child of the root. ``TREE`` alone is the
tree, and ``''`` the element <root>. TREE is the ID of the tree. A tree without ID, with the ID of an earlier tree, or
with a ``/`` in its ID, or ``#`` before it, is called ``#N`` instead: the N-th tree of the file, from 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cached_property, lru_cache
from typing import Any, Final

from flexbt_core.behavior_tree.model.definition import (
    PRE_POST_ATTRIBUTES,
    model_name_problem,
    port_name_problem,
    tree_name_problem,
)
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError
from flexbt_core.behavior_tree.model.ports import KEYS, pointer_key
from flexbt_core.behavior_tree.xml.format3 import is_format_3
from flexbt_core.behavior_tree.xml.node_elements import EXPLICIT_TAGS, NodeTypes
from flexbt_core.behavior_tree.xml.parser import NAME, unescape
from flexbt_core.values.text import did_you_mean, pluralize, short_repr, xml_text
from flexbt_server.node_types import node_registry
from flexbt_studio.errors import GestureError

from .document import gesture, need
from .text import LINE_BREAK, Span, TextEdit, applied
from .xml_keys import SUBTREES, KeyReader, KeyUse, arguments, is_autoremapped, is_true, node_type, script_name_problem
from .xml_text import Layout, Written, XmlElement

PORT_TAGS: Final = {'input_port': 'input', 'output_port': 'output', 'inout_port': 'inout'}
"""Tags of ports of a model, with their directions."""
_TAGS: Final = {direction: tag for tag, direction in PORT_TAGS.items()}
_NAME: Final = re.compile(NAME)
_KINDS: Final = ', '.join(sorted(EXPLICIT_TAGS))
_NOT_NODES: Final = ('root', 'BehaviorTree', 'TreeNodesModel', 'include')
_KEY: Final = re.compile(r'[^\s{}<>"\'&;=]+')


@lru_cache(maxsize=1)
def _installed_types() -> NodeTypes:
    return node_registry(lambda nodes, error: None)


class XmlDocument(Layout):
    """Behavior trees in XML. See the module for the paths of nodes.

    ``types`` tells how many children nodes have, and which ports are scripts or keys; None for the installed node
    types. Indices count the children of a node from 0. Values are as the engine reads them, without escapes.
    """

    def __init__(self, text: str, file: str = '', types: NodeTypes | None = None) -> None:
        super().__init__(text, file)
        self._types = types

    # The elements of the graph.

    @cached_property
    def types(self) -> NodeTypes:
        """The node types that are known."""
        return _installed_types() if self._types is None else self._types

    @property
    def _root(self) -> XmlElement | None:
        return self.tops[0] if self.tops and self.tops[0].tag == 'root' else None

    @cached_property
    def is_old(self) -> bool:
        """Whether the text is of format 3."""
        return self._root is not None and is_format_3(self._root)

    def checked(self, edits: Iterable[TextEdit]) -> list[TextEdit]:
        made = super().checked(edits)
        after = self.after(applied(self.text, made))
        roots = (*self.tops[:1], *after.tops[:1])
        if after.is_old is not self.is_old and not any('BTCPP_format' in one.attributes for one in roots):
            calls = (one for one in after.subtrees if one.tag == 'SubTree')
            is_same = all(key is not None for one in calls for _, key in arguments(one, bare=False).values())
            before, now = ('3', '4') if self.is_old else ('4', '3')
            told = f'texts of sub-trees would mean {"keys" if after.is_old else "themselves"}, as in format {now}'
            need(is_same, f'after this edit {told}; declare it: write BTCPP_format="{before}" into <root> first')
        return made

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
    def paths(self) -> dict[XmlElement, str]:
        """The paths of the trees and of their nodes."""
        found = {tree: path for path, tree in self.trees.items()}
        for element in (one for tree in self.trees.values() for one in tree.all()):
            below = nodes_of(element) if element in found else ()
            found.update((child, f'{found[element]}/{index}') for index, child in enumerate(below))
        return found

    @cached_property
    def _elements(self) -> dict[str, XmlElement]:
        return {path: element for element, path in self.paths.items()}

    @cached_property
    def nodes(self) -> list[XmlElement]:
        """The nodes of all trees, in document order."""
        return [one for tree in self.trees.values() for one in tree.all() if one is not tree and one in self.paths]

    @cached_property
    def subtrees(self) -> list[XmlElement]:
        """The sub-trees that the trees of this file use, in document order."""
        return [one for tree in self.trees.values() for one in _calls_in(tree)]

    @cached_property
    def models(self) -> list[XmlElement]:
        """The elements of <TreeNodesModel>."""
        return [model for section in self.sections('TreeNodesModel') for model in section.children]

    def definition(self, id: str | None) -> XmlElement | None:
        """Return the tree that this ID means in this file: the last one; None if none has it."""
        return next((one for one in reversed(self.trees.values()) if one.attributes.get('ID', '') == id), None)

    @cached_property
    def defaults(self) -> dict[str, list[tuple[str, str]]]:
        """The ports of trees that models let lead to a key where they are not given, with these keys."""
        found: dict[str, list[tuple[str, str]]] = {}
        for model in self.models:
            for port in _ports(model) if model.tag == 'SubTree' else ():
                name = port.attributes.get('name', '')
                if (key := pointer_key(port.attributes.get('default', ''), name)) is not None:
                    found.setdefault(model.attributes.get('ID', ''), []).append((name, key))
        return found

    @cached_property
    def keys(self) -> KeyReader:
        """The reader of the keys that nodes name."""
        return KeyReader(self.text, self.types, self.defaults, bare=self.is_old)

    # View.

    @cached_property
    def _view(self) -> dict[str, Any]:
        root = {} if self._root is None else self._root.attributes
        return {
            'language': self.language,
            'format': '' if self._root is None else root.get('BTCPP_format', '3' if self.is_old else '4'),
            'main': root.get('main_tree_to_execute', ''),
            'includes': [
                {**_values(one, path='path', package='ros_pkg'), 'span': [*one.span]}
                for one in self.sections('include')
            ],
            'models': [self._view_of_model(model) for model in self.models],
            'trees': [
                {
                    'id': tree.attributes.get('ID', ''),
                    'path': path,
                    'span': [*tree.span],
                    'id_span': [*tree.value_span('ID')],
                    **self._view_of_comments(tree),
                }
                for path, tree in self.trees.items()
            ],
            'nodes': [self._view_of_node(element, self.paths[element]) for element in self.nodes],
        }

    def _view_of_node(self, element: XmlElement, path: str) -> dict[str, Any]:
        parent = path.rpartition('/')[0]
        return {
            'path': path,
            'tree': path.partition('/')[0],
            'parent': parent if '/' in parent else None,
            'tag': element.tag,
            'type': node_type(element),
            'name': element.attributes.get('name', ''),
            'span': [*element.span],
            'open': [element.offset, element.open_end],
            'attributes': [part.view(name) for name, part in element.parts.items()],
            'collapsed': is_true(element.attributes.get('_collapsed', '')),
            'fault': element.fault,
            **self._view_of_comments(element),
        }

    def _view_of_comments(self, element: XmlElement) -> dict[str, Any]:
        within = [] if element.is_empty else self.comments_behind(element.open_end)
        spans = [*self.comments_above(element), *within, *self.comments_behind(element.end)]
        return {'comments': [self._comment(span) for span in spans], 'note': self._note(element)[0]}

    def _comment(self, span: Span) -> str:
        lines = LINE_BREAK.split(self.text[span.start + 4 : span.end - 3].strip())
        return '\n'.join(line.strip() for line in lines)

    def _note(self, element: XmlElement) -> tuple[str, Span | None]:
        """Return the note of an element and where it is: all comments above it, or else the one behind it."""
        spans = self.comments_above(element) or self.comments_behind(element.end)[:1]
        if not spans:
            return '', None
        return '\n'.join(self._comment(span) for span in spans), Span(spans[0].start, spans[-1].end)

    def _view_of_model(self, model: XmlElement) -> dict[str, Any]:
        ports = [
            {
                **_values(port, name='name', type='type'),
                'direction': PORT_TAGS[port.tag],
                'default': port.attributes.get('default'),
                'description': unescape(self.text[port.open_end : port.close]).strip(),
                'span': [*port.span],
            }
            for port in _ports(model)
        ]
        return {**_values(model, id='ID'), 'kind': model.tag, 'span': [*model.span], 'ports': ports}

    # Places by path.

    def at(self, path: str) -> XmlElement:
        """Return the element at a path. Raises GestureError if there is none."""
        element = self._root if path == '' else self._elements.get(path)
        if element is None:
            hint = '' if '/' in path else did_you_mean(path, self.trees)
            raise GestureError(f'there is no node {short_repr(path)} in this file{hint}')
        return element

    def _readable(self, path: str, *, wholly: bool = True) -> XmlElement:
        """Return the element at a path. Raises GestureError if it, or with ``wholly`` a part of it, cannot be read."""
        element = self.at(path)
        self._check(element, wholly=wholly)
        return element

    def _check(self, element: XmlElement, *, wholly: bool = True) -> None:
        reason = element.fault or self.problem_in(element.offset, element.end if wholly else element.open_end)
        if reason:
            line, _ = self.position(element.offset)
            raise GestureError(f'{element} of line {line} cannot be edited here: {reason}; fix the text first')

    def _node(self, path: str, *, wholly: bool = True) -> tuple[XmlElement, XmlElement]:
        """Return the node at a path, which is neither a tree nor <root>, and its parent."""
        element = self._readable(path, wholly=wholly)
        if '/' not in path or element.parent is None:
            raise GestureError(f'{short_repr(path)} is no node of a tree; its root is {short_repr(path + "/0")}')
        return element, element.parent

    def _tree(self, path: str, *, wholly: bool = True) -> XmlElement:
        element = self._readable(path, wholly=wholly)
        need(path in self.trees, f'{short_repr(path)} is no tree of this file', path, self.trees)
        return element

    def _document_root(self) -> XmlElement:
        if self._root is None:
            raise GestureError('the file has no <root>; begin it with <root BTCPP_format="4">')
        self._check(self._root, wholly=False)
        return self._root

    def clip(self, node: str) -> str:
        """Return the text of a node with its comments, without its indentation, for a clipboard.

        Raises:
            GestureError: there is no such node, or it cannot be read.
        """
        return LINE_BREAK.sub('\n', self._block_text(self._readable(node), ''))

    def _block_text(self, element: XmlElement, indentation: str) -> str:
        """Return the text of an element with its comments, for another indentation."""
        block = self.block(element)
        return self.lifted(block, self.indentation(block.start), indentation)

    # Values.

    @gesture
    def set_value(self, node: str, name: str, value: str | None) -> list[TextEdit]:
        """Set an attribute of a node, a tree (except its ID) or <root> (``''``); None removes it."""
        element = self._readable(node, wholly=False)
        if element.tag == 'BehaviorTree' and name == 'ID' and value is not None and node in self.trees:
            return self.rename_tree(node, value)
        need(_NAME.fullmatch(name), f'{short_repr(name)} is no name of an attribute; use letters, digits and _')
        is_there = value is not None or name in element.attributes
        need(is_there, f'{element} has no attribute [{name}]', name, element.attributes)
        return self.value_edits(element, {name: value})

    @gesture
    def rename_attribute(self, node: str, name: str, new: str) -> list[TextEdit]:
        """Give an attribute another name; its value stays."""
        element = self._readable(node, wholly=False)
        need(name in element.parts, f'{element} has no attribute [{name}]', name, element.attributes)
        need(_NAME.fullmatch(new), f'{short_repr(new)} is no name of an attribute; use letters, digits and _')
        is_free = new == name or new not in element.attributes
        need(is_free, f'{element} has an attribute [{new}] already; remove it first')
        return [element.renamed(name, new)]

    @gesture
    def set_type(self, node: str, type: str, keep: list[str] | None = None, form: str | None = None) -> list[TextEdit]:
        """Give a node another type. Ports that are not in ``keep`` are removed; None keeps all.

        ``form`` is the tag of the explicit form, as in <Action ID="type"/> or <SubTree ID="type"/>; '' is the short
        form <type/>; None keeps the form. Its name, conditions and other ``_`` attributes, and its children stay.
        """
        element, _ = self._node(node, wholly=False)
        if not element.is_empty:
            self._check(element)
        was_explicit = element.tag in EXPLICIT_TAGS or element.tag in SUBTREES
        tag = (element.tag if was_explicit else '') if form is None else form
        is_form = not tag or tag in EXPLICIT_TAGS or tag in SUBTREES
        need(is_form, f'[form] must be one of {_KINDS} or empty, not {short_repr(tag)}')
        self._check_type(type, tag)
        can_be = tag not in SUBTREES or not nodes_of(element)
        need(can_be, f'a sub-tree has no children, and {element} has; remove them first')
        removed: dict[str, str | None] = {
            name: None
            for name in element.attributes
            if keep is not None and name not in keep and name not in ('ID', 'name') and not name.startswith('_')
        }
        edits: list[TextEdit] = []
        written = tag or type
        if tag and 'ID' in element.parts:
            edits += self.value_edits(element, {'ID': type})
        elif tag:
            written = self.start_tag(tag, {'ID': type}, '')[1:]
        elif was_explicit and 'ID' in element.parts:
            removed['ID'] = None
        if written != element.tag:
            start = element.offset + 1
            edits.append(TextEdit(start, start + len(element.tag), written))
            if not element.is_empty:
                edits.append(TextEdit(element.close + 2, element.close + 2 + len(element.tag), tag or type))
        return [*edits, *self.value_edits(element, removed)]

    def _check_type(self, type: str, tag: str) -> None:
        problem = tree_name_problem(type) if tag in SUBTREES else model_name_problem(type)
        if not problem and not tag and (_NAME.fullmatch(type) is None or type in EXPLICIT_TAGS):
            problem = f'{short_repr(type)} cannot be the tag of a node'
        need(not problem, f'{problem}; choose a node type of the palette')

    # Structure.

    def _insertion(
        self, parent: XmlElement, index: int, written: Written, *, without: XmlElement | None = None, gap: str = ''
    ) -> list[TextEdit]:
        """Return the edits that insert text among the nodes of ``parent``, which can be read there."""
        self._check(parent, wholly=False)
        siblings = [child for child in parent.children if child is not without]
        is_place = 0 <= index <= len(siblings)
        need(is_place, f'[index] must be from 0 to {len(siblings)} in {parent}, not {short_repr(index)}')
        for sibling in siblings[max(index - 1, 0) : index + 1]:
            self._check(sibling)
        return self.insertion(parent, index, written, without=without, gap=gap)

    def _check_room(self, parent: XmlElement, count: int) -> None:
        """Raise GestureError if the element cannot have this number of children."""
        need(parent.parent is not None, 'nodes are put into a tree, not beside the trees')
        if parent.tag in ('BehaviorTree', 'Decorator'):
            most: int | None = 1
        elif parent.tag in SUBTREES:
            most = 0
        else:
            manifest = self.types.get(node_type(parent))
            most = None if manifest is None else manifest.children[1]
        what = 'a tree has 1 root' if parent.tag == 'BehaviorTree' else f'{parent} has at most {most} children'
        would_be = pluralize(count, 'child', 'children')
        need(most is None or count <= most, f'{what}, and this would be {would_be}; use a Sequence')

    @gesture
    def add_node(self, parent: str, index: int, xml: str) -> list[TextEdit]:
        """Insert XML of one or more nodes among the children of a node, or as the root of an empty tree."""
        element = self._readable(parent, wholly=False)
        tops, written = self.snippet(xml)
        wrong = next((top.tag for top in tops if top.tag in _NOT_NODES), None)
        need(wrong is None, f'<{wrong}> cannot be in a tree; give the elements of nodes only')
        self._check_room(element, len(element.children) + len(tops))
        return self._insertion(element, index, written)

    @gesture
    def remove(self, node: str) -> list[TextEdit]:
        """Remove a node with its children and comments."""
        element, parent = self._node(node)
        self._check(parent, wholly=False)
        return self.removal(element)

    @gesture
    def move(self, node: str, parent: str, index: int) -> list[TextEdit]:
        """Move a node with its children and comments; ``index`` counts the other children of ``parent``."""
        element, before = self._node(node)
        target = self._readable(parent, wholly=False)
        self._check(before, wholly=False)
        need(not element.offset <= target.offset < element.end, f'{element} cannot be moved into itself')
        if target is before and index == target.children.index(element):
            return []
        siblings = [child for child in target.children if child is not element]
        self._check_room(target, len(siblings) + 1)
        inserted = self._insertion(target, index, lambda new: self._block_text(element, new), without=element)
        return [*self.removal(element), *inserted]

    @gesture
    def wrap(self, node: str, xml_type: str, values: dict[str, str] | None = None) -> list[TextEdit]:
        """Put a node of this type, with these attributes, between a node and its parent."""
        element, _ = self._node(node)
        is_explicit = xml_type in EXPLICIT_TAGS
        self._check_type((values or {}).get('ID', '') if is_explicit else xml_type, xml_type if is_explicit else '')
        need(xml_type not in SUBTREES, 'a sub-tree has no children; extract the node into a sub-tree instead')
        for name, value in (values or {}).items():
            is_value = isinstance(value, str) and _NAME.fullmatch(name)
            need(is_value, f'[values] must map names of attributes to texts, not {short_repr({name: value})}')
        block = self.block(element)
        start_tag, end_tag = self.start_tag(xml_type, values or {}), f'</{xml_type}>'
        if not self.begins_line(block.start) or self.rest_of_line(block.end) is None:
            return [TextEdit(block.start, block.start, start_tag), TextEdit(block.end, block.end, end_tag)]
        indentation = self.indentation(block.start)
        inner = indentation + self.unit
        end = block.end + len(self.blanks(block.end))
        return [
            TextEdit(block.start, block.start, start_tag + self.line_break + inner),
            *self.reindented(block, indentation, inner),
            TextEdit(end, end, self.line_break + indentation + end_tag),
        ]

    @gesture
    def unwrap(self, node: str) -> list[TextEdit]:
        """Replace a node by its children. Its own comments go with it."""
        element, parent = self._node(node)
        below = nodes_of(element)
        need(below, f'{element} has no children that could take its place; remove it instead')
        self._check_room(parent, len(parent.children) - 1 + len(below))
        block, opening_end = self.block(element), self.opening_end(element)
        first, last = self.rest_of_line(opening_end), self.rest_of_line(block.end)
        if first is None or last is None or not (self.begins_line(block.start) and self.begins_line(element.close)):
            return [TextEdit(block.start, opening_end, ''), TextEdit(element.close, block.end, '')]
        child = self.block(below[0]).start
        close = self.lines.start(element.close)
        moved = self.reindented(Span(first - 1, close), self.indentation(child), self.indentation(block.start))
        start_line = TextEdit(self.lines.start(block.start), first, '')
        return [start_line, *(moved if self.begins_line(child) else ()), TextEdit(close, last, '')]

    @gesture
    def set_comment(self, node: str, text: str | None) -> list[TextEdit]:
        """Set the note of a node or a tree: the comments above it, or else the one behind it; None removes it."""
        element = self._readable(node, wholly=False)
        note, span = self._note(element)
        text = LINE_BREAK.sub('\n', (text or '').strip())
        if not text:
            return [] if span is None else [self._without_note(element, span)]
        is_comment = '--' not in text and not text.endswith('-')
        need(is_comment, "a comment of XML cannot contain '--' or end with '-'; write – instead")
        if note == text:
            return []
        self.quoted(text)
        indentation = self.indentation(element.offset if span is None else span.start)
        lines = [line.strip() for line in text.split('\n')]
        comment = f'<!-- {f"{self.line_break}{indentation}     ".join(lines)} -->'
        if span is not None:
            return [TextEdit(*span, comment)]
        if self.begins_line(element.offset):
            return [TextEdit(element.offset, element.offset, comment + self.line_break + indentation)]
        return [TextEdit(element.end, element.end, f' {comment}')]

    def _without_note(self, element: XmlElement, span: Span) -> TextEdit:
        next_line = self.rest_of_line(span.end)
        if span.start > element.offset:
            return TextEdit(len(self.text[: span.start].rstrip(' \t')), span.end, '')
        if next_line is None:
            return TextEdit(span.start, element.offset, '')
        return TextEdit(self.lines.start(span.start), next_line, '')

    # Trees, includes and models.

    def _check_tree_id(self, id: str) -> None:
        """Raise GestureError if a new tree cannot have this ID."""
        problem = tree_name_problem(id)
        need(not problem, f'{problem}; choose another ID')
        need(self.definition(id) is None, f'this file has a tree [{id}] already; choose another ID')
        need(id not in self.types, f'[{id}] is the name of a node type; choose another ID')

    @gesture
    def add_tree(self, id: str, xml: str | None = None) -> list[TextEdit]:
        """Add a tree behind the other trees, with the XML of its root, or empty."""
        self._check_tree_id(id)
        inner = None
        if xml is not None:
            tops, inner = self.snippet(xml)
            need(len(tops) == 1, f'a tree has 1 root, and this XML has {len(tops)} elements; use a Sequence')
        return self._new_tree(id, inner, self._place_behind('BehaviorTree', 'include'))

    def _new_tree(self, id: str, inner: Written | None, index: int) -> list[TextEdit]:
        root = self._document_root()

        def written(indentation: str) -> str:
            start = self.start_tag('BehaviorTree', {'ID': id}, self.empty_end if inner is None else '>')
            if inner is None:
                return start
            deeper = indentation + self.unit
            return self.line_break.join([start, deeper + inner(deeper), f'{indentation}</BehaviorTree>'])

        return self._insertion(root, index, written, gap=self.gap(root))

    def _place_behind(self, *tags: str) -> int:
        """Return the index below <root> behind the last element of the first of these tags that there is."""
        children = self._document_root().children
        places = ([index for index, child in enumerate(children, 1) if child.tag == tag] for tag in tags)
        return next((found[-1] for found in places if found), 0)

    @gesture
    def remove_tree(self, id: str) -> list[TextEdit]:
        """Remove a tree with its comments. What refers to it stays."""
        tree = self._tree(id)
        self._document_root()
        return self.removal(tree)

    @gesture
    def rename_tree(self, id: str, new: str) -> list[TextEdit]:
        """Give a tree another ID, also where this file refers to it."""
        tree = self._tree(id, wholly=False)
        old = tree.attributes.get('ID')
        if new == old:
            return []
        self._check_tree_id(new)
        same = [one for one in self.trees.values() if one.attributes.get('ID') == old]
        uses = self.tree_uses(old) if old is not None and len(same) == 1 else []
        return [*self.value_edits(tree, {'ID': new}), *(TextEdit(*span, new) for span in uses)]

    def tree_uses(self, id: str) -> list[Span]:
        """Return the spans that name a tree: of sub-trees, models, and the main tree; not that of the tree itself."""
        is_main = self._root is not None and self._root.attributes.get('main_tree_to_execute') == id
        spans = [self._root.value_span('main_tree_to_execute')] if self._root is not None and is_main else []
        others = (one for one in (*self.subtrees, *self.models) if one.tag in SUBTREES)
        return [*spans, *(one.value_span('ID') for one in others if one.attributes.get('ID') == id)]

    @gesture
    def add_include(self, path: str, package: str = '') -> list[TextEdit]:
        """Include a file; with ``package``, one of the share directory of that package."""
        values = {'ros_pkg': package, 'path': path} if package else {'path': path}
        tag = self.start_tag('include', values, self.empty_end)
        return self._insertion(self._document_root(), self._place_behind('include'), lambda _: tag)

    @gesture
    def remove_include(self, path: str) -> list[TextEdit]:
        """No longer include a file."""
        found = {one.attributes.get('path', ''): one for one in reversed(self.sections('include'))}
        need(path in found, f'{short_repr(path)} is not included', path, found)
        self._check(found[path])
        return self.removal(found[path])

    @gesture
    def add_model(self, id: str, kind: str, ports: list[dict[str, str | None]]) -> list[TextEdit]:
        """Declare a node type, or a tree with kind SubTree, for editors.

        Each port has ``name`` and ``direction`` (input, output, inout), and may have ``type``, ``default`` and
        ``description``.
        """
        root = self._document_root()
        problem = tree_name_problem(id) if kind == 'SubTree' else model_name_problem(id)
        need(kind in EXPLICIT_TAGS, f'[kind] must be one of {_KINDS}, not {short_repr(kind)}')
        is_new = all(model.attributes.get('ID') != id for model in self.models)
        need(is_new, f'this file has a model of [{id}] already; remove it first')
        need(not problem, problem)
        lines = [self._model_port(port) for port in ports]

        def model(indentation: str) -> str:
            if not lines:
                return self.start_tag(kind, {'ID': id}, self.empty_end)
            rows = [self.start_tag(kind, {'ID': id}), *(self.unit + line for line in lines), f'</{kind}>']
            return (self.line_break + indentation).join(rows)

        def section(indentation: str) -> str:
            deeper = indentation + self.unit
            rows = '<TreeNodesModel>', deeper + model(deeper), f'{indentation}</TreeNodesModel>'
            return self.line_break.join(rows)

        sections = self.sections('TreeNodesModel')
        if sections:
            return self._insertion(sections[0], len(sections[0].children), model)
        return self._insertion(root, len(root.children), section, gap=self.gap(root))

    def _model_port(self, port: Any) -> str:
        """Return the text of a port of a model."""
        is_valid = isinstance(port, dict) and all(value is None or isinstance(value, str) for value in port.values())
        is_valid = is_valid and port.get('name') and port.get('direction') in _TAGS
        need(is_valid, f'a port needs name and direction ({", ".join(_TAGS)}), not {short_repr(port)}')
        tag = _TAGS[port['direction']]
        values = {name: port[name] for name in ('name', 'type', 'default') if port.get(name) is not None}
        description = port.get('description') or ''
        self.quoted(description)
        return self.start_tag(tag, values, f'>{xml_text(description)}</{tag}>' if description else self.empty_end)

    @gesture
    def remove_model(self, id: str) -> list[TextEdit]:
        """Remove a model, and <TreeNodesModel> with its last one."""
        found = {model.attributes.get('ID', ''): model for model in reversed(self.models)}
        need(id in found, f'this file has no model of {short_repr(id)}', id, found)
        self._check(found[id])
        section = found[id].parent
        assert section is not None
        self._check(section, wholly=False)
        return self.removal(section if len(section.children) == 1 else found[id])

    # Keys.

    @gesture
    def rename_key(self, tree: str, old: str, new: str) -> list[TextEdit]:
        """Rename a blackboard key of a tree: in values and scripts, and as port where this file uses the tree."""
        element = self._tree(tree)
        if old == new:
            return []
        fits = _KEY.fullmatch(new) and new.startswith('@') == old.startswith('@')
        need(fits, f'{short_repr(new)} cannot replace the key [{old}]; use letters, digits and _')
        id, uses = element.attributes.get('ID'), self._uses(element)
        is_shared, known = self.is_shared(tree, old), {use.key for use in uses}
        edits: list[TextEdit] = []
        if self.definition(id) is element:
            known |= {old} if self.renamed_port(id, old, new, is_shared=False) else set()
            edits += self.renamed_port(id, old, new, is_shared=is_shared)
        need(old in known, f'tree [{tree}] has no key [{old}]', old, known)
        for use in uses:
            need(use.key != new, f'tree [{tree}] uses the key [{new}] too, so the two would become one')
            edits += self._renamed(use, new) if use.key == old else ()
        for call in _calls_in(element) if is_shared else ():
            is_user = is_autoremapped(call) and old not in arguments(call, bare=self.is_old)
            if is_user and self._may_use(call.attributes.get('ID'), old):
                edits += self.value_edits(call, {old: self._argument(call, new)})
        return edits

    def given_by_default(self, tree: str, id: str, port: str, key: str) -> list[TextEdit]:
        """Return the edits that let a port of a sub-tree lead to a key where a tree does not give it."""
        calls = (one for one in self._calls(id) if self.paths[one].partition('/')[0] == tree)
        calls = (one for one in calls if not is_autoremapped(one) and port not in arguments(one, bare=self.is_old))
        return [edit for one in calls for edit in self.value_edits(one, {port: self._argument(one, key)})]

    def is_shared(self, tree: str, key: str) -> bool:
        """Return whether a tree, or one to which it hands all keys, uses a key that may be that of a tree around it."""
        if key[:1] in ('_', '@'):
            return False
        element = self.trees[tree]
        calls = (one for one in _calls_in(element) if is_autoremapped(one))
        return any(use.key == key for use in self._uses(element)) or any(
            key not in arguments(one, bare=self.is_old) and self._may_use(one.attributes.get('ID'), key)
            for one in calls
        )

    def renamed_port(self, id: str | None, old: str, new: str, *, is_shared: bool) -> list[TextEdit]:
        """Return the edits where this file hands a key to the tree ``id``, which gets another name in that tree.

        The keys of the trees around it stay. ``is_shared`` is that of the key in the tree.
        """
        models = [port for port in self._model_ports(id) if port.attributes.get('name') == old]
        edits = [TextEdit(*port.value_span('name'), new) for port in models]
        for call in self._calls(id):
            given = arguments(call, bare=self.is_old)
            need(new not in given, f'{call} has a port [{new}] already; rename that first')
            remaps = (one for one in call.children if one.attributes.get('internal') == old)
            edits += [TextEdit(*remap.value_span('internal'), new) for remap in remaps]
            if old in call.parts and not port_name_problem(old):
                edits += self.renamed_attribute(call, old, new)
            elif is_shared and is_autoremapped(call) and old not in given:
                edits += self.value_edits(call, {new: self._argument(call, old)})
        problem = port_name_problem(new) if edits else ''
        need(not problem, problem)
        return edits

    @staticmethod
    def renamed_attribute(element: XmlElement, old: str, new: str) -> list[TextEdit]:
        """Return the edits that give a port another name where it is set, and leave the key that it leads to."""
        part = element.parts[old]
        is_same = part.value.strip(' {}') == '='
        kept = [TextEdit(part.value_start, part.value_end, f'{{{old}}}')] if is_same else []
        return [element.renamed(old, new), *kept]

    def _uses(self, element: XmlElement) -> list[KeyUse]:
        try:
            return [*self.keys.uses(element)]
        except BehaviorTreeError as error:
            raise GestureError(f'a script of {element} cannot be read: {error}; fix it first') from error

    def _renamed(self, use: KeyUse, key: str) -> list[TextEdit]:
        """Return the edits that name another key at a place."""
        is_name = use.port is not None and use.port.literal is KEYS
        need(not is_name, f'{use.element} hands [{use.key}] over by this name; rename it there too, in the text')
        problem = script_name_problem(key, self.types) if use.form == 'script' else ''
        need(not problem, problem)
        if use.form in ('absent', 'default'):
            return self.value_edits(use.element, {use.attribute: f'{{{key}}}'})
        quote = self.text[use.element.parts[use.attribute].value_end]
        return [TextEdit(*use.span, self.escaped(f'{{{key}}}' if use.form == 'same' else key, quote))]

    def _argument(self, call: XmlElement, key: str) -> str:
        """Return the text of an attribute of a sub-tree that leads to a key."""
        return key if self.is_old and call.tag == 'SubTree' else f'{{{key}}}'

    def _calls(self, id: str | None) -> list[XmlElement]:
        """Return the sub-trees of this file that use a tree."""
        return [one for one in self.subtrees if id is not None and one.attributes.get('ID') == id]

    def _model_ports(self, id: str | None) -> list[XmlElement]:
        models = (model for model in self.models if model.tag == 'SubTree' and model.attributes.get('ID') == id)
        return [port for model in models for port in _ports(model)]

    def _may_use(self, id: str | None, key: str) -> bool:
        """Return whether a tree, or a tree that shares its keys, uses a key. A tree of another file may."""
        pending, seen = [id], {id}
        for one in pending:
            tree = self.definition(one)
            if tree is None or any(use.key == key for use in self._uses(tree)):
                return True
            below = {call.attributes.get('ID') for call in _calls_in(tree) if is_autoremapped(call)} - seen
            seen |= below
            pending += below
        return False

    @gesture
    def extract(self, node: str, id: str) -> list[TextEdit]:
        """Make a node a tree of its own, behind its tree, and use that here. The keys that it uses become ports."""
        element, _ = self._node(node)
        self._check_tree_id(id)
        tree = self.trees[node.partition('/')[0]]
        outside: set[str] = set()
        inside: dict[str, bool] = {}
        written: set[str] = set()
        for use in self._uses(tree):
            if element.offset <= use.element.offset < element.end:
                inside[use.key] = inside.get(use.key, True) and use.form == 'absent'
                written |= {use.key} if use.writes else set()
                self._check_scope(use)
            else:
                outside.add(use.key)
        values = {'ID': id}
        shares = any(is_autoremapped(call) for call in _calls_in(element))
        if shares:
            values['__shared_blackboard' if self.is_old else '_autoremap'] = 'true'
        for key, is_absent in inside.items():
            is_private = is_absent or (key.startswith('_') and key in written)
            if key.startswith('@') or (is_private and key not in outside):
                continue
            problem = port_name_problem(key)
            need(not problem, f'the key [{key}] cannot be a port of a sub-tree: {problem}; rename it first')
            if not shares:
                values[key] = key if self.is_old else f'{{{key}}}'
        call = TextEdit(*self.block(element), self.start_tag('SubTree', values, self.empty_end))
        index = self._document_root().children.index(tree) + 1
        return [call, *self._new_tree(id, lambda new: self._block_text(element, new), index)]

    @gesture
    def inline(self, node: str) -> list[TextEdit]:
        """Replace a sub-tree by the nodes of its tree, which stays. Refused where that would not do the same."""
        call, _ = self._node(node)
        id = call.attributes.get('ID', '')
        need(call.tag in SUBTREES, f'{call} is no sub-tree')
        target, around = self.definition(id), self.trees[node.partition('/')[0]]
        if target is None:
            raise GestureError(f'tree [{id}] is not in this file; copy its nodes from its own file')
        self._check(target)
        has_root = target is not around and len(nodes_of(target)) == 1
        need(has_root, f'tree [{id}] must have one root, and not be the tree that it is put into')
        (root,) = target.children
        edits = self._inlined(call, id, root, around)
        conditions = {name: text for name, text in call.attributes.items() if name in PRE_POST_ATTRIBUTES}
        is_exact = not conditions or PRE_POST_ATTRIBUTES.isdisjoint(root.attributes)
        need(is_exact, f'both {call} and {root} have conditions; wrap one of them first')
        edits += self.value_edits(root, {**conditions})
        block = self.block(root)
        text = self.lifted(block, self.indentation(block.start), self.indentation(call.offset), edits=edits)
        return [TextEdit(*call.span, text)]

    def _inlined(self, call: XmlElement, id: str, root: XmlElement, around: XmlElement) -> list[TextEdit]:
        """Return the edits below ``root`` that name the keys of the tree around it instead of those of its own."""
        shares = is_autoremapped(call)
        given = arguments(call, bare=self.is_old)
        for port in self._model_ports(id):
            name, default = port.attributes.get('name', ''), port.attributes.get('default')
            if default is not None and not shares:
                given.setdefault(name, (default, pointer_key(default, name)))
        edits: list[TextEdit] = []
        own: set[str] = set()
        for use in self._uses(root):
            self._check_scope(use)
            text, key = given.get(use.key, ('', use.key))
            if use.key.startswith('@'):
                continue
            if use.key not in given:
                own |= set() if shares and not use.key.startswith('_') else {use.key}
            elif key is None:
                need(not use.writes, f'{use.element} writes [{use.key}], which is a text here; pass a key instead')
                edits += self._constant(use, text)
            elif key != use.key:
                edits += self._renamed(use, key)
        below = any(is_autoremapped(one) for one in _calls_in(root))
        is_exact = not below or (shares and not edits and not own)
        need(is_exact, f'a sub-tree of [{id}] shares all its keys; this is exact only if their names stay')
        others = [one for one in _calls_in(around) if one is not call]
        sharing = any(is_autoremapped(one) for one in [*others, *self._calls(around.attributes.get('ID'))])
        clashes = ', '.join(sorted(own if sharing else own & {use.key for use in self._uses(around)}))
        need(not clashes, f'keys of [{id}] alone would be shared with others: {clashes}; pass or rename them first')
        return edits

    def _check_scope(self, use: KeyUse) -> None:
        text = f'{use.element} removes [{use.key}] from its own tree only, so it has to stay in it'
        need(use.form != 'own', text)

    def _constant(self, use: KeyUse, text: str) -> list[TextEdit]:
        """Return the edit that writes a text where a key is read."""
        port = use.port
        kind = None if port is None else port.literal or port.type
        fits = use.form in ('pointer', 'same') and port is not None and not port.writable
        fits = fits and (kind is None or kind.from_text is not None)
        need(fits, f'{use.element} cannot have a text in place of [{use.key}]; pass a key instead')
        return self.value_edits(use.element, {use.attribute: text})


def nodes_of(element: XmlElement) -> list[XmlElement]:
    """Return the children that are nodes; the <remap> of sub-trees in format 3 are none."""
    if element.tag not in SUBTREES:
        return element.children
    return [child for child in element.children if child.tag != 'remap']


def _calls_in(element: XmlElement) -> list[XmlElement]:
    return [one for one in element.all() if one.tag in SUBTREES]


def _ports(model: XmlElement) -> list[XmlElement]:
    return [port for port in model.children if port.tag in PORT_TAGS]


def _values(element: XmlElement, **names: str) -> dict[str, str]:
    """Return the values of attributes under other names; '' for absent ones."""
    return {name: element.attributes.get(attribute, '') for name, attribute in names.items()}
