# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors for the tools: built with their parameters but never run, and the trees that they use."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import EntryPoint, entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Final

from flexbt_common.files import resolve_file
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.state_machine.authoring.yaml_form import machine_error, read_machine
from flexbt_core.state_machine.model.definition import MachineDefinition, StateDefinition
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_core.values.findings import FindingRecord
from flexbt_core.values.text import did_you_mean
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_onboard.behaviors.behavior_library import (
    ENTRY_POINT_GROUP,
    BehaviorEntry,
    BehaviorLibrary,
    described,
    load_entry,
    machine_entry,
    new_behavior,
)
from flexbt_onboard.behaviors.machine_behavior import installed_states
from flexbt_onboard.behaviors.run_building import definition_of
from flexbt_onboard.behaviors.run_context import building
from flexbt_onboard.errors import OnboardError
from flexbt_states.goal_call import BtUse, UsesBtServer
from flexbt_tools.errors import RefusedError, UsageError
from flexbt_tools.files import read_text_file
from flexbt_tools.tree_checks.diagnostics import Diagnostic
from flexbt_tools.trees.files import read_library, shown_name

from .findings import BROKEN_TREE, NO_TREE, Finding

HOSTS_GROUP: Final = 'flexbt.behavior_hosts'
"""Entry point group of functions that make another interface of behaviors importable. They return a function that takes
a class and its file, and returns the entry of a behavior with that interface, or None."""
_PYTHON_FILE: Final = re.compile(r'(.+\.py)(?::(\w+))?', re.DOTALL)
_MAX_BYTES: Final = 4_000_000
"""Maximum size of the file of a machine, bytes."""


@dataclass(frozen=True)
class BuiltBehavior:
    """A behavior and its state machine, which is None if there are ``problems``. ``records`` are the same, with their
    places, if they are of the machine."""

    name: str
    machine: MachineDefinition | None
    problems: Sequence[str] = ()
    records: Sequence[FindingRecord] = ()


def build(entry: BehaviorEntry, arguments: Sequence[tuple[str, str]]) -> BuiltBehavior:
    """Build the machine of an installed behavior, as the executive does at a start."""
    try:
        with building(), redirect_stdout(sys.stderr):  # what the code prints is no result of a tool
            behavior = entry.instantiate()
            behavior.set_arguments(arguments)
            return BuiltBehavior(entry.name, definition_of(behavior))
    except MachineError as error:
        return BuiltBehavior(entry.name, None, error.problems, error.records)
    except OnboardError as error:
        return BuiltBehavior(entry.name, None, [str(error)])
    except (Exception, SystemExit) as error:  # code of the behavior
        return BuiltBehavior(entry.name, None, [f'create() raised {described(error, entry.file)}'])


def machine_file(name: str) -> Path | None:
    """Return the file of a machine if the name is one; None for the name of an installed behavior."""
    file = Path(name)
    return file if file.suffix in ('.yaml', '.yml') else None


def behavior_entry(name: str) -> BehaviorEntry:
    """Return the only behavior of :func:`behavior_entries`. Raises UsageError also if there are several."""
    entry, *others = behavior_entries(name)
    if others:
        classes = ', '.join(one.name for one in (entry, *others))
        raise UsageError(f'{name} has several behaviors: {classes}; name a class: {name}:CLASS')
    return entry


def behavior_entries(name: str) -> list[BehaviorEntry]:
    """Return the installed behavior with this name, the machine in this file, or the behaviors of this Python file.

    ``FILE.py:CLASS`` is one behavior of a Python file. Such a file is imported. Raises UsageError.
    """
    if machine_file(name) is not None:
        return [machine_file_entry(name, read_text_file(name, _MAX_BYTES))]
    found = _PYTHON_FILE.fullmatch(name)
    return installed([name]) if found is None else _python_entries(Path(found[1]).resolve(), found[2] or '')


def _python_entries(file: Path, wanted: str) -> list[BehaviorEntry]:
    """Return the behaviors of a Python file, or that of its class ``wanted``. Raises UsageError."""
    if not file.is_file():
        raise UsageError(f'{file}: there is no such file')
    hosts = [point.load()() for point in entry_points(group=HOSTS_GROUP)]
    try:
        with redirect_stdout(sys.stderr):
            module = _imported(file)
    except (Exception, SystemExit) as error:  # foreign code may raise anything
        raise UsageError(f'it cannot be imported: {described(error, str(file))}') from error
    found = []
    for name, one in vars(module).items():
        if not isinstance(one, type) or one.__module__ != module.__name__ or wanted not in ('', name):
            continue
        if issubclass(one, Behavior) and one.create is not Behavior.create:
            found.append(load_entry(EntryPoint(name, f'{module.__name__}:{name}', ENTRY_POINT_GROUP)))
        found += [entry for host in hosts if (entry := host(one, file)) is not None]
    if not found:
        raise UsageError(f'{file} has no class {wanted or "with create()"} that is derived from Behavior')
    return found


def _imported(file: Path) -> ModuleType:
    """Import a file as a module of the packages around it, anew. Its package is before one that is installed."""
    root, above = file.parent, ''
    while (root / '__init__.py').is_file():
        root, above = root.parent, f'{root.name}.{above}'
    word = re.sub(r'\W', '_', file.stem)  # of a file such as round-2.py, which nothing imports by its name
    name = above + word
    package = name.partition('.')[0]
    others = set() if package != name else {one.name for one in root.glob('*.py')}
    for known, module in list(sys.modules.items()):
        is_other = Path(getattr(module, '__file__', None) or '').name in others and known not in sys.stdlib_module_names
        if (package != name and known.partition('.')[0] == package) or (is_other and '.' not in known):
            del sys.modules[known]
    sys.path.insert(0, str(root))
    importlib.invalidate_caches()
    if above and word == file.stem:
        return importlib.import_module(name)
    if above:
        importlib.import_module(above.rstrip('.'))
    is_another = word != file.stem or name in sys.stdlib_module_names
    spec = spec_from_file_location(f'{name}_behavior' if is_another else name, file)
    assert spec is not None and spec.loader is not None
    sys.modules[spec.name] = module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def machine_file_entry(name: str, text: str) -> BehaviorEntry:
    """Return the behavior of a machine file with this text. Its problems are told when it is built."""
    file = Path(name)
    try:
        return machine_entry(file.stem, text, '', name)
    except MachineError as error:
        return BehaviorEntry(
            file.stem, '', BehaviorManifest(file.stem), (), partial(_refuse, text, name, error.records)
        )


def _refuse(text: str, name: str, records: Sequence[FindingRecord]) -> Behavior:
    """Raise the problems of a head, and those of the machine below it."""
    found = list(records)
    try:
        read_machine(text, installed_states()[0], name, behaviors=new_behavior)
    except MachineError as error:
        found += error.records
    raise machine_error(found)


def installed(names: Sequence[str]) -> list[BehaviorEntry]:
    """Return the behaviors with these names, or all. Raises UsageError."""
    library = BehaviorLibrary.discover()
    try:
        return [library.find(name) for name in names] if names else list(library.entries.values())
    except OnboardError as error:
        raise UsageError(str(error)) from error


# The trees that a behavior uses: the files that contain them, and the states that run them.

_SUFFIX = '.xml'


@dataclass(frozen=True)
class TreeUse:
    """A state that uses the BT server. ``key`` is the tree that it runs; None if it runs none, or an unknown one."""

    path: str
    use: BtUse
    key: TreeKey | None = None

    @property
    def runs_unknown(self) -> bool:
        """True if it runs an unknown tree."""
        return self.use.tree is not None and self.key is None


@dataclass
class UsedTrees:
    """The trees of a behavior, and problems with their names in the behavior."""

    uses: Sequence[TreeUse] = ()
    library: TreeLibrary = field(default_factory=lambda: TreeLibrary([]))
    findings: list[Finding] = field(default_factory=list)


def used_trees(machine: MachineDefinition, files: Sequence[str], registry: NodeRegistry) -> UsedTrees:
    """Find the trees that the states of a machine load and run. ``files`` are further tree files."""
    found = UsedTrees()
    uses = list(_uses(machine))
    paths: dict[str, str] = dict.fromkeys(files, '')  # path of a file on disk: the state that names it
    texts: dict[str, bytes] = {}
    mains: dict[str, str] = {}  # file name in the behavior: the file on disk
    for path, use in uses:
        for name in (*use.files, *([use.tree] if use.tree is not None and use.tree.endswith(_SUFFIX) else [])):
            if name in mains:
                continue
            # The state has checked that the file exists.
            mains[name] = name if name.startswith('/') else str(resolve_file(name))
            paths.setdefault(mains[name], path)
        if use.xml:
            name = f'<xml of {path}>'
            texts[name] = use.xml.encode()
            paths[name] = path
    found.library, broken = _read(list(paths), texts, registry, paths)
    found.findings += broken
    is_complete = not found.findings
    for path, use in uses:
        key = _key(use, found.library, mains)
        if key is None and use.tree and is_complete:
            found.findings.append(_no_tree(path, use.tree, found.library))
        found.uses = [*found.uses, TreeUse(path, use, key)]
    return found


def _uses(machine: MachineDefinition) -> Iterator[tuple[str, BtUse]]:
    for node in machine.nodes():
        state: object = node.state.unwrapped if isinstance(node, StateDefinition) else None
        if isinstance(state, UsesBtServer):
            yield node.path, state.bt_use


def _read(
    files: Sequence[str], texts: Mapping[str, bytes], registry: NodeRegistry, owners: Mapping[str, str]
) -> tuple[TreeLibrary, list[Finding]]:
    """Return one library of the files. If some files are rejected, return a library of the others, and the findings."""
    try:
        return read_library(files, registry, texts), []
    except RefusedError as refused:
        by_shown_name = {shown_name(file): path for file, path in owners.items()}
        findings = [
            Finding(BROKEN_TREE, by_shown_name.get(error.file, ''), error.message, Diagnostic(BROKEN_TREE, error))
            for error in refused.errors
        ]
        bad = {error.file for error in refused.errors}
        good = [file for file in files if shown_name(file) not in bad]
        if not good or len(good) == len(files):
            return TreeLibrary([]), findings
        library, further = _read(good, texts, registry, owners)
        return library, [*findings, *further]


def _key(use: BtUse, library: TreeLibrary, mains: Mapping[str, str]) -> TreeKey | None:
    if not use.tree:
        return None
    if not use.tree.endswith(_SUFFIX):
        return library.find(use.tree)
    document = library.documents.get(shown_name(mains.get(use.tree, '')))
    return None if document is None or document.main is None else TreeKey(document.file, document.main)


def _no_tree(path: str, tree: str, library: TreeLibrary) -> Finding:
    known = library.tree_ids()
    if tree.endswith(_SUFFIX):
        return Finding(NO_TREE, path, f'{tree} has several trees and does not say which is the main one')
    remedy = did_you_mean(tree, known, f'; known: {", ".join(known) or "none"}')
    message = f'no tree {tree!r} in the files that the behavior loads{remedy}; name files of the server by --trees'
    return Finding(NO_TREE, path, message)
