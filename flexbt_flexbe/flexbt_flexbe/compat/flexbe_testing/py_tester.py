# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_testing.py_tester``, by flexbt_testing, which is not installed where nothing is tested.

No other module of a package that a robot has imports flexbt_testing; the linter does not see this one.
"""

from importlib import import_module

from flexbt_flexbe.errors import ShimError

try:
    PyTester = import_module('flexbt_testing.flexbe').PyTester
except ModuleNotFoundError as error:
    raise ShimError(
        f'flexbe_testing.py_tester needs the package flexbt_testing, and there is no module {error.name!r}; '
        'install flexbt_testing where tests are run'
    ) from None

__all__ = ['PyTester']
