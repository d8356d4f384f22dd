# SPDX-License-Identifier: BSD-3-Clause
"""A program with Groot2's port that ticks a tree until it is killed: ``ENGINE PORT FILE``.

ENGINE is ``own``, this engine, or ``library``, BehaviorTree.CPP in the wheel ``behaviortreepy``.
"""

import importlib
import sys
import time
from pathlib import Path
from typing import Any

from flexbt_core import SteadyClock, Tree, TreeLibrary, builtin_registry, load_xml
from flexbt_server.groot2.server import Groot2Server

PERIOD = 0.02


def own(port: int, text: str) -> None:
    document = load_xml(text, 'tree.xml', builtin_registry())
    tree = Tree(TreeLibrary([document]), document.main or '', clock=SteadyClock())
    with Groot2Server(port) as groot2, groot2.watch(tree):
        while True:
            tree.tick_once()
            time.sleep(PERIOD)


def library(port: int, text: str) -> None:
    bt: Any = importlib.import_module('behaviortreepy')
    tree = bt.BehaviorTreeFactory().create_tree_from_text(text)
    publisher = bt.Groot2Publisher(tree, port)
    while publisher:
        tree.tick_once()
        time.sleep(PERIOD)


if __name__ == '__main__':
    {'own': own, 'library': library}[sys.argv[1]](int(sys.argv[2]), Path(sys.argv[3]).read_text())
