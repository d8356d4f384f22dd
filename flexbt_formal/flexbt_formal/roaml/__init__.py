# SPDX-License-Identifier: BSD-3-Clause
"""Models in the format of AS2FM (RoAML): trees, plugins and nodes as automata, and properties in JANI.

::

    model = Model('main.xml')                       # TreeLoadError tells file, line, what is wrong
    for one in model.properties:
        print(one.name, check(model, one).value)    # ModelFault: the model computes what has no value

The tree is FlexBT's, with its own nodes; the automata of plugins answer its ticks.
"""

from flexbt_formal.roaml.language import ModelError, ModelFault

from .checking import CheckProgress, Limits, Method, Result, check
from .model import Model, is_model
from .paths import Order
from .properties import Property

__all__ = [
    'CheckProgress',
    'Limits',
    'Method',
    'Model',
    'ModelError',
    'ModelFault',
    'Order',
    'Property',
    'Result',
    'check',
    'is_model',
]
