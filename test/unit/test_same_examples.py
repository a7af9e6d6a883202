# SPDX-License-Identifier: Apache-2.0
"""Each run of the tests tries the same random examples, whatever its worker has loaded before."""

import sys
from pathlib import Path
from types import ModuleType
from typing import List

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

MODULE = Path(__file__).parents[2] / "bench" / "chaos" / "table.py"


@pytest.mark.skipif(not settings().derandomize, reason="this run searches other examples")
def test_a_module_that_is_loaded_changes_no_example(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: List[object] = []

    @given(st.one_of(st.integers(), st.floats(), st.text()))
    @settings(max_examples=300)
    def run(value: object) -> None:
        tried.append(repr(value))

    run()
    before, tried[:] = list(tried), []
    loaded = ModuleType("loaded meanwhile")
    loaded.__file__ = str(MODULE)
    monkeypatch.setitem(sys.modules, loaded.__name__, loaded)
    run()
    assert tried == before
