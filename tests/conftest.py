"""What tests of several files share."""

import functools
import gc
import os
import runpy
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parent.parent / "scripts"


@pytest.fixture(autouse=bool(os.environ.get("MUTANT_UNDER_TEST")))
def built_anew():
    """Where faults are planted (``make mutants``) nothing is left that was built without them."""
    from controllers import mpc

    mpc._BUILT.clear()
    ours = ("youbot_env", "ident", "controllers")
    for one in gc.get_objects():
        if isinstance(one, functools._lru_cache_wrapper) and one.__module__.startswith(ours):
            one.cache_clear()


@pytest.fixture
def script(tmp_path, monkeypatch, capsys):
    """Run a script in an empty folder; returns (exit status, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)

    def call(name, *options):
        path = str(SCRIPTS / name)
        monkeypatch.setattr(sys, "argv", [path, *map(str, options)])
        with pytest.raises(SystemExit) as end:
            runpy.run_path(path, run_name="__main__")
        return end.value.code or 0, *capsys.readouterr()

    return call
