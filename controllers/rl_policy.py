"""A trained policy: a small network in plain NumPy, and its files.

Two files of one stem: ``NAME.npz`` holds the weights, ``NAME.json`` says everything else, in words
and numbers that a person can read.  Neither can hold code: nothing is ever unpickled.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import zipfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from controllers.rl_features import NAMES
from youbot_env.envs.task import LARGEST, SHORTEST
from youbot_env.model_file import write_atomically
from youbot_env.schema import Entry, Section
from youbot_env.shipped import Shipped

KIND = "youbot policy 1"
POLICIES = Shipped(Path(__file__).parent / "policies", ".json", ("policies", "models/policies"))
ACTIVATIONS = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0)}
# Far above any policy of this project, far below what would trouble a machine.
LARGEST_FILE = 50_000_000
FILE = Section("Policy file (JSON), beside its weights (NPZ)", (
    Entry("kind", f"`{KIND}`", needed=True),
    Entry("algorithm", "what trained it: ppo, sac, residual", needed=True),
    Entry("network", "the entries below", needed=True),
    Entry("task", "the entries below", needed=True),
    Entry("normalisation", "the entries below", needed=True),
    Entry("weights", "`file` and its `sha256`", needed=True),
    Entry("training", "how it came about, any entries", needed=True),
))  # fmt: skip
NETWORK = Section("`network`", (
    Entry("sizes", "width of the input and of every layer", needed=True),
    Entry("activation", f"of all layers but the last: {', '.join(ACTIVATIONS)}", needed=True),
    Entry("squash", "whether the last layer passes through tanh: true or false", needed=True),
    Entry("share", "factor on the output", "", 0.0, 1e3, needed=True),
    Entry("inputs", "names of the features"),
))  # fmt: skip
TASK = Section("`task`", (
    Entry("dt", "control period", "s", SHORTEST, LARGEST["dt"], needed=True),
    Entry("torque_limit", "torque of action 1", "N m", 1e-6, LARGEST["torque_limit"], needed=True),
))  # fmt: skip
NORMALISATION = Section("`normalisation`", (
    Entry("mean", "of each feature, finite", needed=True),
    Entry("deviation", "of each feature, positive", needed=True),
    Entry("clip", "limit of a normalised feature", "", 1e-6, 1e6, needed=True),
))  # fmt: skip


class PolicyFileError(ValueError):
    """A policy file that cannot be used; the message says where and what to do."""


@dataclass(frozen=True)
class Policy:
    """A multilayer perceptron from features to actions.

    Attributes:
        algorithm: what trained it: ``ppo``, ``sac`` or ``residual``.
        weights, biases: of each layer, (outputs, inputs) and (outputs,) float32.
        mean, deviation: (d,), a feature enters as ``(f - mean) / deviation``, limited to +-clip.
        clip: that limit.
        activation: of all layers but the last: ``tanh`` or ``relu``.
        squash: whether the last layer passes through tanh.
        share: factor on the output; a residual policy commands at most this share of the torque
            limit.
        task: control period ``dt``, s, and ``torque_limit``, N m, for which it was trained.
        training: how it came about: command, seed, versions, recipe, learning curve.
    """

    algorithm: str
    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    mean: np.ndarray
    deviation: np.ndarray
    clip: float
    activation: str
    squash: bool
    share: float
    task: dict[str, float]
    training: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        sizes, problems = self.sizes, []
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if weight.shape != (sizes[k + 1], sizes[k]) or bias.shape != (sizes[k + 1],):
                problems.append(f"layer {k} is {weight.shape} with bias {bias.shape}")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                problems.append(f"layer {k} holds values that are not finite")
        if sizes[0] != len(NAMES):
            problems.append(f"it takes {sizes[0]} inputs, this version has {len(NAMES)} features")
        if self.mean.shape != (sizes[0],) or self.deviation.shape != (sizes[0],):
            problems.append("its normalisation has another length than its input")
        elif not (np.isfinite(self.mean).all() and (self.deviation > 0).all()):
            problems.append("its normalisation is not finite and positive")
        if self.activation not in ACTIVATIONS:
            problems.append(f"activation {self.activation!r} is none of {sorted(ACTIVATIONS)}")
        numbers = [(NORMALISATION["clip"], self.clip), (NETWORK["share"], self.share)]
        if set(self.task) == set(TASK.names):
            numbers += [(TASK[name], value) for name, value in self.task.items()]
        else:
            problems.append(f"its task states {sorted(self.task)}, not dt and torque_limit")
        for entry, value in numbers:
            try:
                entry.check(value, "its ")
            except ValueError as error:
                problems.append(str(error))
        if problems:
            raise PolicyFileError(f"this policy cannot be used: {'; '.join(problems)}")

    @property
    def sizes(self) -> list[int]:
        """Width of the input and of every layer."""
        return [self.weights[0].shape[1], *(len(bias) for bias in self.biases)]

    @cached_property
    def _folded(self) -> tuple[np.ndarray, np.ndarray]:
        return self.mean.astype(np.float32), (1.0 / self.deviation).astype(np.float32)

    def __call__(self, features: np.ndarray) -> np.ndarray:
        """Actions (robots, n) float32, in [-share, share], of features (robots, d)."""
        mean, scale = self._folded
        signal = np.clip((features.astype(np.float32) - mean) * scale, -self.clip, self.clip)
        act, last = ACTIVATIONS[self.activation], len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            signal = signal @ weight.T + bias
            if k < last:
                signal = act(signal)
        if self.squash:
            signal = np.tanh(signal)
        return np.float32(self.share) * np.clip(signal, -1.0, 1.0)

    # Files

    def save(self, path: str | os.PathLike) -> Path:
        """Write ``NAME.npz`` and ``NAME.json``, each whole or not at all; returns the latter."""
        path = Path(path).with_suffix(".json")
        stream = io.BytesIO()
        layers = zip(self.weights, self.biases, strict=True)
        arrays = {f"{name}_{k}": a for k, pair in enumerate(layers)
                  for name, a in zip(("weight", "bias"), pair, strict=True)}  # fmt: skip
        np.savez(stream, **arrays)  # ty: ignore[invalid-argument-type]
        data = {
            "kind": KIND,
            "algorithm": self.algorithm,
            "network": {
                "sizes": self.sizes, "activation": self.activation, "squash": self.squash,
                "share": self.share, "inputs": list(NAMES),
            },
            "task": self.task,
            "normalisation": {
                "mean": self.mean.tolist(), "deviation": self.deviation.tolist(),
                "clip": self.clip,
            },
            "weights": {
                "file": path.with_suffix(".npz").name,
                "sha256": hashlib.sha256(stream.getvalue()).hexdigest(),
            },
            "training": self.training,
        }  # fmt: skip
        text = json.dumps(data, indent=1, allow_nan=False)
        write_atomically(path.with_suffix(".npz"), stream.getvalue())
        return write_atomically(path, text + "\n")

    @classmethod
    def load(cls, source: str | os.PathLike) -> Policy:
        """Read a policy given by the path of either file, or by the name of a shipped one.

        Raises:
            PolicyFileError: missing, malformed or mismatched files.
        """
        path = find_policy(source)
        data = _read_json(path)
        weights, biases = _read_weights(path, data)
        network, scaling = data["network"], data["normalisation"]
        try:
            return cls(
                algorithm=str(data["algorithm"]),
                weights=weights,
                biases=biases,
                mean=np.array(scaling["mean"], float),
                deviation=np.array(scaling["deviation"], float),
                clip=float(scaling["clip"]),
                activation=str(network["activation"]),
                squash=bool(network["squash"]),
                share=float(network["share"]),
                task={key: float(value) for key, value in dict(data["task"]).items()},
                training=dict(data["training"]),
            )
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            detail = f"entry {error} is missing" if isinstance(error, KeyError) else str(error)
            raise PolicyFileError(f"{path}: {detail}; train the policy again") from error


def shipped_policies() -> list[str]:
    """Names of the policies that come with the project."""
    return POLICIES.names()


def find_policy(source: str | os.PathLike) -> Path:
    """Return the path of the JSON file of a policy, see ``youbot_env.shipped``."""
    path = POLICIES.find(Path(source).with_suffix(".json"))
    if path is None:
        raise PolicyFileError(
            f"no policy {str(source)!r}; give the path of a policy's .json file or one of the "
            f"shipped {shipped_policies()}, or train one: youbot train"
        )
    return path


def _read_json(path: Path) -> dict:
    try:
        data = json.loads(_read(path).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise PolicyFileError(f"{path} is not valid JSON: {error}") from error
    if not isinstance(data, dict) or data.get("kind") != KIND:
        raise PolicyFileError(f"{path} is no {KIND!r}; give the .json file that youbot train wrote")
    missing = [entry for entry in FILE.needed if entry not in data]
    wrong = [entry for entry in ("network", "task", "normalisation", "weights", "training")
             if entry in data and not isinstance(data[entry], dict)]  # fmt: skip
    if missing or wrong:
        raise PolicyFileError(f"{path}: entries {missing + wrong} are missing or no objects")
    return data


def _read_weights(path: Path, data: dict) -> tuple[tuple, tuple]:
    weights = path.with_suffix(".npz")
    if not weights.is_file():
        raise PolicyFileError(f"{path}: {weights.name} is not beside it; a policy is both files")
    content = _read(weights)
    if hashlib.sha256(content).hexdigest() != data["weights"].get("sha256"):
        raise PolicyFileError(
            f"{weights} is not the file that {path.name} describes (SHA-256 differs); get both anew"
        )
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(member.file_size for member in archive.infolist()) > LARGEST_FILE:
                raise ValueError(f"it unpacks to more than {LARGEST_FILE} bytes")
        # Object arrays would need unpickling, which runs code: they are refused.
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        layers = range(len(data["network"].get("sizes", ())) - 1)
        if not layers or len(arrays) != 2 * len(layers):
            raise ValueError(f"it holds {sorted(arrays)}")
        parts = tuple(
            tuple(np.asarray(arrays[f"{name}_{k}"], np.float32) for k in layers)
            for name in ("weight", "bias")
        )
        if any(w.ndim != 2 or b.ndim != 1 for w, b in zip(*parts, strict=True)):
            raise ValueError("weights are not matrices, or biases not vectors")
    # A header may claim 10^12 numbers, which no memory holds, and a damaged one makes NumPy fail as
    # its parsers of Python do.
    except Exception as error:
        raise PolicyFileError(f"{weights} holds no network: {error}") from error
    return parts[0], parts[1]


def _read(path: Path) -> bytes:
    if path.stat().st_size > LARGEST_FILE:
        raise PolicyFileError(f"{path} is larger than any policy ({LARGEST_FILE} bytes)")
    return path.read_bytes()
