# SPDX-License-Identifier: BSD-3-Clause
"""The gestures that edit behavior trees in XML. What a gesture does not mean, it does not touch."""

from __future__ import annotations

import re
from typing import Any, Final

from flexbt_core.behavior_tree.model.definition import (
    PRE_POST_ATTRIBUTES,
    model_name_problem,
    port_name_problem,
    tree_name_problem,
)
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError
from flexbt_core.behavior_tree.model.ports import KEYS, pointer_key
from flexbt_core.behavior_tree.xml.node_elements import EXPLICIT_TAGS
from flexbt_core.behavior_tree.xml.parser import NAME
from flexbt_core.values.text import did_you_mean, short_repr, xml_text
from flexbt_studio.errors import GestureError

from .document import gesture
from .text import LINE_BREAK, Span, TextEdit
from .xml_keys import SUBTREES, KeyUse, arguments, is_autoremapped, script_name_problem
from .xml_layout import Written
from .xml_spans import XmlElement
from .xml_trees import PORT_TAGS, TreesInXml, nodes_of

_NAME: Final = re.compile(NAME)
_KINDS: Final = ', '.join(sorted(EXPLICIT_TAGS))
_NOT_NODES: Final = ('root', 'BehaviorTree', 'TreeNodesModel', 'include')
_KEY: Final = re.compile(r'[^\s{}<>"\'&;=]+')


class XmlDocument(TreesInXml):
    """Behavior trees in XML. See the module for the paths of nodes.

    Indices count the children of a node from 0. Values are as the engine reads them, without escapes.
    """

    # Values.

    @gesture
    def set_value(self, node: str, name: str, value: str | None) -> list[TextEdit]:
        """Set an attribute of a node, a tree (except its ID) or <root> (``''``); None removes it."""
        element = self._readable(node, wholly=False)
        if element.tag == 'BehaviorTree' and name == 'ID' and value is not None and node in self.trees:
            return self.rename_tree(node, value)
        if _NAME.fullmatch(name) is None:
            raise GestureError(f'{short_repr(name)} is no name of an attribute; use letters, digits and _')
        if value is None and name not in element.attributes:
            raise GestureError(f'{element} has no attribute [{name}]{did_you_mean(name, list(element.attributes))}')
        return self.layout.value_edits(element, {name: value})

    @gesture
    def rename_attribute(self, node: str, name: str, new: str) -> list[TextEdit]:
        """Give an attribute another name; its value stays."""
        element = self._readable(node, wholly=False)
        part = element.parts.get(name)
        if part is None:
            raise GestureError(f'{element} has no attribute [{name}]{did_you_mean(name, list(element.attributes))}')
        if _NAME.fullmatch(new) is None:
            raise GestureError(f'{short_repr(new)} is no name of an attribute; use letters, digits and _')
        if new != name and new in element.attributes:
            raise GestureError(f'{element} has an attribute [{new}] already; remove it first')
        return [TextEdit(part.start, part.start + len(name), new)] if new != name else []

    @gesture
    def set_type(self, node: str, type: str, keep: list[str] | None = None, form: str | None = None) -> list[TextEdit]:
        """Give a node another type. Ports that are not in ``keep`` are removed; None keeps all.

        ``form`` is the tag of the explicit form, as in <Action ID="type"/> or <SubTree ID="type"/>; '' is the short
        form <type/>; None keeps the form. Its name, conditions and other ``_`` attributes, and its children stay.
        """
        element = self._node(node, wholly=False)
        if not element.is_empty:
            self._check(element)
        was_explicit = element.tag in EXPLICIT_TAGS or element.tag in SUBTREES
        tag = (element.tag if was_explicit else '') if form is None else form
        if tag and tag not in EXPLICIT_TAGS and tag not in SUBTREES:
            raise GestureError(f'[form] must be one of {_KINDS} or empty, not {short_repr(tag)}')
        self._check_type(type, tag)
        if tag in SUBTREES and nodes_of(element):
            raise GestureError(f'a sub-tree has no children, and {element} has; remove them first')
        removed: dict[str, str | None] = {
            name: None
            for name in element.attributes
            if keep is not None and name not in keep and name not in ('ID', 'name') and not name.startswith('_')
        }
        edits: list[TextEdit] = []
        written = tag or type
        if tag and 'ID' in element.parts:
            edits += self.layout.value_edits(element, {'ID': type})
        elif tag:
            written = self.layout.start_tag(tag, {'ID': type}, '')[1:]
        elif was_explicit and 'ID' in element.parts:
            removed['ID'] = None
        if written != element.tag:
            start = element.offset + 1
            edits.append(TextEdit(start, start + len(element.tag), written))
            if not element.is_empty:
                edits.append(TextEdit(element.close + 2, element.close + 2 + len(element.tag), tag or type))
        return [*edits, *self.layout.value_edits(element, removed)]

    def _check_type(self, type: str, tag: str) -> None:
        problem = tree_name_problem(type) if tag in SUBTREES else model_name_problem(type)
        if not problem and not tag and (_NAME.fullmatch(type) is None or type in EXPLICIT_TAGS):
            problem = f'{short_repr(type)} cannot be the tag of a node'
        if problem:
            raise GestureError(f'{problem}; choose a node type of the palette')

    # Structure.

    @gesture
    def add_node(self, parent: str, index: int, xml: str) -> list[TextEdit]:
        """Insert XML of one or more nodes among the children of a node, or as the root of an empty tree."""
        element = self._readable(parent, wholly=False)
        tops, written = self.layout.snippet(xml)
        wrong = next((top.tag for top in tops if top.tag in _NOT_NODES), None)
        if wrong is not None:
            raise GestureError(f'<{wrong}> cannot be in a tree; give the elements of nodes only')
        self._check_room(element, len(element.children) + len(tops))
        return self._insertion(element, index, written)

    @gesture
    def remove(self, node: str) -> list[TextEdit]:
        """Remove a node with its children and comments."""
        element = self._node(node)
        assert element.parent is not None
        self._check(element.parent, wholly=False)
        return self.layout.removal(element)

    @gesture
    def move(self, node: str, parent: str, index: int) -> list[TextEdit]:
        """Move a node with its children and comments; ``index`` counts the other children of ``parent``."""
        element, target = self._node(node), self._readable(parent, wholly=False)
        assert element.parent is not None
        self._check(element.parent, wholly=False)
        if element.offset <= target.offset < element.end:
            raise GestureError(f'{element} cannot be moved into itself')
        if target is element.parent and index == target.children.index(element):
            return []
        siblings = [child for child in target.children if child is not element]
        self._check_room(target, len(siblings) + 1)
        layout = self.layout
        block = layout.block(element)
        base = layout.indentation(block.start)
        inserted = self._insertion(target, index, lambda new: layout.lifted(block, base, new), without=element)
        return [*layout.removal(element), *inserted]

    @gesture
    def wrap(self, node: str, xml_type: str, values: dict[str, str] | None = None) -> list[TextEdit]:
        """Put a node of this type, with these attributes, between a node and its parent."""
        layout, element = self.layout, self._node(node)
        is_explicit = xml_type in EXPLICIT_TAGS
        self._check_type((values or {}).get('ID', '') if is_explicit else xml_type, xml_type if is_explicit else '')
        if xml_type in SUBTREES:
            raise GestureError('a sub-tree has no children; extract the node into a sub-tree instead')
        for name, value in (values or {}).items():
            if not isinstance(value, str) or _NAME.fullmatch(name) is None:
                raise GestureError(f'[values] must map names of attributes to texts, not {short_repr({name: value})}')
        block = layout.block(element)
        start_tag, end_tag = layout.start_tag(xml_type, values or {}), f'</{xml_type}>'
        if not layout.begins_line(block.start) or layout.rest_of_line(block.end) is None:
            return [TextEdit(block.start, block.start, start_tag), TextEdit(block.end, block.end, end_tag)]
        indentation = layout.indentation(block.start)
        inner = indentation + layout.unit
        end = block.end + len(layout.blanks(block.end))
        return [
            TextEdit(block.start, block.start, start_tag + layout.line_break + inner),
            *layout.reindented(block, indentation, inner),
            TextEdit(end, end, layout.line_break + indentation + end_tag),
        ]

    @gesture
    def unwrap(self, node: str) -> list[TextEdit]:
        """Replace a node by its children. Its own comments go with it."""
        layout, element = self.layout, self._node(node)
        parent, below = element.parent, nodes_of(element)
        assert parent is not None
        if not below:
            raise GestureError(f'{element} has no children that could take its place; remove it instead')
        self._check_room(parent, len(parent.children) - 1 + len(below))
        block, opening_end = layout.block(element), layout.opening_end(element)
        first, last = layout.rest_of_line(opening_end), layout.rest_of_line(block.end)
        if first is None or last is None or not (layout.begins_line(block.start) and layout.begins_line(element.close)):
            return [TextEdit(block.start, opening_end, ''), TextEdit(element.close, block.end, '')]
        child = layout.block(below[0]).start
        close = layout.lines.start(element.close)
        moved = layout.reindented(Span(first - 1, close), layout.indentation(child), layout.indentation(block.start))
        lines = TextEdit(layout.lines.start(block.start), first, ''), TextEdit(close, last, '')
        return [lines[0], *(moved if layout.begins_line(child) else ()), lines[1]]

    @gesture
    def set_comment(self, node: str, text: str | None) -> list[TextEdit]:
        """Set the note of a node or a tree: the comments above it, or else the one behind it; None removes it."""
        layout, element = self.layout, self._readable(node, wholly=False)
        note, span = self._note(element)
        text = None if text is None or not text.strip() else LINE_BREAK.sub('\n', text.strip())
        if text is None:
            if span is None:
                return []
            return [self._without_note(element, span)]
        if '--' in text or text.endswith('-'):
            raise GestureError("a comment of XML cannot contain '--' or end with '-'; write – instead")
        if note == text:
            return []
        layout.quoted(text)
        lines = [line.strip() for line in text.split('\n')]
        above = span is not None or layout.begins_line(element.offset)
        indentation = layout.indentation(element.offset if span is None else span.start)
        comment = f'<!-- {f"{layout.line_break}{indentation}     ".join(lines)} -->'
        if span is not None:
            return [TextEdit(*span, comment)]
        if above:
            return [TextEdit(element.offset, element.offset, comment + layout.line_break + indentation)]
        return [TextEdit(element.end, element.end, f' {comment}')]

    def _without_note(self, element: XmlElement, span: Span) -> TextEdit:
        layout = self.layout
        next_line = layout.rest_of_line(span.end)
        if span.start > element.offset:
            return TextEdit(len(self.text[: span.start].rstrip(' \t')), span.end, '')
        if next_line is None:
            return TextEdit(span.start, element.offset, '')
        return TextEdit(layout.lines.start(span.start), next_line, '')

    # Trees, includes and models.

    @gesture
    def add_tree(self, id: str, xml: str | None = None) -> list[TextEdit]:
        """Add a tree behind the other trees, with the XML of its root, or empty."""
        self._check_tree_id(id)
        inner = None
        if xml is not None:
            tops, inner = self.layout.snippet(xml)
            if len(tops) != 1:
                raise GestureError(f'a tree has 1 root, and this XML has {len(tops)} elements; use a Sequence')
        return self._new_tree(id, inner, self._place_behind('BehaviorTree', 'include'))

    def _new_tree(self, id: str, inner: Written | None, index: int) -> list[TextEdit]:
        layout, root = self.layout, self._document_root()
        end = layout.line_break + '{}</BehaviorTree>'

        def written(indentation: str) -> str:
            start = layout.start_tag('BehaviorTree', {'ID': id}, layout.empty_end if inner is None else '>')
            if inner is None:
                return start
            deeper = indentation + layout.unit
            return start + layout.line_break + deeper + inner(deeper) + end.format(indentation)

        return self._insertion(root, index, written, gap=layout.gap(root))

    def _place_behind(self, *tags: str) -> int:
        """Return the index below <root> behind the last element of the first of these tags that there is."""
        children = self._document_root().children
        for tag in tags:
            places = [index for index, child in enumerate(children, 1) if child.tag == tag]
            if places:
                return places[-1]
        return 0

    @gesture
    def remove_tree(self, id: str) -> list[TextEdit]:
        """Remove a tree with its comments. What refers to it stays."""
        tree = self._tree(id)
        self._document_root()
        return self.layout.removal(tree)

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
        return [*self.layout.value_edits(tree, {'ID': new}), *(TextEdit(*span, new) for span in uses)]

    @gesture
    def add_include(self, path: str, package: str = '') -> list[TextEdit]:
        """Include a file; with ``package``, one of the share directory of that package."""
        values = {'ros_pkg': package, 'path': path} if package else {'path': path}
        tag = self.layout.start_tag('include', values, self.layout.empty_end)
        return self._insertion(self._document_root(), self._place_behind('include'), lambda _: tag)

    @gesture
    def remove_include(self, path: str) -> list[TextEdit]:
        """No longer include a file."""
        found = [one for one in self.sections('include') if one.attributes.get('path') == path]
        if not found:
            known = [one.attributes.get('path', '') for one in self.sections('include')]
            raise GestureError(f'{short_repr(path)} is not included{did_you_mean(path, known)}')
        self._check(found[0])
        return self.layout.removal(found[0])

    @gesture
    def add_model(self, id: str, kind: str, ports: list[dict[str, str | None]]) -> list[TextEdit]:
        """Declare a node type, or a tree with kind SubTree, for editors.

        Each port has ``name`` and ``direction`` (input, output, inout), and may have ``type``, ``default`` and
        ``description``.
        """
        layout, root = self.layout, self._document_root()
        problem = tree_name_problem(id) if kind == 'SubTree' else model_name_problem(id)
        if kind not in EXPLICIT_TAGS:
            problem = f'[kind] must be one of {_KINDS}, not {short_repr(kind)}'
        if any(model.attributes.get('ID') == id for model in self.models):
            problem = f'this file has a model of [{id}] already; remove it first'
        if problem:
            raise GestureError(problem)
        lines = [self._model_port(port) for port in ports]

        def model(indentation: str) -> str:
            if not lines:
                return layout.start_tag(kind, {'ID': id}, layout.empty_end)
            inner = layout.line_break + indentation
            return inner.join(
                [layout.start_tag(kind, {'ID': id}), *(layout.unit + line for line in lines), f'</{kind}>']
            )

        def section(indentation: str) -> str:
            deeper = indentation + layout.unit
            start, end = layout.line_break + deeper, layout.line_break + indentation
            return f'<TreeNodesModel>{start}{model(deeper)}{end}</TreeNodesModel>'

        sections = self.sections('TreeNodesModel')
        if sections:
            return self._insertion(sections[0], len(sections[0].children), model)
        return self._insertion(root, len(root.children), section, gap=layout.gap(root))

    def _model_port(self, port: Any) -> str:
        """Return the text of a port of a model."""
        is_valid = isinstance(port, dict) and all(value is None or isinstance(value, str) for value in port.values())
        if not is_valid or not port.get('name') or port.get('direction') not in PORT_TAGS:
            raise GestureError(f'a port needs name and direction ({", ".join(PORT_TAGS)}), not {short_repr(port)}')
        tag = PORT_TAGS[port['direction']]
        values = {name: port[name] for name in ('name', 'type', 'default') if port.get(name) is not None}
        description = port.get('description') or ''
        self.layout.quoted(description)
        end = f'>{xml_text(description)}</{tag}>' if description else self.layout.empty_end
        return self.layout.start_tag(tag, values, end)

    @gesture
    def remove_model(self, id: str) -> list[TextEdit]:
        """Remove a model, and <TreeNodesModel> with its last one."""
        found = [model for model in self.models if model.attributes.get('ID') == id]
        if not found:
            known = [model.attributes.get('ID', '') for model in self.models]
            raise GestureError(f'this file has no model of {short_repr(id)}{did_you_mean(id, known)}')
        self._check(found[0])
        section = found[0].parent
        assert section is not None
        self._check(section, wholly=False)
        return self.layout.removal(section if len(section.children) == 1 else found[0])

    # Keys.

    @gesture
    def rename_key(self, tree: str, old: str, new: str) -> list[TextEdit]:
        """Rename a blackboard key of a tree: in values and scripts, and as port where this file uses the tree."""
        element = self._tree(tree)
        if old == new:
            return []
        if _KEY.fullmatch(new) is None or new.startswith('@') != old.startswith('@'):
            raise GestureError(f'{short_repr(new)} cannot replace the key [{old}]; use letters, digits and _')
        id, layout = element.attributes.get('ID'), self.layout
        uses = self._uses(element)
        is_shared = self.is_shared(tree, old)
        edits = self.renamed_port(id, old, new, is_shared=is_shared) if self.definition(id) is element else []
        for use in uses:
            if use.key == new:
                raise GestureError(f'tree [{tree}] uses the key [{new}] too, so the two would become one')
            if use.key == old:
                edits += self._renamed(use, new)
        for call in self._subtrees(element) if is_shared else ():
            is_user = is_autoremapped(call) and old not in arguments(call, bare=self.is_old)
            if is_user and self._may_use(call.attributes.get('ID'), old):
                edits += layout.value_edits(call, {old: self._argument(call, new)})
        if not edits:
            raise GestureError(f'tree [{tree}] has no key [{old}]{did_you_mean(old, {use.key for use in uses})}')
        return edits

    def is_shared(self, tree: str, key: str) -> bool:
        """Return whether a tree uses a key that is also that of a tree around it which hands over all keys."""
        return key[:1] not in ('_', '@') and any(use.key == key for use in self._uses(self.trees[tree]))

    def renamed_port(self, id: str | None, old: str, new: str, *, is_shared: bool) -> list[TextEdit]:
        """Return the edits where this file hands a key to the tree ``id``, which gets another name in that tree.

        The keys of the trees around it stay. ``is_shared`` is that of the key in the tree.
        """
        models = [port for port in self._model_ports(id) if port.attributes.get('name') == old]
        edits = [TextEdit(*self.value_span(port, 'name'), new) for port in models]
        for call in self._calls(id):
            if new in arguments(call, bare=self.is_old):
                raise GestureError(f'{call} has a port [{new}] already; rename that first')
            edits += [
                TextEdit(*self.value_span(remap, 'internal'), new)
                for remap in call.children
                if remap.attributes.get('internal') == old
            ]
            if old in call.parts and not port_name_problem(old):
                part = call.parts[old]
                edits.append(TextEdit(part.start, part.start + len(old), new))
                if part.value.strip(' {}') == '=':
                    edits.append(TextEdit(part.value_start, part.value_end, f'{{{old}}}'))
            elif is_shared and is_autoremapped(call) and old not in arguments(call, bare=self.is_old):
                edits += self.layout.value_edits(call, {new: self._argument(call, old)})
        if edits and (problem := port_name_problem(new)):
            raise GestureError(problem)
        return edits

    def _uses(self, element: XmlElement) -> list[KeyUse]:
        try:
            return [*self.keys.uses(element)]
        except BehaviorTreeError as error:
            raise GestureError(f'a script of {element} cannot be read: {error}; fix it first') from error

    def _renamed(self, use: KeyUse, key: str) -> list[TextEdit]:
        """Return the edits that name another key at a place."""
        if use.port is not None and use.port.literal is KEYS:
            raise GestureError(f'{use.element} hands [{use.key}] over by this name; rename it there too, in the text')
        if use.form == 'script' and (problem := script_name_problem(key, self.types)):
            raise GestureError(problem)
        edit = use.edit(key)
        if edit is None:
            return self.layout.value_edits(use.element, {use.attribute: f'{{{key}}}'})
        quote = self.text[use.element.parts[use.attribute].value_end]
        return [edit._replace(text=self.layout.escaped(edit.text, quote))]

    def _argument(self, call: XmlElement, key: str) -> str:
        """Return the text of an attribute of a sub-tree that leads to a key."""
        return key if self.is_old and call.tag == 'SubTree' else f'{{{key}}}'

    def _subtrees(self, element: XmlElement) -> list[XmlElement]:
        return [one for one in element.all() if one.tag in SUBTREES]

    def _calls(self, id: str | None) -> list[XmlElement]:
        """Return the sub-trees of this file that use a tree."""
        return [one for one in self.subtrees if id is not None and one.attributes.get('ID') == id]

    def _model_ports(self, id: str | None) -> list[XmlElement]:
        models = (model for model in self.models if model.tag == 'SubTree' and model.attributes.get('ID') == id)
        return [port for model in models for port in model.children if port.tag in PORT_TAGS.values()]

    def _may_use(self, id: str | None, key: str) -> bool:
        """Return whether a tree, or a tree that shares its keys, uses a key. A tree of another file may."""
        pending, seen = [id], {id}
        for one in pending:
            tree = self.definition(one)
            if tree is None or any(use.key == key for use in self._uses(tree)):
                return True
            below = {call.attributes.get('ID') for call in self._subtrees(tree) if is_autoremapped(call)} - seen
            seen |= below
            pending += below
        return False

    @gesture
    def extract(self, node: str, id: str) -> list[TextEdit]:
        """Make a node a tree of its own, behind its tree, and use that here. The keys that it uses become ports."""
        element = self._node(node)
        self._check_tree_id(id)
        layout, tree = self.layout, self.trees[node.partition('/')[0]]
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
        shares = any(is_autoremapped(call) for call in self._subtrees(element))
        if shares:
            values['__shared_blackboard' if self.is_old else '_autoremap'] = 'true'
        for key, is_absent in inside.items():
            if key.startswith('@') or (is_absent and key not in outside):
                continue
            if key.startswith('_') and key in written and key not in outside:
                continue
            if problem := port_name_problem(key):
                raise GestureError(f'the key [{key}] cannot be a port of a sub-tree: {problem}; rename it first')
            if not shares:
                values[key] = key if self.is_old else f'{{{key}}}'
        block = layout.block(element)
        base = layout.indentation(block.start)
        call = TextEdit(*block, layout.start_tag('SubTree', values, layout.empty_end))
        index = self._document_root().children.index(tree) + 1
        return [call, *self._new_tree(id, lambda new: layout.lifted(block, base, new), index)]

    @gesture
    def inline(self, node: str) -> list[TextEdit]:
        """Replace a sub-tree by the nodes of its tree, which stays. Refused where that would not do the same."""
        call = self._node(node)
        id = call.attributes.get('ID', '')
        if call.tag not in SUBTREES:
            raise GestureError(f'{call} is no sub-tree')
        target, around = self.definition(id), self.trees[node.partition('/')[0]]
        if target is None:
            raise GestureError(f'tree [{id}] is not in this file; copy its nodes from its own file')
        self._check(target)
        if target is around or len(nodes_of(target)) != 1:
            raise GestureError(f'tree [{id}] must have one root, and not be the tree that it is put into')
        (root,) = target.children
        layout = self.layout
        edits = self._inlined(call, id, root, around)
        conditions = {name: text for name, text in call.attributes.items() if name in PRE_POST_ATTRIBUTES}
        if conditions and not PRE_POST_ATTRIBUTES.isdisjoint(root.attributes):
            raise GestureError(f'both {call} and {root} have conditions; wrap one of them first')
        edits += layout.value_edits(root, {**conditions})
        block = layout.block(root)
        text = layout.lifted(block, layout.indentation(block.start), layout.indentation(call.offset), edits=edits)
        return [TextEdit(call.offset, call.end, text)]

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
        uses = self._uses(root)
        constants = {use.key for use in uses if given.get(use.key, ('', ''))[1] is None}
        for use in uses:
            self._check_scope(use)
            text, key = given.get(use.key, ('', use.key))
            if use.key.startswith('@'):
                continue
            if use.key not in given:
                own |= set() if shares and not use.key.startswith('_') else {use.key}
            elif key is None:
                edits += self._constant(use, text)
            elif key != use.key:
                edits += self._renamed(use, key)
        written = next((use for use in uses if use.key in constants and use.writes), None)
        if written is not None:
            raise GestureError(f'{written.element} writes [{written.key}], which is a text here; pass a key instead')
        below = any(is_autoremapped(one) for one in self._subtrees(root))
        if below and (edits or own or not shares):
            raise GestureError(f'a sub-tree of [{id}] shares all its keys; this is exact only if their names stay')
        others = [one for one in self._subtrees(around) if one is not call]
        sharing = any(is_autoremapped(one) for one in [*others, *self._calls(around.attributes.get('ID'))])
        clashes = own if sharing else own & {use.key for use in self._uses(around)}
        if clashes:
            keys = ', '.join(sorted(clashes))
            raise GestureError(f'keys of [{id}] alone would be shared with others: {keys}; pass or rename them first')
        return edits

    def _check_scope(self, use: KeyUse) -> None:
        if use.form == 'own':
            raise GestureError(f'{use.element} removes [{use.key}] from its own tree only, so it has to stay in it')

    def _constant(self, use: KeyUse, text: str) -> list[TextEdit]:
        """Return the edit that writes a text where a key is read."""
        port = use.port
        kind = None if port is None else port.literal or port.type
        if use.form not in ('pointer', 'same') or port is None or port.writable or (kind and kind.from_text is None):
            raise GestureError(f'{use.element} cannot have a text in place of [{use.key}]; pass a key instead')
        return self.layout.value_edits(use.element, {use.attribute: text})
