# SPDX-License-Identifier: BSD-3-Clause
"""The engine is pure Python: it needs neither ROS nor anything that is not in the standard library or in it."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import sys

class Guard:
    def find_spec(self, name, path=None, target=None):
        top = name.partition('.')[0]
        if top not in sys.stdlib_module_names and not name.startswith('flexbt_core'):
            raise ImportError(f'{name} must not be imported by the engine')

sys.meta_path.insert(0, Guard())
import importlib, pkgutil
import flexbt_core, flexbt_core.behavior_tree as package
for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):
    importlib.import_module(module.name)
imported = {'.'.join(name.split('.')[:2]) for name in sys.modules if name.startswith('flexbt_')}
below = {f'flexbt_core.{name}' for name in ('behavior_tree', 'clock', 'errors', 'skills', 'values')}
assert imported <= {'flexbt_core', *below}, imported
registry = flexbt_core.builtin_registry()
text = '<root BTCPP_format="4"><BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree></root>'
tree = flexbt_core.Tree(flexbt_core.TreeLibrary([flexbt_core.load_xml(text, 'f', registry)]), 'M')
print(tree.tick_once().name)
"""


def test_the_engine_imports_no_ros_and_starts_no_thread() -> None:
    result = subprocess.run([sys.executable, '-c', PROGRAM], capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == 'SUCCESS'
