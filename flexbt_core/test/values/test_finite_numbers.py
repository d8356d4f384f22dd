# SPDX-License-Identifier: BSD-3-Clause
"""Numbers in data from others: no other kind of value is one, however large or odd it is."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.values.json_data import finite_number
from flexbt_core.values.yaml_data import load_yaml

SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(), st.binary(), st.lists(st.integers())
)


@given(SCALARS)
def test_whatever_it_is_it_is_a_finite_number_or_none(value: object) -> None:
    number = finite_number(value)
    assert number is None or math.isfinite(number)
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300:
        assert number == value


@pytest.mark.parametrize(
    ('text', 'number'),
    [('1', 1.0), ('-2.5', -2.5), ('1e-16', 1e-16), ('"3"', 3.0), ('9' * 400, None), ('1e400', None), ('.nan', None),
     ('-.inf', None), ('yes', None), ('x', None), ('[1]', None), ('', None)],
)  # fmt: skip
def test_yaml_is_read_as_people_mean_it(text: str, number: float | None) -> None:
    assert finite_number(load_yaml(text)) == number
