# SPDX-License-Identifier: BSD-3-Clause
"""Behavior trees (BehaviorTree.CPP) and state machines (FlexBE), with skills and monitors, without ROS.

Users import everything from here; what is not listed here is not public::

    from flexbt_core import SteadyClock, Tree, TreeLibrary, builtin_registry, load_xml

    library = TreeLibrary([load_xml(text, 'mission.xml', builtin_registry())])  # TreeLoadError lists every problem
    tree = Tree(library, 'Mission', clock=SteadyClock())
    status = tree.tick_once()

The list is ``__init__.pyi``, beside this file: each public name and the module that defines it. Type checkers and
editors read it, and this module reads it the first time that a name is asked for. So importing the package loads
nothing, and importing a name loads only what that name needs: a clock comes without an engine.
"""

_modules: dict[str, str] = {}
"""Public names and the modules that define them; empty until the first name is asked for."""


def __getattr__(name: str) -> object:
    """Return a public name, importing the module that defines it on first use (PEP 562)."""
    if name == '__all__':
        return __dir__()
    if name not in _public_names():
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from importlib import import_module

    value = globals()[name] = getattr(import_module(_modules[name], __name__), name)
    return value


def __dir__() -> list[str]:
    """Return all public names, whether they have been used yet or not."""
    return sorted(_public_names())


def _public_names() -> dict[str, str]:
    if not _modules:
        import ast
        import pkgutil

        text = pkgutil.get_data(__name__, '__init__.pyi') or b''  # also from a zip file
        imports = (statement for statement in ast.parse(text).body if isinstance(statement, ast.ImportFrom))
        found = {alias.name: f'.{one.module}' for one in imports for alias in one.names}
        _modules.update(found)  # at once: another thread may ask meanwhile
    return _modules
