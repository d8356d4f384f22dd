# SPDX-License-Identifier: BSD-3-Clause
"""From capabilities and a request to a supervised machine, with a proof; or to an explanation why there is none.

::

capabilities = read_capabilities(text, 'coffee.yaml', mappings)
problem = translated(capabilities, interfaces, Request(goals=('br_c',)))
result = synthesize(problem)
print(machine_as_yaml(result.machine))
"""

from .errors import SynthesisError, SynthesisTimeout
from .synthesis import Synthesis, synthesize

__all__ = ['Synthesis', 'SynthesisError', 'SynthesisTimeout', 'synthesize']
