# SPDX-License-Identifier: BSD-3-Clause
"""A reader of behavior-tree XML, formats 4 and 3. It reports all errors of a file at once.

The rules are those of BehaviorTree.CPP 4.10 (its VerifyXML and node creation). In addition, required ports must be
given; BehaviorTree.CPP reports a missing one only when it ticks the node.
"""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Callable, Iterator
from typing import Final

from flexbt_core.behavior_tree.model.definition import (
    NodeDefinition,
    SubTreeModelPort,
    TreeDefinition,
    TreeDocument,
    port_name_problem,
    tree_name_problem,
)
from flexbt_core.behavior_tree.model.errors import BehaviorTreeError, LoadError, Source, TreeLoadError
from flexbt_core.behavior_tree.model.ports import PortDirection

from .format3 import is_format_3, make_format_4
from .node_elements import DocumentTypes, NodeReader, NodeTypes, elements_of
from .parser import MAX_BYTES, MAX_DEPTH, Element, decode, parse

MAX_INCLUDES: Final = 100

IncludeResolver = Callable[[str, 'str | None', str], 'tuple[str, str | bytes]']
"""A function (``path``, ``ros_pkg``, including file) → (file name, content); raises OSError or BehaviorTreeError."""


def load_xml(
    text: str | bytes,
    file: str,
    registry: DocumentTypes,
    *,
    include: IncludeResolver | None = None,
    max_bytes: int = MAX_BYTES,
    max_depth: int = MAX_DEPTH,
) -> TreeDocument:
    """Return the definitions of a document. ``file`` is its name in errors.

    References to sub-trees are not followed here, see TreeLibrary. Raises TreeLoadError with all errors.
    """
    loader = _Loader(registry, include, max_bytes, max_depth)
    with _without_collector():
        document = loader.load(text, file)
    if loader.errors:
        raise TreeLoadError(loader.errors)
    return document


@contextlib.contextmanager
def _without_collector() -> Iterator[None]:
    """Disable the garbage collector: loading makes no garbage, and each collection would scan the whole document."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


class _Loader:
    """A document with everything that it includes."""

    def __init__(
        self, registry: DocumentTypes, include: IncludeResolver | None, max_bytes: int, max_depth: int
    ) -> None:
        self._registry = registry
        self._include = include
        self._max_bytes = max_bytes
        self._max_depth = max_depth
        self._open_files: list[str] = []
        self._included = 0
        self.errors: list[LoadError] = []
        self._warnings: list[LoadError] = []
        self._trees: dict[str, TreeDefinition] = {}
        self._models: dict[str, dict[str, SubTreeModelPort]] = {}

    def load(self, text: str | bytes, file: str) -> TreeDocument:
        named = self._load_one(text, file)
        main = next(iter(self._trees)) if named is None and len(self._trees) == 1 else named
        return TreeDocument(
            file,
            self._trees,
            main,
            self._models,
            tuple(self._warnings),
            self._registry.scripts,
            names_main=named is not None,
        )

    def _load_one(self, text: str | bytes, file: str) -> str | None:
        """Add the definitions of one file; return the tree that it names as the main one."""
        self._open_files.append(file)
        try:
            if isinstance(text, bytes):
                text = decode(text, file, self._max_bytes)
            source = Source(file, text)
            root = parse(source, max_bytes=self._max_bytes, max_depth=self._max_depth)
        except TreeLoadError as error:
            self.errors.extend(error.errors)
            return None
        else:
            return self._read_root(source, root)
        finally:
            self._open_files.pop()

    def _read_root(self, source: Source, root: Element) -> str | None:
        if root.tag != 'root':
            self._error(source, root, 'the root element has to be <root BTCPP_format="4">')
            return None
        if is_format_3(root):
            make_format_4(root)
        else:
            self._check_format(source, root)
        # Read included trees first: trees of the file itself replace them.
        for element in root.children:
            if element.tag == 'include':
                self._read_include(source, element)
        models = [element for element in root.children if element.tag == 'TreeNodesModel']
        for element in models[1:]:
            self._error(source, element, 'only one <TreeNodesModel> is allowed in a file')
        for element in models[:1]:
            self._read_models(source, element)
        types = self._registry.types_for(elements_of(root))
        for element in root.children:
            if element.tag == 'BehaviorTree':
                self._read_tree(source, element, types, alone=len(root.children) == 1)
            elif element.tag not in ('include', 'TreeNodesModel'):
                self._warn(source, element, 'this element means nothing here, and is ignored')
        main = root.attributes.get('main_tree_to_execute')
        if main is not None and main not in self._trees and not self.errors:
            known = ', '.join(self._trees) or 'none'
            self._error(
                source,
                root,
                f'main_tree_to_execute names [{main}], which is not a tree of this file; its trees are: {known}',
                'main_tree_to_execute',
            )
        if not self._trees and not self._models and not self.errors and len(self._open_files) == 1:
            self._error(source, root, 'the document defines no <BehaviorTree>')
        return main

    def _check_format(self, source: Source, root: Element) -> None:
        format = root.attributes.get('BTCPP_format')
        if format is None:
            self._warn(source, root, 'attribute [BTCPP_format] is missing; the file is read as format 4')
        elif format.strip() != '4':
            self._warn(source, root, f'BTCPP_format "{format}" is unknown; the file is read as format 4')

    def _read_include(self, source: Source, element: Element) -> None:
        path = element.attributes.get('path')
        if path is None:
            self._error(source, element, "an <include> needs the attribute 'path'")
            return
        if self._include is None:
            self._error(source, element, f"'{path}' cannot be included: this document was loaded without a file system")
            return
        self._included += 1
        if self._included > MAX_INCLUDES:
            self._error(source, element, f'more than {MAX_INCLUDES} files are included')
            return
        try:
            file, content = self._include(path, element.attributes.get('ros_pkg'), source.file)
        except (OSError, BehaviorTreeError) as error:
            self._error(source, element, f"'{path}' cannot be included: {error}", 'path')
            return
        if file in self._open_files:
            self._error(source, element, f"'{path}' is included by itself, directly or indirectly", 'path')
            return
        self._load_one(content, file)

    def _read_models(self, source: Source, models: Element) -> None:
        for element in models.children:
            # Models of nodes are for editors. Models of trees declare ports that the engine needs to know.
            if element.tag != 'SubTree':
                continue
            id = element.attributes.get('ID')
            if id is None:
                self._error(source, element, "a <SubTree> within <TreeNodesModel> needs the attribute 'ID'")
                continue
            ports: dict[str, SubTreeModelPort] = {}
            for port in element.children:
                direction = _MODEL_PORTS.get(port.tag)
                if direction is None:
                    continue
                name = port.attributes.get('name')
                if name is None:
                    self._error(source, port, f"a port of the model of [{id}] needs the attribute 'name'")
                    continue
                if name.startswith('_'):
                    # Private: no attribute of that name is a port, so this declares nothing.
                    continue
                problem = port_name_problem(name)
                if problem:
                    self._error(source, port, problem, 'name')
                    continue
                ports[name] = SubTreeModelPort(direction, port.attributes.get('default'))
            self._models.setdefault(id, {}).update(ports)

    def _read_tree(self, source: Source, element: Element, types: NodeTypes, alone: bool) -> None:
        id = element.attributes.get('ID')
        before = len(self.errors)
        if id is None:
            if not alone:
                self._error(
                    source, element, "a <BehaviorTree> needs the attribute 'ID' when it is not alone in its file"
                )
            id = f'BehaviorTree_{len(self._trees)}'
        else:
            problem = tree_name_problem(id)
            if problem:
                self._error(source, element, problem, 'ID')
            elif id in self._registry:
                self._error(source, element, f'[{id}] is the name of a node type, and cannot name a tree', 'ID')
            elif ' ' in id:
                self._warn(source, element, f'BehaviorTree.CPP from 4.9 on refuses the blank in the name [{id}]')
        if len(element.children) != 1:
            self._error(source, element, f'a tree has exactly 1 root node, not {len(element.children)}')
        root: NodeDefinition | None = None
        for child in element.children:
            root = NodeReader(source, types, self.errors).read(child)
        if id in self._trees and self._trees[id].source is source:
            line, _ = source.position(self._trees[id].offset)
            self._warn(source, element, f'tree [{id}] of line {line} is replaced by this one')
        if len(self.errors) == before and root is not None:
            # A later definition replaces an earlier one, also in the order.
            self._trees.pop(id, None)
            self._trees[id] = TreeDefinition(id, root, source, element.offset)

    def _error(self, source: Source, element: Element, message: str, attribute: str | None = None) -> None:
        offset = element.offset_of(attribute)
        self.errors.append(source.error(offset, message, str(element)))

    def _warn(self, source: Source, element: Element, message: str) -> None:
        self._warnings.append(source.error(element.offset, message, str(element)))


_MODEL_PORTS: Final = {
    'input_port': PortDirection.INPUT,
    'output_port': PortDirection.OUTPUT,
    'inout_port': PortDirection.INOUT,
}
