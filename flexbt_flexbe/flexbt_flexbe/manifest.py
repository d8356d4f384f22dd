# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's behavior manifests: XML files that name a Python class and its parameters."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree  # of files of installed packages
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from flexbt_core.values.text_files import open_regular
from flexbt_onboard.behaviors.behavior import BehaviorManifest, BehaviorParameter, ParameterValue
from flexbt_onboard.errors import OnboardError

from .errors import FlexbeManifestError

_PARAMETERS: Final = ('params/param', 'params/parameter', 'param', 'parameter')
"""Paths of the parameters in manifests. FlexBE's editor writes the first; FlexBE's engine does not read them."""


_TYPES: Final = ('text', 'numeric', 'boolean', 'enum', 'yaml')
"""FlexBE's types of parameters."""


@dataclass(frozen=True)
class FlexbeManifest:
    """One manifest: the class ``class_name`` in the module ``module``, and its description for the operator.

    ``yaml`` has the names of parameters whose value may be a YAML file.
    """

    file: Path
    module: str
    class_name: str
    manifest: BehaviorManifest
    yaml: frozenset[str]
    contains: tuple[str, ...]

    @property
    def package(self) -> str:
        """Package of the behavior."""
        return self.module.partition('.')[0]


def read_manifest(file: Path) -> FlexbeManifest:
    """Read a manifest.

    Raises:
        FlexbeManifestError: it is not a manifest or has invalid content; the error names file and reason.
    """
    try:
        with open(file, 'rb', opener=open_regular) as content:
            root = ElementTree.parse(content).getroot()  # noqa: S314
        return _read(file, root)
    except (OSError, ElementTree.ParseError, OnboardError, ValueError, LookupError) as error:
        raise FlexbeManifestError(f'{file}: {error}') from None


def _read(file: Path, root: ElementTree.Element) -> FlexbeManifest:
    name = (root.get('name') or '').strip()
    executable = root.find('executable')
    if root.tag != 'behavior' or not name or executable is None:
        raise FlexbeManifestError(f'{file}: not a manifest; expected <behavior name="..."> with an <executable>')
    module, class_name = executable.get('package_path') or '', executable.get('class') or ''
    if module.count('.') < 1 or not class_name.isidentifier():
        raise FlexbeManifestError(
            f'{file}: <executable> needs package_path="package.module" and class="Name", '
            f'not package_path={module!r} class={class_name!r}'
        )
    elements = [element for path in _PARAMETERS for element in root.iterfind(path)]
    yaml = frozenset(element.get('name') or '' for element in elements if element.get('type') == 'yaml')
    manifest = BehaviorManifest(
        # A name with a slash would be read as package/name.
        name.replace('/', '-'),
        ' '.join((root.findtext('description') or '').split()),
        (root.findtext('author') or '').strip(),
        [_parameter(file, element) for element in elements],
    )
    contains = tuple(element.get('name') or '' for element in root.iterfind('contains'))
    return FlexbeManifest(file, module, class_name, manifest, yaml, contains)


def _parameter(file: Path, element: ElementTree.Element) -> BehaviorParameter:
    name, text = element.get('name') or '', element.get('default') or ''
    kind = element.get('type') or 'text'
    if kind not in _TYPES:
        raise FlexbeManifestError(f'{file}: parameter {name!r} has type {kind!r}, not {", ".join(_TYPES)}')
    label, hint = element.get('label') or '', element.get('hint') or ''
    choices = [option.get('value') or '' for option in element.iterfind('option')] if kind == 'enum' else []
    default: ParameterValue = text
    if kind == 'numeric':
        default = float(text or 0)
    elif kind == 'boolean':
        default = text.strip().lower() in ('true', '1')
    minimum, maximum = _limit(element, 'min'), _limit(element, 'max')
    return BehaviorParameter(name, default, hint, choices, label, minimum=minimum, maximum=maximum)


def _limit(element: ElementTree.Element, tag: str) -> float | None:
    found = element.find(tag)
    value = found.get('value') if found is not None else None
    return float(value) if value else None
