"""What a command and a package import before they are asked to do anything."""

import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import pytest

from youbot_cli import COMMANDS, names

ROOT = Path(__file__).resolve().parent.parent
# Each takes longer to import than a help text to print.
HEAVY = {
    "numpy", "scipy", "casadi", "polars", "matplotlib", "gymnasium", "control", "joblib", "jinja2",
    "torch", "mujoco", "pygame", "youbot_env", "controllers",
}  # fmt: skip


def imported(code: str, *words: str) -> set[str]:
    """Names of the modules that a new interpreter holds after some lines."""
    code = (
        "import sys, json, contextlib, io\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        f"    {code}\n"
        "print(json.dumps(sorted(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *words], check=True, cwd=ROOT, capture_output=True, text=True
    )
    return set(json.loads(done.stdout))


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_no_command_waits_for_heavy_packages(command):
    start = "from youbot_cli.__main__ import main; main()"
    found = imported(start, *command.split(), "--help")
    assert f"youbot_cli.{COMMANDS[command]}" in found
    assert "typer" in found
    assert not found & HEAVY
    assert not [name for name in found if name.startswith("ident.")]


def test_packages_import_only_what_they_are_for():
    assert not imported("import ident") & HEAVY
    # The environments are registered: that takes Gymnasium, which takes NumPy.
    assert imported("import youbot_env") & HEAVY == {"youbot_env", "gymnasium", "numpy"}
    environments = imported("import youbot_env.envs.tracking, youbot_env.envs.vector")
    assert not environments & (HEAVY - {"youbot_env", "gymnasium", "numpy", "casadi"})


def test_names_in_help_texts_are_those_of_their_homes():
    from controllers.evaluation.motions import REFERENCES as FOLLOWED
    from controllers.training.trial import FIRST_SEED
    from ident.benchmark.cases import PARTS
    from ident.design import Limits
    from youbot_env.platform_file import LINE
    from youbot_env.references import MOTIONS, REFERENCES
    from youbot_env.simulation import ROWS

    assert (*REFERENCES, *MOTIONS.names()) == names.MOTIONS
    assert (*ROWS, "held") == names.HOLDS
    assert names.PLATFORM_LINE == LINE
    assert names.FOLLOWED == FOLLOWED
    assert names.FIRST_SEED == FIRST_SEED
    assert names.PARTS == PARTS
    limits = asdict(Limits())
    del limits["speed"]  # the command has its own
    told = (names.YAW_RATE, names.ACCELERATION, names.YAW_ACCELERATION, names.TORQUE)
    assert tuple(limits.values()) == told
