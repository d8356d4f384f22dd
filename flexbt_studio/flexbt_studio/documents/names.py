# SPDX-License-Identifier: BSD-3-Clause
"""Names in a project: what the name at a place means, where it is used, and the edits that rename it everywhere.

Trees, blackboard keys, nodes, ports, states, outcomes, userdata keys, behaviors and their parameters have names. Other
files use them too: trees and machines, behaviors in Python, requirements of proofs and plans of mocks. What is certain
is renamed. What may mean the name, such as a text in Python, is listed as a note and never changed.
"""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import port_name_problem
from flexbt_core.monitors.requirement_text import RequirementError, parse_requirement
from flexbt_core.monitors.requirements import Has
from flexbt_core.values.text import short_repr
from flexbt_studio.errors import GestureError, StudioError
from flexbt_tools.tree_checks.check import HOST_KEYS
from flexbt_tools.trees.stand_ins import is_stand_in

from .diagnostics import Checker
from .document import Document, need
from .flow import state_keys
from .machine_document import CONTAINERS, Item, MachineDocument, State
from .project import Place, Project, tree_places
from .python_document import PythonDocument
from .text import Span, TextEdit
from .xml_document import PORT_TAGS, XmlDocument
from .xml_keys import SUBTREES, node_type
from .yaml_document import Node, Tree, YamlDocument, scalar_text

LONGEST: Final = 200
"""Maximum length of a new name, characters."""
MOST_NOTES: Final = 200
"""Maximum number of places that are listed because they may mean a name."""

_INTERFACE: Final = ('userdata', 'input_keys', 'output_keys', 'io_keys')
_RUNS_TREE: Final = 'bt_file'
"""Parameter of states that names a tree, or the file of one."""
_RUNS_BEHAVIOR: Final = 'behavior'
"""Parameter of states that names a behavior."""
_BOARD_KEYS: Final = ('goal_id', 'request_id')
"""Parameters of states that name a blackboard key."""
_NUMBERS: Final = re.compile(r'::\d+(?=/|$)')
"""What the path of a run has behind the type of a node without a name."""
_OTHER_FILES: Final = {'.py', '.yaml', '.yml', '.sh', '.md', '.json', '.toml', '.cfg'}


class Named(NamedTuple):
    """What a name means: its kind, the file that defines it, and the part of the view that owns it.

    Kinds and their owners: ``tree`` and ``key`` (the tree), ``node``, ``state`` (itself), ``outcome`` and ``userdata``
    (the container), ``behavior`` (none), ``parameter`` (the outermost container of its behavior), ``port`` (the node
    type).
    """

    kind: str
    name: str
    file: str
    owner: str


class Mention(NamedTuple):
    """A place that uses a name, or may. ``text`` says how, or why it is to be looked at."""

    file: str
    span: Span
    text: str


@dataclass
class Renaming:
    """The edits of each file, and what is to be looked at."""

    edits: dict[str, list[TextEdit]] = field(default_factory=dict)
    notes: list[Mention] = field(default_factory=list)

    def add(self, file: str, edits: Sequence[TextEdit]) -> None:
        """Add edits of a file."""
        if edits:
            self.edits.setdefault(file, []).extend(edits)


class Use(NamedTuple):
    """A place that names something."""

    span: Span
    named: Named
    is_definition: bool = False
    is_class: bool = False
    """Whether a behavior is meant by the name of its class, which is another one."""


class _Inside(NamedTuple):
    """What the states of a file stand for: ``behaviors`` and ``trees`` are those of the project by all their names."""

    file: str
    behaviors: Mapping[str, tuple[tuple[str, ...], str, State]]
    trees: Mapping[str, Place]

    def behavior(self, name: str) -> Named:
        """Return what the name of a behavior means; without a file if the project does not have it."""
        names, file, _ = self.behaviors.get(name, ((name,), '', None))
        return Named('behavior', names[0], file, '')

    def named(self, state: State, kind: str, name: str) -> Named:
        """Return what a name in a container or behavior means; without a file for a state of a class."""
        if state.kind in CONTAINERS:
            return Named(kind, name, self.file, state.path)
        if state.kind == 'behavior' and state.type in self.behaviors:
            _, file, root = self.behaviors[state.type]
            return Named(kind, name, file, root.path)
        return Named(kind, name, '', state.type)


class Names:
    """The names of a project. ``palette`` are the states as :func:`.palette.states` returns them."""

    def __init__(
        self, project: Project, registry: NodeRegistry, checker: Checker, palette: Sequence[Mapping[str, Any]]
    ) -> None:
        self._project = project
        self._registry = registry
        self._checker = checker
        self._states = {one['id']: one for one in palette}

    # What a name means.

    def at(self, file: str, offset: int) -> Named:
        """Return what the name at an offset means. Raises StudioError if there is none that can be renamed."""
        return self.use_at(file, offset).named

    def use_at(self, file: str, offset: int) -> Use:
        """Return the name at an offset, with its place. Raises StudioError if there is none that can be renamed."""
        uses = self._uses_in(file, self._project.document(file), offset=offset)
        found = [one for one in uses if one.span.start <= offset <= one.span.end and one.span.start < one.span.end]
        if not found:
            raise StudioError(f'{file}: there is no name here that can be renamed')
        use = min(found, key=lambda one: one.span.end - one.span.start)
        named = use.named
        if not named.file:
            of = f' of {named.owner}' if named.owner else ''
            raise StudioError(f'the {named.kind} {named.name}{of} is not defined in the project; rename it in its code')
        return use

    def _uses_in(
        self, file: str, document: Document, inside: _Inside | None = None, *, offset: int | None = None
    ) -> Iterator[Use]:
        """Yield the names in a file; with ``offset``, at least those there."""
        if isinstance(document, XmlDocument):
            yield from (one for one in self._in_trees(file, document, offset) if one.named.name)
        elif isinstance(document, MachineDocument):
            inside = (inside or self._inside())._replace(file=file)
            yield from (one for one in self._in_machines(document, inside) if one.named.name)

    def _inside(self) -> _Inside:
        behaviors = {
            name: found for found in reversed([*self._behaviors()]) for name in found[0]
        }  # the first one counts
        return _Inside('', behaviors, tree_places(self._project))

    def _in_trees(self, file: str, document: XmlDocument, offset: int | None) -> Iterator[Use]:
        places = tree_places(self._project, file)

        def tree_named(id: str) -> Named:
            return self._tree(id, places) if id in places else Named('tree', id, '', '')

        for element in (one for top in document.tops for one in top.all()):
            if offset is not None and not element.offset <= offset < element.open_end:
                continue
            call = element.parent if element.tag == 'remap' else element
            path, is_call = document.paths.get(call or element, ''), element.tag in SUBTREES
            tree = document.trees.get(path.partition('/')[0])
            id = node_type(element)
            if element is tree:
                yield Use(element.value_span('ID'), Named('tree', element.attributes.get('ID', ''), file, path), True)
            elif is_call:
                yield Use(element.value_span('ID'), tree_named(id))
            if (main := element.attributes.get('main_tree_to_execute')) is not None:
                yield Use(element.value_span('main_tree_to_execute'), tree_named(main))
            if element.tag in PORT_TAGS and element.parent is not None:
                name, owner = element.attributes.get('name', ''), element.parent.attributes.get('ID', '')
                is_tree = element.parent.tag in SUBTREES
                named = tree_named(owner)._replace(kind='key', name=name) if is_tree else None
                yield Use(element.value_span('name'), named or Named('port', name, file, owner), not is_tree)
            if tree is None or element is tree:
                continue
            for use in document.keys.of(element):
                yield Use(use.span, Named('key', use.key, file, document.paths[tree]), True)
            if call is not None and call is not element and call.tag in SUBTREES:
                name, runs = element.attributes.get('internal', ''), tree_named(node_type(call))
                yield Use(element.value_span('internal'), runs._replace(kind='key', name=name))
                continue
            yield Use(element.value_span('name'), Named('node', element.attributes.get('name', ''), file, path), True)
            for name, part in element.parts.items():
                if not port_name_problem(name):
                    named = tree_named(id)._replace(kind='key', name=name) if is_call else None
                    yield Use(Span(part.start, part.start + len(name)), named or Named('port', name, file, id))

    def _tree(self, id: str, places: Mapping[str, Place]) -> Named:
        document = self._project.trees(places[id].file)
        element = document.definition(id)
        assert element is not None
        return Named('tree', id, places[id].file, document.paths[element])

    def _in_machines(self, document: MachineDocument, inside: _Inside) -> Iterator[Use]:
        file = inside.file
        for head in document.behaviors:
            if head.get('name_span'):
                yield Use(Span(*head['name_span']), Named('behavior', head['name'], file, ''), True)
        for number, (_, (_, root)) in enumerate(zip(document.behaviors, document.roots, strict=False)):
            for name, span, is_definition in document.parameter_uses(number):
                yield Use(span, Named('parameter', name, file, root.path), is_definition)
        for state in document.states.values():
            for table in ('outcomes', *_INTERFACE):
                kind = 'outcome' if table == 'outcomes' else 'userdata'
                for item in state.items(table):
                    yield Use(item.name_span, Named(kind, item.key, file, state.path), True)
            children = {child.label: child for child in state.children}
            for condition in state.conditions:
                named = Named('outcome', condition.outcome.value or '', file, state.path)
                yield Use(condition.outcome.value_span, named)
                for pair in (one for one in condition.pairs.items if one.key in children):
                    child = children[pair.key]
                    yield Use(pair.key_span, Named('state', child.label, file, child.path))
                    yield Use(pair.value_span, inside.named(child, 'outcome', pair.value or ''))
            if state.parent is not None:
                yield from self._in_state(state, state.parent, inside)
        for _, item, name in self._parameters_in(document):
            item = document.default_of(item.value or '') or item
            if name == _RUNS_TREE and item.value in inside.trees:
                yield Use(item.value_span, self._tree(item.value or '', inside.trees))
            elif name == _RUNS_BEHAVIOR and item.value in inside.behaviors:
                found = inside.behavior(item.value or '')
                yield Use(item.value_span, found, is_class=item.value != found.name)

    def _in_state(self, state: State, parent: State, inside: _Inside) -> Iterator[Use]:
        """Yield the names of a state and of what leads from it."""
        file = inside.file
        yield Use(state.label_span, Named('state', state.label, file, state.path), True)
        if state.kind == 'behavior':
            found = inside.behavior(state.type)
            is_class = self._project.document(file).language == 'python' or state.type != found.name
            yield Use(state.type_span, found, is_class=is_class)
            for item in state.items('parameters'):
                yield Use(item.key_span, inside.named(state, 'parameter', item.key))
        beside = {child.label: child for child in parent.children}
        for table in ('transitions', 'autonomy'):
            for item in state.items(table):
                yield Use(item.key_span, inside.named(state, 'outcome', item.key))
        for item in state.items('transitions'):
            target = beside.get(item.value or '')
            outcome = Named('outcome', item.value or '', file, parent.path)
            yield Use(item.value_span, Named('state', target.label, file, target.path) if target else outcome)
        for item in state.items('remapping'):
            yield Use(item.key_span, inside.named(state, 'userdata', item.key))
            yield Use(item.value_span, Named('userdata', item.value or '', file, parent.path))

    # The files of a project.

    def _machines(self) -> Iterator[tuple[str, MachineDocument]]:
        for file, document in self._project.documents():
            if isinstance(document, MachineDocument):
                yield file, document

    def _behaviors(self) -> Iterator[tuple[tuple[str, ...], str, State]]:
        """Yield the names of each behavior (that of its class, too), its file, and its outermost container."""
        for file, document in self._machines():
            if isinstance(document, YamlDocument) and document.roots:
                head = document.behaviors[0]['name'] if document.behaviors else ''
                yield (head or Path(file).stem,), file, document.roots[0][1]
            for head, (_, root) in zip(document.behaviors, document.roots, strict=False):
                if isinstance(document, PythonDocument):
                    yield (head['name'], head['class']), file, root

    def _names_of(self, file: str, container: str) -> tuple[str, ...]:
        """Return the names of the behavior whose outermost container this is; none for other containers."""
        own = (names for names, one, root in self._behaviors() if (one, root.path) == (file, container))
        return next(own, ())

    def _embedding(self, names: Sequence[str]) -> Iterator[tuple[str, MachineDocument, State]]:
        """Yield the states that run a behavior with one of these names as a part of their machine."""
        for file, document in self._machines():
            for state in document.states.values():
                if state.kind == 'behavior' and state.type in names:
                    yield file, document, state

    def _callers(self, named: Named, id: str) -> Iterator[tuple[str, XmlDocument]]:
        """Yield the other files in which this ID means a tree of the file of ``named``."""
        for file, document in self._project.tree_files():
            is_used = file != named.file and document.definition(id) is None and document.tree_uses(id)
            if is_used and tree_places(self._project, file)[id].file == named.file:
                yield file, document

    def _parameters(self) -> Iterator[tuple[str, MachineDocument, State, Item, str]]:
        """Yield the parameters of states that are not in a behavior, with the names that their classes give them."""
        for file, document in self._machines():
            yield from ((file, document, *found) for found in self._parameters_in(document))

    def _parameters_in(self, document: MachineDocument) -> Iterator[tuple[State, Item, str]]:
        for state in document.states.values():
            known = self._states.get(state.type.rpartition('.')[2], {}).get('parameters', ())
            for item in state.items('parameters') if state.kind == 'state' else ():
                is_place = item.key.isdigit() and int(item.key) < len(known)
                yield state, item, known[int(item.key)]['name'] if is_place else item.key

    # Uses.

    def definition(self, named: Named) -> Place:
        """Return where something gets its name; for a key its first use in the tree. Raises StudioError."""
        uses = self._uses_in(named.file, self._project.document(named.file))
        found = [one for one in uses if one.named == named and one.span.start < one.span.end]
        found.sort(key=lambda one: not one.is_definition)
        if not found or (named.kind == 'port' and not found[0].is_definition):
            raise StudioError(f'{named.file} does not define {named.name} by a name of its own')
        return Place(named.file, found[0].span)

    def uses(self, named: Named) -> list[Mention]:
        """Return where a name is used, with what is to be looked at last."""
        if named.kind == 'key':
            return [*self._key_uses(named)]
        begin, end = ('Y' if named.name.startswith('Z') else 'Z'), ('y' if named.name.endswith('z') else 'z')
        found = self.rename(named, f'{begin}{named.name}{end}')  # differs at both ends: edits replace all of the name
        spans = [(file, Span(edit.start, edit.end)) for file, edits in found.edits.items() for edit in edits]
        return [*(Mention(file, span, named.kind) for file, span in sorted(set(spans))), *found.notes]

    def _key_uses(self, named: Named) -> Iterator[Mention]:
        document = self._project.trees(named.file)
        tree = document.trees[named.owner]
        for use in document.keys.readable(tree):
            if use.key == named.name:
                yield Mention(named.file, use.span, f'{use.role} in {use.element} [{use.attribute}]')
        id = tree.attributes.get('ID', '')
        if document.definition(id) is tree:
            for file, other in [(named.file, document), *self._callers(named, id)]:
                for call in (one for one in other.subtrees if one.attributes.get('ID') == id):
                    if named.name in call.parts:
                        part = call.parts[named.name]
                        text = f'handed to the sub-tree as {part.value or "nothing"}'
                        yield Mention(file, Span(part.start, part.start + len(named.name)), text)
                    for one in call.children:
                        if one.tag == 'remap' and one.attributes.get('internal') == named.name:
                            text = f'handed to the sub-tree as {one.attributes.get("external") or "nothing"}'
                            yield Mention(file, one.value_span('internal'), text)
        yield from self._board_notes(named)

    # Renaming.

    def rename(self, named: Named, new: str) -> Renaming:
        """Return the edits that give something another name, in all files of the project.

        Raises:
            StudioError: the name is not allowed or taken, or something that names it cannot be edited.
        """
        need(len(new) <= LONGEST, f'a name has at most {LONGEST} characters, not {len(new)}')
        made = Renaming()
        if new == named.name:
            return made
        carry_out: Callable[[Named, str, Renaming], None] = getattr(self, f'_rename_{named.kind}')
        carry_out(named, new, made)
        self._leave_others(named, made)
        for file, edits in made.edits.items():
            made.edits[file] = self._checked(file, edits)
        made.edits = {file: edits for file, edits in sorted(made.edits.items()) if edits}
        made.notes += self._notes(named, made)
        return made

    def _checked(self, file: str, edits: list[TextEdit]) -> list[TextEdit]:
        """Return edits that change something, in order. Raises StudioError if the text could not be read after them."""
        edits = sorted(dict.fromkeys(edits))
        if Path(file).suffix == '.xml' or file in {one['file'] for one in self._project.files()}:
            try:
                return self._project.document(file).checked(edits)
            except GestureError as error:
                raise StudioError(f'{file}: {error}') from error
        text = self._project.text(file)
        return [one for one in edits if text[one.start : one.end] != one.text]

    def _leave_others(self, named: Named, made: Renaming) -> None:
        """Let other machines stay, and note their places, if they may mean a tree or behavior of another file."""
        if named.kind == 'tree':
            what = 'tree'
            defined = [file for file, other in self._project.tree_files() if other.definition(named.name) is not None]
        else:
            what, behaviors = 'behavior', [*self._behaviors()]
            own = {name for names, file, _ in behaviors if file == named.file for name in names}
            defined = sorted({file for names, file, _ in behaviors if own & {*names}})
        if len(defined) < 2:
            return
        text = f'several files define this {what}: {", ".join(defined)}'
        for file, _ in self._machines():
            if file != named.file:
                made.notes += [Mention(file, Span(one.start, one.end), text) for one in made.edits.pop(file, ())]

    def _owners(self) -> Counter[str]:
        """Return how many files define a tree or a behavior of each name."""
        files = (one.trees.values() for _, one in self._project.tree_files())
        names = [{tree.attributes.get('ID', '') for tree in trees} for trees in files]
        names += [{*own} for own, _, _ in self._behaviors()]
        return Counter(name for own in names for name in own)

    def _rename_elsewhere(self, named: Named, new: str, made: Renaming) -> None:
        """Add the edits of machines, and of other files with trees, that use a name."""
        inside = self._inside()
        for file, document in self._project.documents():
            may_use = isinstance(document, MachineDocument) or (named.kind == 'tree' and file != named.file)
            is_named = any(part in document.text for part in (named.name, '\\', "''", '&#'))  # perhaps escaped
            for use in self._uses_in(file, document, inside) if may_use and is_named else ():
                if use.named == named and not use.is_class:
                    made.add(file, [document.renamed(use.span, new)])

    def _rename_tree(self, named: Named, new: str, made: Renaming) -> None:
        taken = tree_places(self._project, named.file).get(new)
        if taken is not None:
            raise StudioError(f'there is a tree [{new}] already, in {taken.file}; choose another ID')
        document = self._project.trees(named.file)
        made.add(named.file, document.gesture('rename_tree', {'id': named.owner, 'new': new}))
        self._rename_elsewhere(named, new, made)
        calls = {
            (file, tree.paths[one])
            for file, tree in [(named.file, document), *self._callers(named, named.name)]
            for one in (tree.subtrees if document.definition(named.name) is document.trees[named.owner] else ())
            if one.attributes.get('ID') == named.name and 'name' not in one.attributes  # it has the ID as its name
        }
        renamed = self._in_runs(named.file, calls, named.name, new)
        self._in_requirements(made, renamed, sections={named.name: new})

    def _rename_key(self, named: Named, new: str, made: Renaming) -> None:
        document, old = self._project.trees(named.file), named.name
        made.add(named.file, document.gesture('rename_key', {'tree': named.owner, 'old': old, 'new': new}))
        made.add(named.file, self._renamed_defaults(named, document, new))
        tree = document.trees[named.owner]
        id = tree.attributes.get('ID', '')
        if document.definition(id) is tree:
            is_shared = document.is_shared(named.owner, old)
            for file, other in self._callers(named, id):
                made.add(file, other.renamed_port(id, old, new, is_shared=is_shared))
        made.notes += self._board_notes(named)
        if old.removeprefix('@') in HOST_KEYS:
            text = f'the BT server writes [{old}] before it runs a main tree'
            made.notes.append(Mention(named.file, tree.value_span('ID'), text))

    def _renamed_defaults(self, named: Named, document: XmlDocument, new: str) -> list[TextEdit]:
        """Return the edits at sub-trees of other files whose models, in these files, let them have a key by default."""
        edits: list[TextEdit] = []
        places = tree_places(self._project, named.file)
        ids = {one.attributes.get('ID', '') for one in document.subtrees}
        elsewhere = {id for id in ids if id in places and document.definition(id) is None} - document.defaults.keys()
        for id in sorted(elsewhere):
            for port, key in self._project.trees(places[id].file).defaults.get(id, ()):
                given = document.given_by_default(named.owner, id, port, new)
                taken = f'by default, [{port}] of the sub-tree {id} is the key {new}; choose another name'
                need(key != new or not given, taken)
                edits += given if key == named.name else ()
        return edits

    def _board_notes(self, named: Named) -> Iterator[Mention]:
        """Yield the parameters of states that name a key of a blackboard: it may be that of this tree."""
        for file, document, state, item, name in self._parameters():
            value, _ = document.value(item)
            if (name in _BOARD_KEYS and value == named.name) or (isinstance(value, dict) and named.name in value):
                yield Mention(file, item.value_span, f'{state.path} [{name}] may mean this key of the blackboard')
        if named.name.startswith('@'):
            for file, other in self._project.tree_files():
                for path, tree in other.trees.items():
                    for use in other.keys.readable(tree) if (file, path) != (named.file, named.owner) else ():
                        if use.key in (named.name, named.name[1:]):
                            yield Mention(file, use.span, f'{use.element} may mean this key of the topmost tree')

    def _rename_node(self, named: Named, new: str, made: Renaming) -> None:
        document = self._project.trees(named.file)
        need(new.strip(), 'a node needs a name; remove the attribute to have none')
        edits = document.gesture('set_value', {'node': named.owner, 'name': 'name', 'value': new})
        made.add(named.file, edits)
        self._in_requirements(made, self._in_runs(named.file, {(named.file, named.owner)}, named.name, new))
        nodes = (node for _, one in self._project.tree_files() for node in one.view()['nodes'])
        everywhere = [node for node in nodes if named.name in (node['name'], node['type'])]
        for file, key in self._mock_patterns():
            if key.value == named.name and len(everywhere) == 1 and named.name not in self._registry:
                made.add(file, [TextEdit(key.start, key.end, scalar_text(new, self._project.text(file)[key.start]))])

    def _in_runs(self, near: str, nodes: set[tuple[str, str]], old: str, new: str) -> dict[str, dict[str, str]]:
        """Return other names of nodes (file and path) in the runs of the trees that have requirements, by these.

        A node is called by its path in the run, also without the numbers of those in it that have no name.
        """
        renamed: dict[str, dict[str, str]] = {}
        for section in {one.value for _, text in self._requirement_files() for one, _ in _sections(text)}:
            place = tree_places(self._project, near).get(section)
            runs = self._checker.nodes(place.file, section) if place is not None else {}
            called = {name for run, at in runs.items() if at in nodes for name in (run, _NUMBERS.sub('', run))}
            called -= {name for run, at in runs.items() if at not in nodes for name in (run, _NUMBERS.sub('', run))}
            for name in sorted(called, reverse=True):  # with its number first
                above, slash, last = name.rpartition('/')
                number = ''.join(_NUMBERS.findall(last))
                if last.removesuffix(number) == old:
                    renamed.setdefault(section, {})[name] = f'{above}{slash}{new}{number}'
        return renamed

    def _rename_port(self, named: Named, new: str, made: Renaming) -> None:
        known = self._registry.get(named.owner)
        text = f'[{named.name}] is a port of the class of {named.owner}; rename it in its code'
        if known is not None and is_stand_in(known):
            text = f'the model of {named.owner} was read at the start; rename [{named.name}] in the texts, and restart'
        need(known is None, text)
        need(not port_name_problem(new), port_name_problem(new))
        for file, document in self._project.tree_files():
            for element in document.nodes:
                if node_type(element) != named.owner or element.tag in SUBTREES:
                    continue
                is_free = new not in element.parts
                need(is_free, f'{file}: {element} has an attribute [{new}] already; choose another name')
                if named.name in element.parts:
                    made.add(file, document.renamed_attribute(element, named.name, new))
            models = (one for one in document.models if one.attributes.get('ID') == named.owner)
            ports = [(port, port.attributes.get('name')) for one in models for port in one.children]
            is_free = all(name != new for _, name in ports)
            need(is_free, f'{file}: the model of {named.owner} has a port [{new}] already; choose another name')
            made.add(file, [TextEdit(*port.value_span('name'), new) for port, name in ports if name == named.name])

    # Machines.

    def _machine(self, file: str) -> MachineDocument:
        document = self._project.document(file)
        assert isinstance(document, MachineDocument)
        return document

    def _rename_state(self, named: Named, new: str, made: Renaming) -> None:
        document = self._machine(named.file)
        made.add(named.file, document.gesture('rename_state', {'state': named.owner, 'label': new}))
        runs = self._runs_of(named.file, named.owner).items()
        renamed = {behavior: {run: f'{run.rpartition("/")[0]}/{new}' for run in own} for behavior, own in runs}
        self._in_requirements(made, renamed)

    def _runs_of(self, file: str, path: str) -> dict[str, list[str]]:
        """Return the paths of a state in the runs of each behavior, also of those that embed its behavior."""
        behaviors = [*self._behaviors()]
        found: dict[str, list[str]] = {}
        for names, owner, root in behaviors:
            pending = [(owner, root, '', 0)]
            for one, top, prefix, depth in pending:
                for state in self._machine(one).states.values():
                    if not state.path.startswith(top.path):
                        continue
                    run = f'{prefix}/{state.path.partition("/")[2]}' if state is not top else prefix or '/'
                    if (one, state.path) == (file, path):
                        found.setdefault(names[0], []).append(run)
                    inner = [(f, r) for own, f, r in behaviors if state.kind == 'behavior' and state.type in own]
                    pending += [(f, r, run, depth + 1) for f, r in inner if len(inner) == 1 and depth < 8]
        return found

    def _rename_outcome(self, named: Named, new: str, made: Renaming) -> None:
        document, old = self._machine(named.file), named.name
        gesture = {'container': named.owner, 'outcome': old, 'name': new}
        made.add(named.file, document.gesture('rename_outcome', gesture))
        names = self._names_of(named.file, named.owner)
        self._rename_elsewhere(named, new, made)
        for file, _, state, item, name in self._parameters():
            if name == _RUNS_BEHAVIOR and item.value in names:
                made.notes.append(Mention(file, state.label_span, f'{state.path} runs this behavior; see its outcomes'))
        renamed: dict[str, dict[str, str]] = {}
        for behavior, runs in self._runs_of(named.file, named.owner).items():
            marks = ['=' if run == '/' else f'{run} > ' for run in runs]
            renamed[behavior] = {f'{mark}{old}': f'{mark}{new}' for mark in marks}
        self._in_requirements(made, renamed, exact=True)

    def _rename_userdata(self, named: Named, new: str, made: Renaming) -> None:
        document, old = self._machine(named.file), named.name
        document.check_name(new, 'a key')
        container = document.container(named.owner)
        edits = [document.renamed(span, new) for span in self._declared(document, container, old, new)]
        for child in container.children:
            given = {item.value for item in child.items('remapping')}
            is_user = child.find('remapping', new) is None and self._uses_key(document, child, new)
            is_free = new not in given and not is_user
            need(is_free, f'{child.path} uses the key {new} too, so the two would become one')
            mapped = [item for item in child.items('remapping') if item.value == old]
            edits += [document.renamed(item.value_span, new) for item in mapped]
            if child.find('remapping', old) is None:  # another key of it may be mapped to this one, too
                uses = self._uses_key(document, child, old)
                if uses:
                    document.state(child.path)
                    edits += document.put(child, 'remapping', old, new, document.name)
                elif uses is None and not mapped:
                    text = f'{child.path} ({child.type}) may use the key by this name'
                    made.notes.append(Mention(named.file, child.label_span, text))
        need(edits, f'{named.owner} has no key {old}')
        made.add(named.file, edits)
        is_interface = any(container.find(table, old) for table in _INTERFACE[1:])
        is_output = any(container.find(table, old) for table in _INTERFACE[2:])
        outside = [(named.file, document, container)] if container.parent else []
        outside += self._embedding(self._names_of(named.file, named.owner))
        for file, other, state in outside:
            item = state.find('remapping', old)
            kept = state.find('default_keys', old)
            is_free = not (state.find('remapping', new) or state.find('default_keys', new))
            need(is_free, f'{file}: {state.path} names a key {new} already; remove that first')
            spans = [*([item.key_span] if item else ()), *([kept.span] if kept else ())]
            made.add(file, [other.renamed(span, new) for span in spans])
            if item is None and (is_interface if kept is None else is_output):
                made.add(file, other.put(state, 'remapping', new, old, other.name))
        runs = self._runs_of(named.file, named.owner).items()
        renamed = {behavior: {old: new, f'{{{old}}}': f'{{{new}}}'} for behavior, own in runs if '/' in own}
        self._in_requirements(made, renamed, exact=True)

    def _declared(self, document: MachineDocument, container: State, old: str, new: str) -> Iterator[Span]:
        """Yield where a container declares a userdata key."""
        for table in _INTERFACE:
            is_free = container.find(table, new) is None
            need(is_free, f'{container.path} has a key {new} already; choose another name')
            if (item := container.find(table, old)) is not None:
                yield item.name_span
        if isinstance(document, YamlDocument) and container.parent is None and (item := document.input(old)):
            yield item.key_span

    def _uses_key(self, document: MachineDocument, child: State, key: str) -> bool | None:
        """Return whether a state uses a key of its container that it names itself; None if that is not known."""
        if child.kind == 'behavior':
            own = next((root for names, _, root in self._behaviors() if child.type in names), None)
            tables = _INTERFACE[1:] if child.find('default_keys', key) is None else _INTERFACE[2:]
            return None if own is None else any(own.find(table, key) for table in tables)
        reads, writes, is_all = state_keys(document, child, self._states)
        return True if key in reads | writes else False if is_all else None

    def _rename_behavior(self, named: Named, new: str, made: Renaming) -> None:
        document = self._machine(named.file)
        document.check_name(new, 'the name of a behavior')
        others = (one for one in self._behaviors() if named.name not in one[0])
        taken = next((file for names, file, _ in others if new in names), None)
        if taken is not None:
            raise StudioError(f'{taken} has a behavior {short_repr(new)} already; choose another name')
        is_written = any(one['name'] == named.name and one.get('name_span') for one in document.behaviors)
        need(is_written, f'{named.file} does not write the name of its behavior; rename the file, or add name:')
        self._rename_elsewhere(named, new, made)
        self._in_requirements(made, {}, sections={named.name: new})

    def _rename_parameter(self, named: Named, new: str, made: Renaming) -> None:
        document = self._machine(named.file)
        number = next(n for n, (_, root) in enumerate(document.roots) if root.path == named.owner)
        gesture = {'name': named.name, 'new': new, 'behavior': number}
        made.add(named.file, document.gesture('rename_behavior_parameter', gesture))
        self._rename_elsewhere(named, new, made)

    # Requirements and plans.

    def _requirement_files(self) -> Iterator[tuple[str, str]]:
        known = {one['file'] for one in self._project.files()}
        yield from (pair for pair in self._project.texts_with({'.yaml', '.yml'}) if pair[0] not in known)

    def _mock_patterns(self) -> Iterator[tuple[str, Node]]:
        for file, text in self._requirement_files():
            root = Tree(text).root
            for key, value in root.pairs() if root is not None else ():
                if key.value == 'mocks':
                    yield from ((file, one) for one, _ in value.pairs() if one.kind == 'scalar')

    def _in_requirements(
        self,
        made: Renaming,
        renamed: Mapping[str, Mapping[str, str]],
        *,
        sections: Mapping[str, str] | None = None,
        exact: bool = False,
    ) -> None:
        """Add the edits of files of requirements: names by the section, that of a behavior or tree, and sections.

        A path also stands for what is below it, unless it is ``exact``. Where several files define what a section is
        about, it stays.
        """
        owners = self._owners()
        for file, text in self._requirement_files():
            for section, lines in _sections(text):
                new = (sections or {}).get(section.value)
                is_unsure = owners[section.value] > 1
                if new is not None and not is_unsure:
                    made.add(file, [_replaced(text, section, new)])
                for line in lines if renamed.get(section.value) else ():
                    names = renamed[section.value]
                    after = _renamed_requirement(line.value, names, exact)
                    if after is None or (after != line.value and is_unsure):
                        made.notes.append(Mention(file, Span(line.start, line.end), 'this requirement may mean it'))
                    elif after != line.value:
                        made.add(file, [_replaced(text, line, after, is_line=True)])

    # What is to be looked at.

    def _notes(self, named: Named, made: Renaming) -> Iterator[Mention]:
        """Yield the places that may mean a name: texts of Python, words of other files, what cannot be read."""
        word = re.escape(named.name)
        python = re.compile(rf"""(?<=(["']))(?:[^"'\s]*/)?({word})(?=\1)|(?<=userdata\.)({word})\b""")
        marked = re.compile(rf"""(?<=["'`/{{])()({word})(?=["'`/}}])""")
        plain = re.compile(rf'(?<![\w.-])()({word})(?![\w.-])')
        count = 0
        known = {one['file'] for one in self._project.files()}
        for file, document in self._project.documents():
            if file != named.file and document.problems and named.name in document.text:
                yield Mention(file, document.problems[0].span, 'the file cannot be read wholly; look in its text')
        for file, text in self._project.texts_with(_OTHER_FILES):
            suffix = Path(file).suffix
            is_machine = file in known and suffix != '.py'
            if named.name not in text or is_machine:
                continue
            taken = [Span(one.start, one.end) for one in made.edits.get(file, ())]
            taken += [one.span for one in made.notes if one.file == file]
            taken += _known_spans(self._machine(file)) if file in known else []
            form = python if suffix == '.py' else marked if suffix == '.md' else plain
            for found in form.finditer(text):
                span = Span(*found.span(2 if found[2] is not None else 3))
                if any(one.start <= span.start <= one.end for one in taken):
                    continue
                count += 1
                if count > MOST_NOTES:
                    yield Mention(file, span, f'and more: only {MOST_NOTES} are listed')
                    return
                yield Mention(file, span, 'a text that may mean it')


def _known_spans(document: MachineDocument) -> list[Span]:
    """Return the names in the machines of a file: what they mean is known."""
    tables = ('outcomes', *_INTERFACE, 'transitions', 'autonomy', 'remapping')
    items = [item for state in document.states.values() for table in tables for item in state.items(table)]
    labels = [state.label_span for state in document.states.values()]
    return [*labels, *(item.key_span for item in items), *(item.value_span for item in items)]


def _sections(text: str) -> Iterator[tuple[Node, list[Node]]]:
    """Yield names and lines of the lists of requirements of a text in YAML: each has at least one requirement."""
    root = Tree(text).root
    for key, value in root.pairs() if root is not None else ():
        is_list = key.kind == 'scalar' and value.kind == 'sequence' and all(one.kind == 'scalar' for one in value.parts)
        if is_list and any(_is_requirement(one.value) for one in value.parts):
            yield key, value.parts


def _is_requirement(line: str) -> bool:
    try:
        parse_requirement(line, '')
    except RequirementError:
        return False
    return True


def _replaced(text: str, node: Node, new: str, *, is_line: bool = False) -> TextEdit:
    """Return the edit that replaces a scalar; a plain one in a list may stay plain if it reads the same."""
    root = Tree(f'- {new}').root if is_line and node.is_plain and text[node.start] not in '\'"' else None
    parts = root.parts if root is not None else []
    is_same = [one.value for one in parts if one.is_plain] == [new] and not set(',[]{}') & (set(new) - set(node.value))
    return TextEdit(node.start, node.end, new if is_same else scalar_text(new, text[node.start]))


def _renamed_requirement(line: str, names: Mapping[str, str], exact: bool) -> str | None:
    """Return a requirement with other names; None if that is not certain."""

    def renamed(text: str) -> str:
        for old, new in names.items():
            rest = text.removeprefix(old)
            if text.startswith(old) and (not rest or (not exact and rest.startswith(('/', ' > ')))):
                return new + rest
        return text

    def mapped(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(mapped, value))
        return renamed(value) if isinstance(value, str) else value

    try:
        before = parse_requirement(line, '').requirement
        if isinstance(before, Has):
            names = {old: new for old, new in names.items() if f'{{{old}}}' not in names}
        fields = {one.name: mapped(getattr(before, one.name)) for one in dataclasses.fields(before)}
        wanted = type(before)(**fields)
        if wanted == before:
            return line
        after = line
        for old, new in names.items():
            word = re.escape(old).replace(r'\ >\ ', r'\s*>\s*')
            after = re.sub(rf'(?<![\w/]){word}(?![\w])', lambda _, new=new: new, after)  # type: ignore[misc]
        return after if parse_requirement(after, '').requirement == wanted else None
    except RequirementError:
        return None
