"""The state of a training run in one file of tensors and text, read without unpickling objects."""

from __future__ import annotations

import io
import json
import pickle
from collections.abc import Iterable
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
        """Put the state into a run that was made in the same way."""
        learner = dict(self.learner)
        if (entropy := learner.pop("log_ent_coef", None)) is not None:
            algorithm.log_ent_coef.data = entropy
        algorithm.set_parameters(learner)
        algorithm.num_timesteps = self.steps
        for name, statistics in (("features", env.obs_rms), ("rewards", env.ret_rms)):
            for part in ("mean", "var", "count"):
                value = self.scaling[f"{name}_{part}"].numpy()
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
            known = text.pop("identity")
            parts = {name: data[name] for name in ("learner", "scaling", "memory")}
        # An empty file ends early; RuntimeError covers text nested too deeply.
        except (
            pickle.UnpicklingError, EOFError, RuntimeError, KeyError, TypeError, ValueError
        ) as error:  # fmt: skip
            raise ValueError(f"{path} is no checkpoint of this project: {error}") from error
        other = [name for name, value in json.loads(json.dumps(identity)).items()
                 if known.get(name) != value]  # fmt: skip
        if other:
            raise ValueError(
                f"{path} is of a run with another {' and '.join(other)}; give the options of that "
                "run, or another folder"
            )
        return cls(**text, **parts)
