"""The benchmark compares implementations that do the same: all versions of the kernel give equal results."""

from __future__ import annotations

import importlib
import runpy
import shutil
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from helpers import ROOT
from helpers.peers import needs_pinocchio

pytestmark = pytest.mark.xdist_group("bench")
BENCH = ROOT / "tools" / "bench"


@pytest.fixture(scope="module")
def bench() -> Iterator[None]:
    """Adds the folder of the benchmark to the import path, once, because one of its modules compiles a large
    loop."""
    before = set(sys.modules)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCH.parent))
        patch.syspath_prepend(str(BENCH))
        yield
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", None) and str(BENCH) in str(sys.modules[name].__file__):
            del sys.modules[name]


@pytest.mark.skipif(shutil.which("cc") is None, reason="did not run: needs cc; as root: apt-get install gcc")
@pytest.mark.parametrize(
    ("taxels", "fields", "contacts"), [(30, 5, 1), (230, 5, 1), (768, 16, 5), (4000, 64, 30)]
)
def test_the_kernel_in_c_gives_equal_results(bench: None, taxels: int, fields: int, contacts: int) -> None:
    """The results of the C version must equal those of NumPy. The loop that is timed with it needs a long
    time to compile, and is compared with both versions when the benchmark runs."""
    frame = importlib.import_module("frame")
    ours = frame.Frame(taxels, fields, contacts)
    theirs = frame.InC(ours)
    assert theirs() > 0
    # On a cone two faces may have equal distances to the mean of a contact. Then rounding determines which
    # face is chosen.
    np.testing.assert_allclose(theirs.gains, ours.numpy(), atol=2e-3)
    assert theirs.gains.max() > 0.0
    ours.show(np.full(ours.values.shape[1], 240, np.uint8))
    assert theirs() == 0


def test_every_case_is_there(bench: None) -> None:
    needs_pinocchio()
    cases = runpy.run_path(str(BENCH / "__main__.py"), run_name="cases")["CASES"]
    for place in cases.values():
        module, function = place.split(":")
        assert callable(getattr(importlib.import_module(module), function)), place


def test_a_row_says_whether_its_target_was_met(bench: None) -> None:
    row = importlib.import_module("measured").row
    pairs = [(2.0, 4.0), (3.0, 4.0), (8.0, 4.0)]
    assert row("a", "b", pairs, most=3.0).met
    assert not row("a", "b", pairs, most=2.9).met
    assert row("a", "b", pairs, most=3.0, most_ratio=0.7).met is False
    assert row("a", "b", pairs, most_ratio=0.8).met
    assert row("a", "b", pairs, least_ratio=0.8).met is False
    plain = row("a", "b", pairs)
    assert (plain.met, plain.ratio, plain.ratio_min, plain.ratio_max) == (None, 0.75, 0.5, 2.0)
