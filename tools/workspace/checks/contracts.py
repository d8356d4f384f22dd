# SPDX-License-Identifier: BSD-3-Clause
"""A contract of our own for import-linter: a folder is entered by its front door.

In pyproject.toml::

    [[tool.importlinter.contracts]]
    name = "Rooms are entered by their front doors"
    type = "front_doors"
    packages = ["flexbt_core", ...]
    open_rooms = ["flexbt_testing.nodes", ...]
"""

from __future__ import annotations

import re

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, fields, output


class FrontDoorsContract(Contract):
    """A module in a folder below one of ``packages`` is imported from outside of that folder only by way of the folder.

    The folder's ``__init__.py`` names what is for others, which may be a whole module (``from nodes import timing``) if
    its name does not begin with an underscore. Modules directly below a package, such as its ``errors``, and those of
    ``open_rooms`` are for everybody.
    """

    type_name = 'front_doors'

    packages = fields.ListField(subfield=fields.StringField())
    open_rooms = fields.ListField(subfield=fields.StringField(), required=False, default=[])

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Checks every direct import of a module that is two levels or more below its package, and is no folder."""
        found: list[str] = []
        for package in self.packages:
            for module in sorted(graph.find_descendants(package)):
                room, _, name = module.rpartition('.')
                if room == package or room in self.open_rooms or graph.find_children(module):
                    continue
                whole = re.compile(rf'from \S*\b{room.rpartition(".")[2]} import\b')
                for importer in sorted(graph.find_modules_that_directly_import(module)):
                    if importer == room or importer.startswith(f'{room}.'):
                        continue
                    for place in graph.get_import_details(importer=importer, imported=module):
                        if name.startswith('_') or not whole.match(place['line_contents'].strip()):
                            found.append(f'{importer}:{place["line_number"]} imports {module}: take it from {room}')
        return ContractCheck(kept=not found, metadata={'found': found})

    def render_broken_contract(self, check: ContractCheck) -> None:
        for line in check.metadata['found']:
            output.print_error(line)
