# SPDX-License-Identifier: BSD-3-Clause
"""The library of installed behaviors, on real distributions with real entry points."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.errors import BrokenBehaviorError, ParameterError, UnknownBehaviorError

GOOD = """
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter

class Good(Behavior):
    manifest = BehaviorManifest('{name}', 'what it does', 'its author', [BehaviorParameter('speed', 0.5, 'm/s')])

    def create(self):
        return None
"""

Install = Callable[[str, dict[str, str]], None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Installs a distribution: its modules by name, each with an entry point ``NAME = MODULE:CLASS``."""
    before = set(sys.modules)

    def install_distribution(package: str, modules: dict[str, str]) -> None:
        site = tmp_path / package
        info = site / f'{package}-1.0.dist-info'
        info.mkdir(parents=True)
        (info / 'METADATA').write_text(f'Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n')
        lines = ['[flexbt.behaviors]']
        for name, source in modules.items():
            module = f'{package}_{name}'
            (site / f'{module}.py').write_text(source)
            lines.append(f'{name} = {module}:{"Good" if "class Good" in source else "Broken"}')
        (info / 'entry_points.txt').write_text('\n'.join(lines) + '\n')
        monkeypatch.syspath_prepend(str(site))

    yield install_distribution
    for name in set(sys.modules) - before:
        del sys.modules[name]


def test_a_behavior_is_found_with_its_manifest(install: Install) -> None:
    install('patrols', {'patrol': GOOD.format(name='Patrol')})
    entry = BehaviorLibrary.discover().find('Patrol')
    message = entry.to_message()
    assert (message.name, message.package, message.description) == ('Patrol', 'patrols', 'what it does')
    assert [(p.name, p.type, p.default_value) for p in message.parameters] == [('speed', 'float', '0.5')]
    assert message.error == ''
    assert entry.instantiate() is not entry.instantiate()


def test_consoles_get_all_that_a_form_needs(install: Install) -> None:
    told = "BehaviorParameter('speed', 0.5, 'with a load', label='Top speed', unit='m/s', minimum=0, maximum=1.25)"
    inputs = "inputs=[BehaviorInput('goal', 'geometry_msgs/PoseStamped', 'where to', needed=True)]"
    source = GOOD.format(name='Patrol').replace("BehaviorParameter('speed', 0.5, 'm/s')]", f'{told}], {inputs}')
    install('patrols', {'patrol': source.replace('import Behavior,', 'import Behavior, BehaviorInput,')})
    entry = BehaviorLibrary.discover().find('Patrol')
    message, behavior = entry.to_message(), entry.instantiate()
    (speed,), (goal,) = message.parameters, message.inputs
    assert (speed.label, speed.unit, speed.minimum, speed.maximum) == ('Top speed', 'm/s', '0', '1.25')
    assert (goal.key, goal.type, goal.needed) == ('goal', 'geometry_msgs/PoseStamped', True)
    behavior.set_arguments([('speed', '1.25')])
    with pytest.raises(ParameterError, match=r'1\.5 is outside of its limits 0 to 1\.25'):
        behavior.set_arguments([('speed', '1.5')])


@pytest.mark.parametrize(
    ('source', 'words'),
    [
        ('import not_installed_anywhere', ['ModuleNotFoundError', 'not_installed_anywhere', 'broken_bad.py:1']),
        ('def f(:', ['SyntaxError']),
        ('x = 1 / 0', ['ZeroDivisionError', 'broken_bad.py:1']),
        ('import sys\nsys.exit(3)', ['SystemExit']),
        ('Broken = 3', ['not a class derived from Behavior']),
        ('', ['Broken']),
        (
            'from flexbt_onboard.behaviors.behavior import Behavior\nclass Broken(Behavior): pass',
            ['ManifestError', 'set the class attribute manifest'],
        ),
        (
            'from flexbt_onboard.behaviors.behavior import *\n'
            'class Broken(Behavior):\n  manifest = BehaviorManifest("B")\n  def __init__(self): raise OSError("disk")',
            ['OSError: disk', 'broken_bad.py:4'],
        ),
        (
            'from flexbt_onboard.behaviors.behavior import *\n'
            'class Broken(Behavior):\n  manifest = BehaviorManifest("B")',
            ['does not implement create()'],
        ),
    ],
)
def test_a_broken_behavior_is_listed_with_its_error_and_harms_no_other(
    install: Install, source: str, words: list[str]
) -> None:
    install('broken', {'bad': source})
    install('patrols', {'patrol': GOOD.format(name='Patrol')})
    library = BehaviorLibrary.discover()
    entry = library.find('bad')
    assert all(word in entry.error for word in words), entry.error
    assert '\n' not in entry.error
    assert entry.to_message().error == entry.error
    with pytest.raises(BrokenBehaviorError, match='bad'):
        entry.instantiate()
    assert library.find('Patrol').error == ''


def test_behaviors_of_the_same_name_are_told_apart_by_their_package(install: Install) -> None:
    install('north', {'patrol': GOOD.format(name='Patrol')})
    install('south', {'patrol': GOOD.format(name='Patrol')})
    library = BehaviorLibrary.discover()
    assert {'north/Patrol', 'south/Patrol'} <= set(library.entries)
    assert library.find('south/Patrol').package == 'south'
    with pytest.raises(UnknownBehaviorError, match="'north/Patrol' or 'south/Patrol'"):
        library.find('Patrol')


def test_the_package_may_always_be_said(install: Install) -> None:
    install('north', {'patrol': GOOD.format(name='Patrol')})
    library = BehaviorLibrary.discover()
    assert library.find('north/Patrol') is library.find('Patrol')
    with pytest.raises(UnknownBehaviorError):
        library.find('south/Patrol')


def test_an_unknown_name_is_refused_with_the_nearest(install: Install) -> None:
    install('north', {'patrol': GOOD.format(name='Patrol')})
    with pytest.raises(UnknownBehaviorError, match="'Patrl'; did you mean 'Patrol'"):
        BehaviorLibrary.discover().find('Patrl')


def test_a_package_with_two_behaviors_of_one_name_is_told_so(install: Install) -> None:
    install('north', {'patrol': GOOD.format(name='Patrol'), 'again': GOOD.format(name='Patrol')})
    with pytest.raises(BrokenBehaviorError, match='several behaviors of this name'):
        BehaviorLibrary.discover().find('north/Patrol').instantiate()


SOURCE = """
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry

class Foreign(Behavior):
    def __init__(self, name):
        self.manifest = BehaviorManifest(name)
        super().__init__()

def entries():
    for name in ('One', 'Two'):
        yield BehaviorEntry(name, 'elsewhere', BehaviorManifest(name), (), lambda name=name: Foreign(name))
"""


def test_another_source_of_behaviors_adds_its_own(install: Install, tmp_path: Path) -> None:
    install('finder', {'good': GOOD.format(name='Good'), 'source': SOURCE, 'bad': 'x = 1 / 0'})
    points = tmp_path / 'finder' / 'finder-1.0.dist-info' / 'entry_points.txt'
    points.write_text(
        '[flexbt.behaviors]\ngood = finder_good:Good\n'
        '[flexbt.behavior_sources]\nforeign = finder_source:entries\nbroken = finder_bad:entries\n'
    )
    library = BehaviorLibrary.discover()
    assert {'One', 'Two', 'Good', 'broken'} <= set(library.entries)
    assert library.find('Two').instantiate().name == 'Two'
    assert 'ZeroDivisionError' in library.find('broken').error
