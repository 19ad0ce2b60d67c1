"""Good files of every kind that something reads, and what reading them gives."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from foreign_logs import JOINTS, make, write_bag, write_traces
from spoiled_logs import good_frame

from controllers.rl_features import NAMES
from controllers.rl_policy import Policy
from fuzz.spoil_bytes import BYTES
from fuzz.spoil_tables import FRAME, TABLE
from fuzz.spoil_trees import CHECKPOINT, JSON, NPZ, YAML
from ident.loaders.ftc import NAMES as FTC
from ident.log import CHANNELS, Log
from ident.remembered import remember
from youbot_env.backend import FLOAT
from youbot_env.model_file import load_model, model_to_dict
from youbot_env.platform_file import read_platform
from youbot_env.references import load_motion
from youbot_env.simulation.analytic import choose_substeps

ROOT = Path(__file__).resolve().parents[2]
# Rows of the logs: enough to pass the doctor, few enough for hundreds of cases a minute.
ROWS = 300
PLATFORM = """\
name: mine
wheel_radius: 0.05
roller_radius: 0.012
wheel_mass: 1.4
wheels:
  - {name: fl, x: 0.2, y: 0.15, roller_angle_deg: -45}
  - {name: fr, x: 0.2, y: -0.15, roller_angle_deg: 45}
  - {name: rl, x: -0.2, y: 0.15, roller_angle_deg: 45}
  - {name: rr, x: -0.2, y: -0.15, roller_angle_deg: -45}
log:
  kt: 0.05
  gear: 16
  map: {reference_vx: xsetspeed, wheel_velocity_fl: "-m1vel [rpm]"}
"""


class Unsound(AssertionError):
    """What was read cannot be worked with."""


@dataclass(frozen=True)
class Original:
    """A good file or folder.

    Attributes:
        kind: what it is, for the table.
        files: content of each file by its path in the folder of a case.
        entry: the path that the reader is given.
        read: reads it; returns its content in comparable form, and what it said about it.
        spoilers: ways of spoiling each file that can be spoiled, by name.
        told: what reading the good one says.
        content: what reading the good one gives.
    """

    kind: str
    files: dict[str, bytes]
    entry: str
    read: Callable[[Path], tuple[Any, set[str]]]
    spoilers: dict[str, dict[str, Callable]]
    told: set[str] = field(default_factory=set)
    content: Any = None


def read_log(path: Path) -> tuple[Any, set[str]]:
    log = Log.load(path)
    arrays = {name: getattr(log, name) for name in ("time", *CHANNELS)}
    for name, array in arrays.items():
        if array is not None and not np.isfinite(array).all():
            raise Unsound(f"{name} holds values that are not finite")
    if not (np.diff(log.time) > 0).all():
        raise Unsound("time does not rise")
    content = {name: None if a is None else a.tobytes() for name, a in arrays.items()}
    content |= {"starts": log.starts, "recording": log.recording, "platform": log.platform}
    return content, {f"{finding.what} {finding.where}" for finding in log.findings}


def read_model(path: Path) -> tuple[Any, set[str]]:
    model = load_model(path)
    try:
        choose_substeps(model, 0.01)
    except ValueError as error:
        if "time constant" not in str(error):
            raise
    return repr(model_to_dict(model)), set()


def read_motion(path: Path) -> tuple[Any, set[str]]:
    motion = load_motion(path)
    first = motion.evaluate(motion.draw(np.random.default_rng(0)).tolist(), 1.0, FLOAT)
    if not np.isfinite([*first.pose]).all():
        raise Unsound("the motion is not finite")
    return repr((motion, motion.about)), set()


def read_policy(path: Path) -> tuple[Any, set[str]]:
    policy = Policy.load(path)
    with np.errstate(all="ignore"):
        action = policy(np.ones((1, len(NAMES))))
    if action.dtype != np.float32 or not np.isfinite(action).all():
        raise Unsound("the policy does not answer with finite numbers")
    parts = [a.tobytes() for a in (*policy.weights, *policy.biases, policy.mean, policy.deviation)]
    rest = (policy.algorithm, policy.clip, policy.activation, policy.squash, policy.share)
    return repr((parts, rest, policy.task, policy.training)), set()


def read_checkpoint(path: Path) -> tuple[Any, set[str]]:
    from controllers.training.checkpoint import Checkpoint

    run = training_run()
    run.checkpoints = path.parent
    run.resume()
    return repr(Checkpoint.of(run.algorithm, run.env, run.seconds, run.curve)), set()


@cache
def training_run():
    from small_policies import tiny

    from controllers.training.learn import Run

    return Run(tiny("ppo"), "nominal", load_model("nominal"))


def policy_beside(path: Path) -> tuple[Any, set[str]]:
    """Read a policy whose description was brought up to its spoiled weights."""
    data = json.loads(path.read_bytes())
    weights = path.with_suffix(".npz")
    if weights.exists():
        data["weights"]["sha256"] = sha256(weights.read_bytes()).hexdigest()
    path.write_text(json.dumps(data))
    return read_policy(path)


def originals(folder: Path) -> list[Original]:
    """Make all of them in an empty folder."""
    found = [*_tables(folder), *_bags(folder), *_descriptions(), *_policies()]
    if find_spec("stable_baselines3"):
        found.append(_checkpoint(folder))
    return [complete(one, folder / f"good{k}") for k, one in enumerate(found)]


def lay_out(files: dict[str, bytes], folder: Path) -> None:
    """Write the files of a case."""
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


def complete(original: Original, folder: Path) -> Original:
    """The original with what reading it gives."""
    lay_out(original.files, folder)
    content, told = original.read(folder / original.entry)
    shutil.rmtree(folder)
    return Original(*(getattr(original, name) for name in
                      ("kind", "files", "entry", "read", "spoilers")), told, content)  # fmt: skip


def _tables(folder: Path) -> list[Original]:
    frame = good_frame()[1000 : 1000 + ROWS]
    plain = frame.write_csv(float_precision=6).encode()
    log = _loaded(folder / "mine.csv", plain)
    said = remember(log, "by hand") | {"recording": "drive_hold=sampled"}
    head = "".join(f"# {name}: {text}\n" for name, text in said.items()).encode()
    stream = io.BytesIO()
    frame.write_parquet(stream, metadata=said)
    names = ["s", *["rad/s"] * 4, *["N m"] * 4, "m/s", "m/s", "rad/s", "m", "m", "rad"]
    lines = plain.replace(b",", b";").split(b"\n")
    units = b"\n".join([lines[0], ";".join(names).encode(), *lines[1:]])
    duty = {
        FTC[f"wheel_duty_{w}"]: frame[f"wheel_torque_{w}"] / 4 for w in ("fl", "fr", "rl", "rr")
    }
    duty |= {FTC[n]: frame[n] for n in ("x", "y", "yaw", "time")}
    body = ("body_velocity_x", "body_velocity_y", "yaw_rate")
    reference = ("reference_vx", "reference_vy", "reference_yaw_rate")
    duty |= {FTC[n]: frame[r] for n, r in zip(body, reference, strict=True)}
    duty[FTC["battery_voltage"]] = pl.Series([12.0 + 0.01 * (k % 7) for k in range(ROWS)])
    ftc = pl.DataFrame(duty).write_csv(float_precision=6).encode()
    text = {**BYTES, **TABLE}
    table = [("CSV", head + plain), ("CSV with units", units), ("FTC telemetry", ftc)]
    made = [Original(kind, {"mine.csv": data}, "mine.csv", read_log, {"mine.csv": text})
            for kind, data in table]  # fmt: skip
    name, ways = "mine.parquet", {**BYTES, **FRAME}
    packed = Original("Parquet", {name: stream.getvalue()}, name, read_log, {name: ways})
    return [*made, packed]


def _loaded(path: Path, data: bytes) -> Log:
    path.write_bytes(data)
    return Log.load(path)


def _bags(folder: Path) -> list[Original]:
    good, found = make(160), []
    kinds = {"ROS 1 bag": "ros1"}
    if find_spec("rosbags"):
        kinds |= {"ROS 2 bag, MCAP": "mcap", "ROS 2 bag, sqlite3": "sqlite3"}
    else:
        kinds = {}
    for title, kind in kinds.items():
        name = "run.bag" if kind == "ros1" else kind
        write_bag(folder / name, good, kind)
        found.append(_packed(title, folder, name))
    write_traces(folder / "trace", good, JOINTS)
    return [*found, _packed("DataTrace folder", folder, "trace")]


def _packed(kind: str, folder: Path, name: str) -> Original:
    """A file, or all files of a folder; texts are spoiled as such."""
    place = folder / name
    inside = [place] if place.is_file() else sorted(p for p in place.rglob("*") if p.is_file())
    files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in inside}
    ways = {
        path: {**BYTES, **(YAML if path.endswith(".yaml") else {}),
               **({n: s for n, s in TABLE.items() if n != "comment added"}
                  if path.endswith("jointDataTrace") else {})}
        for path in files
    }  # fmt: skip
    return Original(kind, files, name, read_log, ways)


def _descriptions() -> list[Original]:
    model = (ROOT / "youbot_env" / "models" / "identified.yaml").read_bytes()
    # JSON is YAML.
    with_effects = json.dumps(
        model_to_dict(load_model(ROOT / "youbot_env" / "models" / "paper.yaml"))
        | {"effects": ["floor_slope", {"identifier": "actuator_delay", "parameters": {"d": 0.01}}]}
    ).encode()
    text = {**BYTES, **YAML}
    motion = (ROOT / "youbot_env" / "motions" / "m0.yaml").read_bytes()

    def platform(path: Path) -> tuple[Any, set[str]]:
        return repr(read_platform(str(path))), set()

    kinds = [
        ("model", model, read_model),
        ("model", with_effects, read_model),
        ("motion", motion, read_motion),
        ("platform and map", PLATFORM.encode(), platform),
    ]
    return [
        Original(kind, {"mine.yaml": data}, "mine.yaml", read, {"mine.yaml": text})
        for kind, data, read in kinds
    ]


def _policies() -> list[Original]:
    place = ROOT / "controllers" / "policies"
    files = {f"ppo.{end}": (place / f"ppo.{end}").read_bytes() for end in ("json", "npz")}
    words, arrays = {**BYTES, **JSON}, {**BYTES, **NPZ}
    both = {"ppo.json": words, "ppo.npz": arrays}
    return [
        Original("policy", files, "ppo.json", read_policy, both),
        Original("policy, SHA-256 renewed", files, "ppo.json", policy_beside, {"ppo.npz": arrays}),
    ]


def _checkpoint(folder: Path) -> Original:
    from controllers.training.checkpoint import FILE, Checkpoint

    run = training_run()
    state = Checkpoint.of(run.algorithm, run.env, 1.0, [])
    data = state.save(folder, run._identity()).read_bytes()
    ways = {FILE: {**BYTES, **CHECKPOINT}}
    return Original("checkpoint", {FILE: data}, FILE, read_checkpoint, ways)
