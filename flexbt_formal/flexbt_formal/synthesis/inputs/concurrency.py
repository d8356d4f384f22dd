# SPDX-License-Identifier: BSD-3-Clause
"""Which capabilities may be active at once."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import Final, NamedTuple

from .capability_file import Capability, CapabilityFile
from .interface import Interface

_NAME: Final = re.compile(r'[A-Za-z_]\w*')


def concurrent_pairs(file: CapabilityFile, interfaces: Mapping[str, Interface]) -> list[tuple[str, str]]:
    """The pairs, each in the order of names: of capabilities that say which resources they have for themselves, share
    none, and do not change what the other one reads or changes.

    Pairs suffice: of several each two have to be one. A pre-condition holds then as long as the capability is active.
    """
    known = [one for _, one in sorted(file.capabilities.items()) if one.resources is not None]
    touched = {one.name: _Touched.by(one, interfaces[one.name]) for one in known}
    return [
        (one.name, other.name)
        for one, other in combinations(known, 2)
        if not (one.resources or frozenset()) & (other.resources or frozenset())
        and not touched[one.name].disturbs(touched[other.name])
        and not touched[other.name].disturbs(touched[one.name])
    ]


class _Touched(NamedTuple):
    """What of the memory and (``>KEY``) of userdata a capability reads, and what it changes."""

    reads: frozenset[str]
    changes: frozenset[str]

    @classmethod
    def by(cls, one: Capability, interface: Interface) -> _Touched:
        """That of a capability, which a state of this interface carries out."""
        effects = [entry.text.partition('=')[0] for entries in one.postconditions.values() for entry in entries]
        return cls(
            _names(entry.text for entry in one.preconditions) | _keys(interface.input_keys, one.userdata_in),
            _names(effects) | _keys(interface.output_keys, one.userdata_out),
        )

    def disturbs(self, other: _Touched) -> bool:
        """Whether it changes what the other one reads or changes."""
        return bool(self.changes & (other.reads | other.changes))


def _names(texts: Iterable[str]) -> frozenset[str]:
    return frozenset(name.removesuffix('_m') for text in texts for name in _NAME.findall(text))


def _keys(declared: Iterable[str] | None, remapping: Mapping[str, str]) -> frozenset[str]:
    """Keys of userdata, as the machine calls them."""
    return frozenset(f'>{remapping.get(key, key)}' for key in (*(declared or ()), *remapping))
