# SPDX-License-Identifier: BSD-3-Clause
"""The night watch with a person at the consoles of both robots, who also says what happens in the building."""

from __future__ import annotations

from collections.abc import Callable

from flexbt_core.values import lines
from flexbt_demo_behaviors.demonstration import (
    DemoError,
    console_command,
    page_line,
    run_console,
    serve_page,
    tell_ended,
)

from .watch import Watch
from .watch_processes import ROBOTS

INTRODUCTION = """
Both robots are on their rounds; the door of the archive is jammed. Which robot do you look after, or what happens?

  alpha, beta      its screen: "?" shows the keys, "o" both robots, "q" leads back here
  mend             the door is mended
  battery ROBOT    its battery runs low
  lose ROBOT       its computer dies
  end              the night is over
"""


def run_interactive(watch: Watch, read: Callable[[str], str] = input) -> None:
    """Begin the rounds, and do what the operator says until the night is over; lines come from `read`."""
    watch.start()
    page = serve_page(watch.group)
    print(INTRODUCTION + page_line(page), flush=True)
    while True:
        tell_ended(watch.group)
        try:
            words = read('night watch> ').split()
        except EOFError:
            return
        try:
            match words:
                case ['end']:
                    return
                case [robot] if robot in ROBOTS:
                    leaving = 'you are asked again which robot you look after'
                    run_console(watch.group, console_command(leaving, robot, page))
                case ['mend']:
                    watch.building.mend_door()
                case ['battery', robot] if robot in ROBOTS:
                    watch.building.lower_battery(robot)
                case ['lose', robot] if robot in ROBOTS:
                    watch.lose(robot)
                case []:
                    pass
                case _:
                    print(f'{" ".join(words)!r}: expected alpha, beta, mend, battery ROBOT, lose ROBOT, or end')
        except DemoError as error:
            print(*lines(str(error)), sep='\n')
