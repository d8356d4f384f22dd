# SPDX-License-Identifier: BSD-3-Clause
"""``behavior_tool show``: the state machine of a behavior as text."""

from __future__ import annotations

import argparse
import json

from flexbt_tools.behaviors import machine_lines, structure_as_json
from flexbt_tools.cli import arguments
from flexbt_tools.errors import ExitCode

from .behavior_arguments import add_parameters, built


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('name', metavar='NAME', help='installed behavior, or file (.yaml) of a machine')
    add_parameters(parser)
    arguments.add_json(parser)


def run(options: argparse.Namespace) -> ExitCode:
    behavior = built(options, options.name)
    assert behavior.machine is not None
    if options.json:
        print(
            json.dumps(
                {'behavior': behavior.name, 'states': [structure_as_json(one) for one in behavior.machine.structure()]}
            )
        )
    else:
        for line in machine_lines(behavior):
            print(line)
    return ExitCode.OK
