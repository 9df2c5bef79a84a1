"""Commands of `tci` in this process."""

from __future__ import annotations

import io
import signal
import sys
from contextlib import redirect_stderr, redirect_stdout

import pytest

from tci.cli.console import console
from tci.cli.main import main


def tci(*arguments: str, status: int = 0) -> str:
    """Runs a command in this process, because the start of Python and the loading of kernels take longer than
    most commands."""
    out, err = io.StringIO(), io.StringIO()
    before = signal.getsignal(signal.SIGTERM)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["tci", *arguments])
        patch.setattr(console, "width", 200)  # otherwise line breaks depend on the length of a folder name
        with pytest.raises(SystemExit) as ended:
            main()
    signal.signal(signal.SIGTERM, before)
    assert (ended.value.code or 0) == status, out.getvalue() + err.getvalue()
    return out.getvalue() if status == 0 or out.getvalue() else err.getvalue()
