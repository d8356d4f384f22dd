# SPDX-License-Identifier: BSD-3-Clause
"""The installed behaviors, found through the entry points of Python packages.

A behavior that cannot be loaded is listed with its error, so that the operator sees the reason. The other behaviors
still work.
"""

from __future__ import annotations

import functools
import importlib.resources
import inspect
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from importlib.resources.abc import Traversable
from typing import Final

from flexbt_common.values.limits import MACHINE_TEXT
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_msgs.msg import BehaviorInput as BehaviorInputMessage
from flexbt_msgs.msg import BehaviorList
from flexbt_msgs.msg import BehaviorManifest as BehaviorManifestMessage
from flexbt_msgs.msg import BehaviorParameter as BehaviorParameterMessage
from flexbt_onboard.errors import BehaviorError, BrokenBehaviorError, UnknownBehaviorError

from .behavior import Behavior, BehaviorManifest, BehaviorParameter, parameter_text
from .machine_behavior import MachineBehavior

ENTRY_POINT_GROUP: Final = 'flexbt.behaviors'
"""Entry point group under which packages list their behaviors."""

SOURCES_GROUP: Final = 'flexbt.behavior_sources'
"""Entry point group of functions that find behaviors without entry points. They yield ``BehaviorEntry`` objects."""


@dataclass(frozen=True)
class BehaviorEntry:
    """One installed behavior, usable when ``error`` is empty.

    ``name`` is the name in the manifest, or ``package/name`` if several entries use the same name. ``make`` makes a
    new behavior. ``machine`` is the YAML text of a synthesized behavior. ``file`` is the Python file of its class.
    """

    name: str
    package: str
    manifest: BehaviorManifest
    parameters: tuple[BehaviorParameter, ...]
    make: Callable[[], Behavior] | None
    error: str = ''
    machine: str = ''
    file: str = ''

    def instantiate(self) -> Behavior:
        """Make a new behavior.

        Raises:
            BrokenBehaviorError: the behavior could not be loaded.
        """
        if self.make is None:
            raise BrokenBehaviorError(f'behavior {self.name!r} of package {self.package!r} is broken: {self.error}')
        return self.make()

    def to_message(self) -> BehaviorManifestMessage:
        """Return the message that consoles show for the entry."""
        return BehaviorManifestMessage(
            name=self.name,
            package=self.package,
            description=self.manifest.description,
            author=self.manifest.author,
            parameters=[
                BehaviorParameterMessage(
                    name=parameter.name,
                    type=parameter.type,
                    default_value=parameter_text(parameter.default),
                    choices=[parameter_text(choice) for choice in parameter.choices],
                    description=parameter.description,
                    label=parameter.label,
                    unit=parameter.unit,
                    minimum='' if parameter.minimum is None else f'{parameter.minimum:.15g}',
                    maximum='' if parameter.maximum is None else f'{parameter.maximum:.15g}',
                )
                for parameter in self.parameters
            ],
            inputs=[
                BehaviorInputMessage(key=known.key, type=known.type, description=known.description, needed=known.needed)
                for known in self.manifest.inputs
            ],
            error=self.error,
            machine=self.machine if len(self.machine) <= MACHINE_TEXT else '',  # nobody can judge a truncated machine
        )


class BehaviorLibrary:
    """The behaviors that can be run, by name."""

    def __init__(self, entries: Iterable[BehaviorEntry]) -> None:
        found = list(entries)
        uses = Counter(entry.name for entry in found)
        unique = [
            replace(entry, name=f'{entry.package}/{entry.name}') if uses[entry.name] > 1 else entry for entry in found
        ]
        self._entries: dict[str, BehaviorEntry] = {}
        self._added: set[str] = set()
        for entry in sorted(unique, key=lambda entry: entry.name):
            if entry.name in self._entries:
                reason = f'package {entry.package!r} has several behaviors of this name; rename all but one'
                entry = replace(entry, make=None, error=reason)
            self._entries[entry.name] = entry

    @classmethod
    def discover(cls) -> BehaviorLibrary:
        """Find the behaviors of all installed packages. A broken package raises no error here."""
        listed = [load_entry(point) for point in entry_points(group=ENTRY_POINT_GROUP)]
        found = [entry for point in entry_points(group=SOURCES_GROUP) for entry in _entries_of_source(point)]
        return cls([*listed, *found])

    @property
    def entries(self) -> Mapping[str, BehaviorEntry]:
        """All behaviors, sorted by name."""
        return self._entries

    def to_message(self) -> BehaviorList:
        """Return the message that lists all behaviors for the consoles."""
        return BehaviorList(behaviors=[entry.to_message() for entry in self._entries.values()])

    def add(self, entry: BehaviorEntry) -> None:
        """Add a behavior, or replace the one that was added before under the same name.

        Raises:
            BehaviorError: an installed behavior has this name.
        """
        self.check_free(entry.name)
        self._added.add(entry.name)
        self._entries = dict(sorted({**self._entries, entry.name: entry}.items()))

    def check_free(self, name: str) -> None:
        """Check that a behavior of this name can be added. Raise BehaviorError like :meth:`add`."""
        if name in self._entries and name not in self._added:
            raise BehaviorError(f'an installed behavior is called {name!r}; choose another name')

    def remove(self, name: str) -> None:
        """Remove a behavior that was added. Installed behaviors stay."""
        if name in self._added:
            self._added.remove(name)
            del self._entries[name]

    def find(self, name: str) -> BehaviorEntry:
        """Return the behavior called ``name``, or ``package/name``.

        Raises:
            UnknownBehaviorError: no behavior has this name, or several packages have one.
        """
        entry = self._entries.get(name)
        if entry is not None:
            return entry
        package, _, short = name.rpartition('/')
        same = [entry for entry in self._entries.values() if entry.manifest.name == (short if package else name)]
        if package and len(same) == 1 and same[0].package == package:
            return same[0]
        if not package and same:
            choices = ' or '.join(sorted(repr(entry.name) for entry in same))
            raise UnknownBehaviorError(f'several packages have a behavior {name!r}; say {choices}')
        near, known = did_you_mean(name, self._entries, ''), ', '.join(self._entries) or 'none'
        raise UnknownBehaviorError(f'no installed behavior is called {name!r}{near} (installed: {known})')


def load_entry(point: EntryPoint) -> BehaviorEntry:
    """Load one behavior. If that fails, the entry contains the error."""
    package = point.dist.name.replace('-', '_') if point.dist is not None else point.module.partition('.')[0]
    try:
        if point.attr.endswith('.yaml'):
            return _file_entry(point, package)
        loaded = point.load()
        if not (isinstance(loaded, type) and issubclass(loaded, Behavior)):
            raise TypeError(f'{point.value} is {short_repr(loaded)}, not a class derived from Behavior')
        behavior = loaded()
        if loaded.create is Behavior.create:
            raise TypeError(f'{point.value} does not implement create()')
        parameters, file = tuple(behavior.parameters.values()), inspect.getfile(loaded)
        return BehaviorEntry(loaded.manifest.name, package, loaded.manifest, parameters, loaded, file=file)
    except (Exception, SystemExit) as error:  # importing foreign code may raise anything
        name = point.name.replace('/', '_')
        text = str(error) if isinstance(error, MachineError) else described(error)
        return BehaviorEntry(name, package, BehaviorManifest(name), (), None, text)


def machine_file(point: EntryPoint) -> Traversable:
    """Return the file of a behavior in YAML. Simulated worlds replace this function.

    Raises:
        FileNotFoundError: there is no such file.
    """
    file = importlib.resources.files(point.module) / point.attr
    if not file.is_file():
        raise FileNotFoundError(f'{point.module} has no file {point.attr}; name it in package_data of setup.py')
    return file


def _file_entry(point: EntryPoint, package: str) -> BehaviorEntry:
    def read() -> BehaviorEntry:
        file = machine_file(point)
        return machine_entry(point.name, file.read_text('utf-8'), package, str(file))

    return replace(read(), make=lambda: read().instantiate())  # as the file is then, for a start or a switch


def machine_entry(
    name: str, text: str, package: str = BehaviorManifestMessage.SYNTHESIZED, source: str = ''
) -> BehaviorEntry:
    """Return the entry of a behavior in YAML. ``name`` is used if the text gives none, and for a synthesized one.

    Raises:
        MachineError: the head of the text has problems; the error lists all of them.
    """
    make = functools.partial(MachineBehavior, name, text, source or name, new_behavior)
    behavior = make()
    is_synthesized = package == BehaviorManifestMessage.SYNTHESIZED
    return BehaviorEntry(
        name if is_synthesized else behavior.name,
        package,
        behavior.manifest,
        tuple(behavior.parameters.values()),
        make,
        machine=text if is_synthesized else '',
    )


def new_behavior(name: str) -> Behavior:
    """Make the installed behavior with this name. Raises UnknownBehaviorError, or BrokenBehaviorError."""
    return BehaviorLibrary.discover().find(name).instantiate()


def _entries_of_source(point: EntryPoint) -> Iterator[BehaviorEntry]:
    try:
        yield from point.load()()
    except Exception as error:
        package = point.module.partition('.')[0]
        yield BehaviorEntry(point.name, package, BehaviorManifest(point.name), (), None, described(error))


def described(error: BaseException, file: str = '') -> str:
    """Return the error on one line, with its place in the code of the behavior: in ``file`` if it passed through it."""
    text = ' '.join(f'{type(error).__name__}: {error}'.split())
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if 'importlib' not in frame.filename]
    own = [frame for frame in frames if frame.filename == file]
    if isinstance(error, SyntaxError) and error.filename:
        return f'{type(error).__name__}: {error.msg} ({error.filename}:{error.lineno})'
    if len(frames) <= 1 and not own:  # the code of the behavior did not raise it
        return text
    place = (own or frames)[-1]
    return f'{text} ({place.filename}:{place.lineno})'
