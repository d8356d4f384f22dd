# SPDX-License-Identifier: BSD-3-Clause
"""Discovery of FlexBE's behaviors in the installed packages, as in FlexBE, with the parameters in their code.

A package with ``<flexbe_behaviors/>`` in the exports of its package.xml is searched. Its manifests are all ``*.xml``
below ``lib/PACKAGE/manifest``, except those whose name begins with ``#``.
"""

from __future__ import annotations

import ast
import inspect
import operator
import sys
import textwrap
import xml.etree.ElementTree as ElementTree  # of files of installed packages
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from ament_index_python.packages import get_packages_with_prefixes

from flexbt_core.values.text_files import open_regular
from flexbt_flexbe.api.behavior import Behavior
from flexbt_onboard.behaviors.behavior import BehaviorManifest, BehaviorParameter
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry, described
from flexbt_onboard.errors import ManifestError

from . import shim
from .errors import FlexbeManifestError
from .hosted_behavior import HostedBehavior, load_class
from .manifest import FlexbeManifest, read_manifest

EXPORT = 'flexbe_behaviors'
_ROS_1: Final = frozenset(('actionlib', 'moveit_commander', 'roslib', 'rospy', 'rosservice', 'rostopic', 'tf'))


def entries() -> Iterator[BehaviorEntry]:
    """Yield an entry for each manifest; the entry of an unusable one has an error. Install the shim if a behavior
    exists."""
    for package, file in manifest_files():
        try:
            source = read_manifest(file)
        except FlexbeManifestError as error:
            yield BehaviorEntry(file.stem, package, BehaviorManifest(file.stem), (), None, str(error))
            continue
        if source.package == package:  # as in FlexBE: skip a manifest that is about another package
            yield _entry(source)


def manifest_files() -> Iterator[tuple[str, Path]]:
    """Return packages and their manifest files, sorted."""
    for package, prefix in sorted(get_packages_with_prefixes().items()):
        if _exports_behaviors(Path(prefix) / 'share' / package / 'package.xml'):
            directory = Path(prefix) / 'lib' / package / 'manifest'
            for file in sorted(directory.rglob('*.xml')):
                if not file.name.startswith('#'):
                    yield package, file


def _exports_behaviors(package_xml: Path) -> bool:
    try:
        with open(package_xml, 'rb', opener=open_regular) as content:
            text = content.read()
        return EXPORT.encode() in text and ElementTree.fromstring(text).find(f'export/{EXPORT}') is not None  # noqa: S314
    except (OSError, ElementTree.ParseError, ValueError, LookupError):  # the last two for encodings
        return False


def _entry(source: FlexbeManifest) -> BehaviorEntry:
    parameters = tuple(source.manifest.parameters)
    try:
        shim.install()
        known = {parameter.name for parameter in parameters}
        of_code = tuple(one for one in code_parameters(load_class(source)) if one.name not in known)
    except (Exception, SystemExit) as error:  # the import of foreign code may raise anything
        reason = described(error) + _remedy(error)
        return BehaviorEntry(source.manifest.name, source.package, source.manifest, parameters, None, reason)
    make = partial(HostedBehavior, source, of_code)
    return BehaviorEntry(source.manifest.name, source.package, source.manifest, parameters + of_code, make)


def host() -> Callable[[type[Any], Path], BehaviorEntry | None]:
    """Install the shim. Return a function that makes the entry of a class of FlexBE in a file, without a manifest."""
    shim.install()

    def entry(found: type[Any], file: Path) -> BehaviorEntry | None:
        if not issubclass(found, Behavior) or found is Behavior or found.create is Behavior.create:
            return None
        manifest = BehaviorManifest(found.__name__)
        source = FlexbeManifest(file, found.__module__, found.__name__, manifest, frozenset(), ())
        return replace(_entry(source), file=str(file))

    return entry


def _remedy(error: BaseException) -> str:
    """Return the remedy for a failed import, if the error does not contain it."""
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return ''
    package = error.name.partition('.')[0]
    if package in _ROS_1:
        return f'; {package} is of ROS 1: bring the behavior and its states to rclpy, its __init__ to (self, node)'
    if package in shim.PACKAGES:
        return '; "Coming from FlexBE" says what is there of FlexBE'
    return f'; build or install the package that has {error.name}'


# The parameters in a behavior's code, so that the operator can also set those that its manifest lacks.
#
# The code is parsed but not run: a behavior's constructor needs a node, and may do anything.


def code_parameters(behavior_class: type[Behavior]) -> list[BehaviorParameter]:
    """Return the parameters of ``self.add_parameter('name', default)`` in a class and its bases.

    Parameters in another form are not found, but can still be set. A default is found if it is a literal value,
    arithmetic on literals, or the name of such a value in the class or its module. Other defaults count as text, which
    the code converts.
    """
    found: dict[str, BehaviorParameter] = {}
    for one in behavior_class.__mro__[: behavior_class.__mro__.index(Behavior)]:
        for name, default in _declared(one, behavior_class):
            for offered in (default, ''):
                try:
                    found.setdefault(name, BehaviorParameter(name, offered))
                    break
                except ManifestError:  # without a name, or with a default that an operator cannot write
                    continue
    return list(found.values())


def _declared(one: type[Any], behavior_class: type[Any]) -> Iterator[tuple[str, Any]]:
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(one)))
    except (OSError, TypeError, SyntaxError, ValueError):  # generated by code, or the file is gone
        return
    defaults = _Defaults(sys.modules.get(one.__module__), behavior_class, tree)
    for node in ast.walk(tree):
        match node:
            case ast.Call(
                func=ast.Attribute(value=ast.Name(id='self'), attr='add_parameter'),
                args=[ast.Constant(value=str(name)), default],
            ):
                yield name, defaults.value(default)


_PLAIN: Final = (bool, int, float, str, list, dict)
_MAKERS: Final[Mapping[str, type[Any]]] = {kind.__name__: kind for kind in _PLAIN}
_ARITHMETIC: Final[Mapping[type[ast.operator], Callable[[Any, Any], Any]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv,
}


class _Defaults:
    """An evaluator of the source text of parameter defaults, which calls no user code."""

    def __init__(self, module: ModuleType | None, behavior_class: type[Any], tree: ast.Module) -> None:
        self._module = module
        self._class = behavior_class
        self._assigned = set()  # only the running code knows their values
        for node in ast.walk(tree):
            match node:
                case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                    self._assigned.add(name)
                case ast.Attribute(value=ast.Name(id='self'), attr=name, ctx=ast.Store()):
                    self._assigned.add(f'self.{name}')

    def value(self, default: ast.expr) -> Any:
        """Return the value; None if unknown."""
        try:
            return ast.literal_eval(default)
        except (ValueError, TypeError, MemoryError, RecursionError):
            pass
        match default:
            case ast.List(elts=parts):
                return _result(lambda *values: [*values], [self.value(part) for part in parts], _PLAIN)
            case ast.Dict(keys=[*keys], values=parts) if None not in keys:
                made = [self.value(part) for part in (*filter(None, keys), *parts)]
                return _result(lambda *both: dict(zip(both, both[len(parts) :], strict=False)), made, _PLAIN)
            case ast.Name(id=name) if name not in self._assigned:
                return inspect.getattr_static(self._module, name, None)
            case ast.Attribute(value=ast.Name(id='self'), attr=name) if f'self.{name}' not in self._assigned:
                return inspect.getattr_static(self._class, name, None)
            case ast.Attribute(value=ast.Name() as owner, attr=name):
                known = self.value(owner)
                return inspect.getattr_static(known, name, None) if isinstance(known, ModuleType | type) else None
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _MAKERS:
                return _result(_MAKERS[name], [self.value(arg) for arg in args], _PLAIN)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _result(operator.neg, [self.value(operand)], (int, float))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC:
                return _result(_ARITHMETIC[type(op)], [self.value(left), self.value(right)], (int, float))
        return None


def _result(function: Callable[..., Any], values: list[Any], kinds: tuple[type[Any], ...]) -> Any:
    if not all(type(value) in kinds for value in values):
        return None
    try:
        return function(*values)
    except (TypeError, ValueError, ArithmeticError):
        return None
