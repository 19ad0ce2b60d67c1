"""The state of a training run in one file of tensors and text, read without unpickling objects."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from youbot_env.model_file import write_atomically

FILE = "checkpoint.pt"
MEMORY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


@dataclass(frozen=True)
class Checkpoint:
    """What a run needs to go on.

    Attributes:
        steps: control periods so far.
        seconds: wall time so far.
        curve: looks so far.
        learner: state of networks and optimisers, by name.
        scaling: statistics of features and rewards.
        memory: replay memory of SAC, by name; empty for PPO.
    """

    steps: int
    seconds: float
    curve: list[dict[str, float]]
    learner: dict[str, Any]
    scaling: dict[str, torch.Tensor]
    memory: dict[str, torch.Tensor]

    @classmethod
    def of(
        cls, algorithm: BaseAlgorithm, env: VecNormalize, seconds: float, curve: Iterable[dict]
    ) -> Checkpoint:
        """The state of a run now."""
        learner = algorithm.get_parameters()
        if hasattr(algorithm, "log_ent_coef"):
            learner["log_ent_coef"] = algorithm.log_ent_coef.data
        scaling = {
            f"{name}_{part}": torch.as_tensor(np.array(getattr(statistics, part)))
            for name, statistics in (("features", env.obs_rms), ("rewards", env.ret_rms))
            for part in ("mean", "var", "count")
        }
        memory = {}
        if (buffer := getattr(algorithm, "replay_buffer", None)) is not None:
            filled = buffer.buffer_size if buffer.full else buffer.pos
            memory = {name: torch.as_tensor(getattr(buffer, name)[:filled]) for name in MEMORY}
            memory["pos"] = torch.tensor(buffer.pos)
        return cls(algorithm.num_timesteps, seconds, list(curve), learner, scaling, memory)

    def restore(self, algorithm: BaseAlgorithm, env: VecNormalize) -> None:
        """Put the state into a run that was made in the same way.

        Raises:
            ValueError: it does not fit, or holds numbers that are not finite; the run is of no use
                any more then.
        """
        try:
            self._restore(algorithm, env)
        # What is missing or of another shape makes the libraries fail in these ways.
        except (RuntimeError, LookupError, TypeError, ValueError, AttributeError) as error:
            text = (str(error).splitlines() or [type(error).__name__])[-1].strip()[:200]
            raise ValueError(f"the checkpoint does not fit this run: {text}") from error

    def _restore(self, algorithm: BaseAlgorithm, env: VecNormalize) -> None:
        if not (isinstance(self.steps, int) and self.steps >= 0 and 0 <= self.seconds < math.inf):
            raise ValueError(f"{self.steps} steps in {self.seconds} s")
        for name in ("learner", "scaling", "memory"):
            for tensor in _tensors(getattr(self, name)):
                if not torch.isfinite(tensor).all():
                    raise ValueError(f"{name} holds numbers that are not finite")
        learner = dict(self.learner)
        if (entropy := learner.pop("log_ent_coef", None)) is not None:
            algorithm.log_ent_coef.data = entropy
        algorithm.set_parameters(learner)
        algorithm.num_timesteps = self.steps
        for name, statistics in (("features", env.obs_rms), ("rewards", env.ret_rms)):
            for part in ("mean", "var", "count"):
                value, now = self.scaling[f"{name}_{part}"].numpy(), getattr(statistics, part)
                if value.shape != np.shape(now) or (part != "mean" and not (value > 0).all()):
                    raise ValueError(f"{part} of {name} is {value.shape}, {np.shape(now)} is used")
                setattr(statistics, part, value if value.ndim else float(value))
        if self.memory:
            buffer, filled = algorithm.replay_buffer, len(self.memory["rewards"])
            for name in MEMORY:
                getattr(buffer, name)[:filled] = self.memory[name].numpy()
            buffer.pos, buffer.full = int(self.memory["pos"]), filled == buffer.buffer_size

    def save(self, folder: Path, identity: dict[str, Any]) -> Path:
        """Write the file into a folder, whole or not at all."""
        stream = io.BytesIO()
        text = {"identity": identity, "steps": self.steps, "seconds": self.seconds,
                "curve": self.curve}  # fmt: skip
        parts = {"learner": self.learner, "scaling": self.scaling, "memory": self.memory}
        torch.save({"text": json.dumps(text), **parts}, stream)
        return write_atomically(Path(folder) / FILE, stream.getvalue())

    @classmethod
    def load(cls, folder: Path, identity: dict[str, Any]) -> Checkpoint:
        """Read the file of a folder.

        Raises:
            ValueError: no such file, not a checkpoint, or one of a run with another recipe, world,
                model or seed.
        """
        path = Path(folder) / FILE
        if not path.is_file():
            raise ValueError(f"no checkpoint {str(path)!r}; leave out --resume to start one")
        try:
            data = torch.load(path, weights_only=True, map_location="cpu")
            text = json.loads(data["text"])
            known = dict(text["identity"])
            told = {name: text[name] for name in ("steps", "seconds", "curve")}
            parts = {name: data[name] for name in ("learner", "scaling", "memory")}
        # A damaged file makes the library fail in many ways, some of them of a deeper layer's.
        except Exception as error:
            text = (str(error).splitlines() or [type(error).__name__])[0][:200]
            raise ValueError(f"{path} is no checkpoint of this project: {text}") from error
        other = [name for name, value in json.loads(json.dumps(identity)).items()
                 if known.get(name) != value]  # fmt: skip
        if other:
            raise ValueError(
                f"{path} is of a run with another {' and '.join(other)}; give the options of that "
                "run, or another folder"
            )
        return cls(**told, **parts)


def _tensors(tree: object) -> Iterator[torch.Tensor]:
    """All tensors of a tree of mappings and lists."""
    if isinstance(tree, torch.Tensor):
        yield tree
    elif isinstance(tree, dict | list | tuple):
        for value in tree.values() if isinstance(tree, dict) else tree:
            yield from _tensors(value)
