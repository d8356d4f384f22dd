# SPDX-License-Identifier: BSD-3-Clause
"""Whether the states of a behavior and the trees that they run agree about the blackboards.

All trees that a behavior runs on a blackboard, and all states that write to it or read from it, are checked
together: what one of them writes another may read, whatever the order.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree import Blackboard, Entry, TreeKey, TreeLoadError
from flexbt_tools.tree_checks import HOST_KEYS, Diagnostic, lost_write
from flexbt_tools.trees import EntryUsage, KeyUsage, Place, lost_writes

from .findings import KEY_CLASH, LOST_WRITE, OTHER_TREE, UNREAD_KEY, UNWRITTEN_KEY, Finding
from .used_trees import TreeUse, UsedTrees


def findings_of(trees: UsedTrees, inputs: Collection[str] = ()) -> Iterator[Finding]:
    """What is found between the states and the trees, blackboard by blackboard; the keys ``inputs`` are written from
    outside."""
    yield from _other_trees(trees)
    usage = KeyUsage(trees.library)
    for name, uses in groupby(sorted(trees.uses, key=_blackboard), key=_blackboard):
        yield from _of_blackboard(name, list(uses), usage, {*HOST_KEYS, *inputs})


_WORD: Final = re.compile(r'[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+')
_LEAST: Final = 4
"""Letters that a word has at least, so that having it in common means something."""


def _other_trees(trees: UsedTrees) -> Iterator[Finding]:
    """States that are called after a tree that is there, and run one of quite another name."""
    for use in trees.uses:
        if use.key is None:
            continue
        label = use.path.rpartition('/')[2]
        own = [use.key.id, Path(use.key.file).stem]
        folder = Path(use.key.file).parent
        beside = sorted(file.stem for file in folder.glob('*.xml')) if folder.is_dir() else []
        if any(set(_words(label)) & set(_words(name)) or _is_called_after(label, name) for name in own):
            continue
        others = (name for name in dict.fromkeys([*trees.library.tree_ids(), *beside]) if name not in own)
        other = next((name for name in others if _is_called_after(label, name)), '')
        if other:
            message = f'it runs the tree [{use.key.id}] of {use.key.file}, and there is a tree {other!r}'
            yield Finding(OTHER_TREE, use.path, message)


def _words(name: str) -> list[str]:
    return [word.lower() for word in _WORD.findall(name) if len(word) >= _LEAST]


def _is_called_after(label: str, tree: str) -> bool:
    """Return whether one name is the beginning of the other: Recover of Recovery."""
    one, other = (re.sub(r'[^a-z0-9]', '', name.lower()) for name in (label, tree))
    return min(len(one), len(other)) >= _LEAST and (one.startswith(other) or other.startswith(one))


def _blackboard(use: TreeUse) -> str:
    return use.use.blackboard


def _of_blackboard(name: str, uses: Sequence[TreeUse], usage: KeyUsage, given: Collection[str]) -> Iterator[Finding]:
    board = Blackboard()
    usages: dict[Entry, EntryUsage] = {}
    runners = {use.key: use.path for use in uses if use.key is not None}
    for key in runners:
        try:
            usage.add(key, board, usages)
        except TreeLoadError:
            return  # the file was refused, or clashes with another on this blackboard: reported as such
    board_name = f'blackboard {name!r}' if name else 'the shared blackboard'
    keys = _Keys(board, usages, uses, runners, given)
    yield from keys.clashes()
    if any(use.runs_unknown for use in uses):
        return
    yield from keys.unread(board_name)
    yield from keys.lost_in_trees()
    yield from keys.unwritten_for_states(board_name)
    yield from keys.unwritten_for_trees(board_name)


class _Keys:
    """The keys of one blackboard."""

    def __init__(
        self,
        board: Blackboard,
        usages: dict[Entry, EntryUsage],
        uses: Sequence[TreeUse],
        runners: Mapping[TreeKey, str],
        given: Collection[str],
    ) -> None:
        self._uses = uses
        self._usages = usages
        self._runners = runners
        self._given = given
        self._of_key = {
            key: usages[entry] for key in board if (entry := board.entry(key)) is not None and entry in usages
        }
        self._names = {usage.entry: key for key, usage in self._of_key.items()}
        self._written = {key for use in uses for key in use.use.writes}
        self._read = {key for use in uses for key in use.use.reads}

    def clashes(self) -> Iterator[Finding]:
        """A state and a tree that cannot mean the same by a key."""
        for use in self._uses:
            for verb, types in (('writes', use.use.writes), ('reads', use.use.reads)):
                for key, type in types.items():
                    usage = self._of_key.get(key)
                    declared = usage.entry.type if usage is not None else None
                    if declared is not None and _clash(type, declared.name):
                        message = f'{verb} the key {key!r} as {type}; for the trees there it is {declared.name}'
                        yield Finding(KEY_CLASH, use.path, message)

    def unread(self, board: str) -> Iterator[Finding]:
        """Keys that a state writes and nothing reads."""
        for use in self._uses:
            for key in use.use.writes:
                usage = self._of_key.get(key)
                if (usage is None or not usage.is_read) and key not in self._read:
                    yield Finding(UNREAD_KEY, use.path, f'writes the key {key!r}, which nothing on {board} reads')

    def lost_in_trees(self) -> Iterator[Finding]:
        """Keys that a tree writes, and that neither a tree nor a state reads, where it is plain who should."""
        for lost in lost_writes(self._usages.values()):
            if self._names.get(lost.entry) not in self._read:
                place = lost_write(lost)
                yield Finding(LOST_WRITE, self._path(lost.writer), place.place.message, place)

    def unwritten_for_states(self, board: str) -> Iterator[Finding]:
        """Keys that a state reads and nothing writes."""
        for use in self._uses:
            for key in use.use.reads:
                usage = self._of_key.get(key)
                is_written = usage is not None and (usage.writers or usage.given)
                if not is_written and key not in self._written and key not in self._given:
                    yield Finding(UNWRITTEN_KEY, use.path, f'reads the key {key!r}, which nothing on {board} writes')

    def unwritten_for_trees(self, board: str) -> Iterator[Finding]:
        """Keys that a tree reads and nothing writes."""
        for usage in self._usages.values():
            key = self._names.get(usage.entry)
            if not usage.readers or usage.writers or usage.given or key in self._written or key in self._given:
                continue
            place = usage.readers[0]
            message = f'key [{place.use.key}] is read, and neither a state nor a tree on {board} writes it'
            yield Finding(UNWRITTEN_KEY, self._path(place), message, Diagnostic(UNWRITTEN_KEY, place.error(message)))

    def _path(self, place: Place) -> str:
        """Return the state that runs the tree; '' where several files are one."""
        return next((path for tree, path in self._runners.items() if tree.file == place.tree.source.file), '')


def _clash(type: str, declared: str) -> bool:
    """Whether a value of a state's type cannot be that of a port. Numbers and text convert to each other."""
    if type == declared or 'string' in (type, declared):
        return False
    return '/' in type or '/' in declared
