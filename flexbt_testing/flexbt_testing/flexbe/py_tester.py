# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's base of test cases that run ``.test`` files of a package."""

from __future__ import annotations

import unittest
from pathlib import Path
from typing import Any, ClassVar

from ament_index_python.packages import get_package_share_directory

from flexbt_testing.nodes.state_bench import StateBench

from .state_test_file import StateTestError, read_state_test
from .state_test_run import SECONDS, run_state_test


class PyTester(unittest.TestCase):
    """A case runs ``.test`` files: derive from it, and call :meth:`run_test`.

    Name the package, and the folder of the files in its share::

        class TestStates(PyTester):
            @classmethod
            def setUpClass(cls):
                PyTester._package = 'my_flexbe_states'
                PyTester._tests_folder = 'tests'
                super().setUpClass()

            def test_wait(self):
                self.run_test('wait')
    """

    _package: ClassVar[str | None] = None
    _tests_folder: ClassVar[str | None] = None
    _file_path: ClassVar[str | None] = None

    @classmethod
    def setUpClass(cls) -> None:
        """Finds the folder.

        Raises:
            StateTestError: package and folder were not named before.
        """
        super().setUpClass()
        if PyTester._package is None or PyTester._tests_folder is None:
            raise StateTestError(
                f'{cls.__name__}: set PyTester._package and PyTester._tests_folder in setUpClass(), '
                'before it calls that of its base'
            )
        PyTester._file_path = str(Path(get_package_share_directory(PyTester._package), PyTester._tests_folder))

    def setUp(self) -> None:
        """Makes a node."""
        self._bench = StateBench()
        self.addCleanup(self._bench.close)
        self.node: Any = self._bench.runtime.node

    def run_test(self, test_name: str, timeout_sec: float | None = None, max_cnt: int | None = 50) -> None:
        """Run ``test_name.test``. The time counts; ticks, as in FlexBE (``max_cnt``), there are not."""
        assert PyTester._file_path is not None
        try:
            test = read_state_test(Path(PyTester._file_path, f'{test_name}.test'))
        except StateTestError as error:
            self.fail(str(error))
        problems = run_state_test(test, self._bench, SECONDS if timeout_sec is None else timeout_sec)
        self.assertEqual(problems, [], f'{test.file} failed')
