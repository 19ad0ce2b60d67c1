"""Plant faults one at a time and see which of them the fast tests notice: ``make mutants``.

mutmut makes the faults (which code, which tests: ``[tool.mutmut]`` of pyproject.toml); this draws a
sample of them, runs it and writes the table.  Left out are faults that say nothing about the tests:
other words in messages, and None in place of a value, which fails at once.  mutmut leaves constants
of modules alone, so ``PLANTED`` has those, and the faults that once went unnoticed, by hand.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import textwrap
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "mutants"
SURVIVED, TIMEOUT = 0, 36
ROOMS = {
    "effects": "youbot_env.effects.",
    "dynamics": "youbot_env.dynamics.",
    "controllers": "controllers.",
    "diagnosis": "ident.diagnosis.",
}
EFFECTS, CONTROLLERS = "youbot_env/effects", "controllers"
DIAGNOSIS, ESTIMATORS = "ident/diagnosis", "ident/estimators.py"
ROWS = "tests/test_effect_rows.py"
DIFFERENCES = "tests/test_controllers_by_differences.py"
DECISIONS = "tests/test_decisions_calibrated.py"
# (what, file, the right text, the wrong one, the tests that should notice)
PLANTED = [
    ("sign of floor_slope", f"{EFFECTS}/floor_slope.py", "= GRAVITY *", "= -GRAVITY *", ROWS),
    ("turn of floor_slope", f"{EFFECTS}/floor_slope.py", "c - p.sx", "c + p.sx", ROWS),
    ("sign of torque_offset", f"{EFFECTS}/torque_offset.py", "m - b for", "m + b for", ROWS),
    ("lag twice as fast", f"{EFFECTS}/actuator_lag.py", "exp(-h /", "exp(-2 * h /", ROWS),
    ("rolling resistance x2", f"{EFFECTS}/rolling_resistance.py", "= p.crr *", "= 2 * p.crr *",
     ROWS),
    ("yaw scrub x2", f"{EFFECTS}/yaw_scrub_friction.py", "-p.ts *", "-2 * p.ts *", ROWS),
    ("drag that is linear", f"{EFFECTS}/quadratic_drag.py",
     "ops.sqrt(vx * vx + vy * vy + TINY)", "1.0", ROWS),
    ("saturation x1.2", f"{EFFECTS}/torque_saturation.py", "-p.limit), p.limit",
     "-1.2 * p.limit), 1.2 * p.limit", ROWS),
    ("width of dry friction", f"{EFFECTS}/wheel_coulomb_friction.py", "WIDTH = 0.1", "WIDTH = 0.2",
     ROWS),
    ("sharpness of slip", f"{EFFECTS}/wheel_slip.py", "SHARPNESS = 4", "SHARPNESS = 3", ROWS),
    ("error dynamics of lqr", f"{CONTROLLERS}/lqr.py", "rates[0] + v[2]", "rates[0] - v[2]",
     DIFFERENCES),
    ("turning error of lqr", f"{CONTROLLERS}/lqr.py", "-turn * wanted[1]", "turn * wanted[1]",
     DIFFERENCES),
    ("rotation of kinematic", f"{CONTROLLERS}/kinematic.py", "-NUMPY.sin", "NUMPY.sin",
     DIFFERENCES),
    ("warm start not moved on", f"{CONTROLLERS}/mpc.py",
     "np.vstack([rows[:-1] + np.diff(rows, axis=0) / stride, rows[-1:]])", "rows", DIFFERENCES),
    ("no control of false discoveries", f"{DIAGNOSIS}/partial_regression.py",
     "stats.false_discovery_control(rivals)", "np.array(rivals)", DECISIONS),
    ("least gain", f"{DIAGNOSIS}/settings.py", "least_gain: float = 0.06",
     "least_gain: float = 0.01", DECISIONS),
    ("errors in a window", f"{DIAGNOSIS}/settings.py", "errors_each_window: int = 8",
     "errors_each_window: int = 80", DECISIONS),
    ("chance of a rival", f"{DIAGNOSIS}/settings.py", "rival_chance: float = 0.05",
     "rival_chance: float = 0.5", DECISIONS),
    ("stretches for a coefficient", f"{DIAGNOSIS}/settings.py", "clusters_each: int = 3",
     "clusters_each: int = 2", DECISIONS),
    ("power", f"{DIAGNOSIS}/settings.py", "power: float = 0.8", "power: float = 0.5", DECISIONS),
    ("freedom of Hausman", ESTIMATORS, "max(robust.clusters - len(gap), 1)", "robust.clusters",
     DECISIONS),
    ("weights of the delay on rollers", "youbot_env/rollers/plant.py",
     "(1 - part) * new + part * old", "part * new + (1 - part) * old", ROWS),
]  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(prog="python tests/mutation.py", description=__doc__)
    parser.add_argument("--sample", type=int, default=200, help="how many, alike in all rooms")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--children", type=int, default=2, help="processes at a time")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table here")
    chosen = parser.parse_args()
    if chosen.json is not None and chosen.json.parent.resolve() == WORK:
        parser.error(f"--json {chosen.json} lies in a folder that is made anew")
    for tests in {tests for *_, tests in PLANTED}:
        if noticed("ident/__init__.py", "", "", tests):
            raise RuntimeError(f"{tests} fails where nothing is planted")
    planted = {what: noticed(*rest) for what, *rest in PLANTED}
    # No fault has that name: mutmut makes all of them, times the tests, and stops.
    run(["no fault"], 1)
    tests = json.loads((WORK / "mutmut-stats.json").read_text())["tests_by_mangled_function_name"]
    reached = {name for name, which in tests.items() if which}
    rng, sample, unreached = np.random.default_rng(chosen.seed), [], Counter()
    for room, start in ROOMS.items():
        mine = [name for name in exit_codes() if name.startswith(start)]
        unreached[room] = sum(function_of(name) not in reached for name in mine)
        mine = [name for name in mine if function_of(name) in reached and telling(name)]
        sample += rng.choice(mine, min(len(mine), chosen.sample // len(ROOMS)), False).tolist()
    run(sample, chosen.children)
    codes = exit_codes()
    table = summary({name: codes[name] for name in sample}, unreached, planted, chosen.seed)
    print(json.dumps({k: v for k, v in table.items() if k != "survivors"}, indent=2))
    for one in table["survivors"]:
        print(one["name"], *one["change"], sep="\n  ")
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n")
    return int(not all(planted.values()))


def run(names: list[str], children: int) -> None:
    """Let mutmut try faults."""
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", str(children), *names]
    subprocess.run(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def exit_codes() -> dict[str, int | None]:
    """Exit status of the tests by the name of a fault; None where it has not been tried."""
    found = {}
    for file in sorted(WORK.rglob("*.py.meta")):
        found |= json.loads(file.read_text())["exit_code_by_key"]
    return found


def function_of(name: str) -> str:
    """The function that a fault is in."""
    return name.rpartition("__mutmut_")[0]


@cache
def functions_of(module: str) -> dict[str, str]:
    """Texts of all functions of a module, right ones and faulty ones, less their own names."""
    path = WORK / module.replace(".", "/")
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    text = path.read_text()
    lines = text.splitlines()
    return {
        node.name: textwrap.dedent(
            "\n".join(lines[node.lineno - 1 : node.end_lineno]).replace(node.name, "function")
        )
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and "__mutmut_" in node.name
    }


def texts(name: str) -> tuple[str, str]:
    """A function as it should be and with the fault."""
    module, _, fault = name.rpartition(".")
    found = functions_of(module)
    return found[f"{function_of(fault)}__mutmut_orig"], found[fault]


def telling(name: str) -> bool:
    """Whether a fault is other than words and None."""
    right, wrong = map(ast.parse, texts(name))
    for tree in (right, wrong):
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                node.value = ""
    if ast.dump(right) == ast.dump(wrong):
        return False
    return nothings(right) == nothings(wrong)


def nothings(tree: ast.AST) -> int:
    return sum(isinstance(n, ast.Constant) and n.value is None for n in ast.walk(tree))


def change(name: str) -> list[str]:
    """Lines that a fault changes, before and after."""
    lines = difflib.ndiff(*(text.splitlines() for text in texts(name)))
    return [f"{line[0]} {line[2:].strip()}" for line in lines if line[0] in "-+"]


def noticed(file: str, right: str, wrong: str, tests: str) -> bool:
    """Whether tests fail in a copy of the tree with one text changed (none where it is empty)."""
    with tempfile.TemporaryDirectory() as folder:
        for room in ("youbot_env", "ident", "controllers", "youbot_cli", "tests"):
            shutil.copytree(ROOT / room, Path(folder) / room)
        path = Path(folder) / file
        text = path.read_text()
        if right and text.count(right) != 1:
            raise ValueError(f"{file} has {right!r} {text.count(right)} times; mend PLANTED")
        path.write_text(text.replace(right, wrong) if right else text)
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", tests]
        given = os.environ | {
            "PYTHONPATH": os.pathsep.join([folder, os.environ.get("PYTHONPATH", "")])
        }
        done = subprocess.run(command, cwd=folder, env=given, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{tests} with {wrong!r} in {file}:\n{done.stdout[-2000:]}")
    return done.returncode == 1


def summary(codes: dict, unreached: Counter, planted: dict, seed: int) -> dict:
    """The table: how many in each room, how many noticed, and what was not."""
    untried = [name for name, code in codes.items() if code is None]
    codes = {name: code for name, code in codes.items() if code is not None}
    rooms = {}
    for room, start in ROOMS.items():
        mine = [code for name, code in codes.items() if name.startswith(start)]
        killed = sum(code != SURVIVED for code in mine)
        rooms[room] = {
            "faults": len(mine),
            "noticed": killed,
            "by_time": mine.count(TIMEOUT),
            "in_functions_the_fast_tests_never_enter": unreached[room],
        }
    total, killed = (sum(room[key] for room in rooms.values()) for key in ("faults", "noticed"))
    return {
        "seed": seed,
        "faults": total,
        "noticed": killed,
        "share": round(killed / max(total, 1), 4),
        "untried": len(untried),
        "rooms": rooms,
        "planted": planted,
        "survivors": [
            {"name": name, "change": change(name)}
            for name, code in sorted(codes.items())
            if code == SURVIVED
        ],
    }


if __name__ == "__main__":
    sys.exit(main())
