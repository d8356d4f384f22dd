# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's behaviors in the installed packages, found as FlexBE finds them.

A package takes part by ``<flexbe_behaviors/>`` in the exports of its package.xml; its manifests are all ``*.xml`` below
``lib/PACKAGE/manifest``, apart from those whose name begins with ``#``.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree  # of files of installed packages
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

from ament_index_python.packages import get_packages_with_prefixes

from flexbt_core.values import open_regular
from flexbt_flexbe import shim
from flexbt_flexbe.errors import FlexbeManifestError
from flexbt_onboard.behaviors import BehaviorEntry, BehaviorManifest, described

from .code_parameters import code_parameters
from .hosted_behavior import HostedBehavior, load_class
from .manifest import FlexbeManifest, read_manifest

EXPORT = 'flexbe_behaviors'
_ROS_1: Final = frozenset(('actionlib', 'moveit_commander', 'roslib', 'rospy', 'rosservice', 'rostopic', 'tf'))


def entries() -> Iterator[BehaviorEntry]:
    """An entry for each manifest; one that cannot be used has an error. Installs the shim when there is a behavior."""
    for package, file in manifest_files():
        try:
            source = read_manifest(file)
        except FlexbeManifestError as error:
            yield BehaviorEntry(file.stem, package, BehaviorManifest(file.stem), (), None, str(error))
            continue
        if source.package == package:  # as in FlexBE: a manifest about another package is not this one's
            yield _entry(source)


def manifest_files() -> Iterator[tuple[str, Path]]:
    """Packages and their manifest files, sorted."""
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
    except (OSError, ElementTree.ParseError):
        return False


def _entry(source: FlexbeManifest) -> BehaviorEntry:
    parameters = tuple(parameter.declared for parameter in source.parameters)
    try:
        shim.install()
        known = {parameter.name for parameter in parameters}
        of_code = tuple(one for one in code_parameters(load_class(source)) if one.name not in known)
    except (Exception, SystemExit) as error:  # whatever foreign code raises when it is imported
        reason = described(error) + _remedy(error)
        return BehaviorEntry(source.manifest.name, source.package, source.manifest, parameters, None, reason)
    make = partial(HostedBehavior, source, of_code)
    return BehaviorEntry(source.manifest.name, source.package, source.manifest, parameters + of_code, make)


def _remedy(error: BaseException) -> str:
    """What to do about an import that failed, where the error does not say it."""
    if not isinstance(error, ModuleNotFoundError) or error.name is None:
        return ''
    package = error.name.partition('.')[0]
    if package in _ROS_1:
        return f'; {package} is of ROS 1: bring the behavior and its states to rclpy, its __init__ to (self, node)'
    if package in shim.PACKAGES:
        return '; "Coming from FlexBE" says what is there of FlexBE'
    return f'; build or install the package that has {error.name}'
