# SPDX-License-Identifier: BSD-3-Clause
"""The operator's page in a browser: a small server on the mirror, and the page, which needs no build step."""

from .access import Access
from .run import print_address, run_web, serving
from .server import MOST_PAGES, WebServer
from .station import Obstacles, PageStation, Robots

__all__ = [
    'MOST_PAGES',
    'Access',
    'Obstacles',
    'PageStation',
    'Robots',
    'WebServer',
    'print_address',
    'run_web',
    'serving',
]
