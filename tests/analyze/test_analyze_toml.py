"""TOML as the standard library reads it back."""

import tomllib
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from stages.analyze.toml_text import dumps

text = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)  # a lone surrogate is no text
scalar = st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | text
section = st.recursive(
    st.dictionaries(text, scalar | st.lists(scalar | st.lists(scalar, max_size=2), max_size=3), max_size=4),
    lambda inner: st.dictionaries(text, scalar | inner, max_size=4),
    max_leaves=8,
)


@given(section)
def test_what_is_written_is_read_back(values: dict[str, Any]) -> None:
    assert tomllib.loads(dumps(values)) == values


def test_what_toml_lacks_is_left_out() -> None:
    assert dumps({"a": None, "studies": {"switch": {"vary": {"policy.switch_episode": [1]}}}}) == (
        '[studies.switch.vary]\n"policy.switch_episode" = [1]\n'
    )
