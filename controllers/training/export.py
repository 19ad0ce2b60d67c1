"""From a learner of Stable-Baselines3 to a policy, and from a policy to ONNX."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

from controllers.rl_features import NAMES
from controllers.rl_policy import Policy
from controllers.training.recipe import Recipe
from youbot_env.envs.task import TrackingTask
from youbot_env.model_file import write_atomically

OPSET = 17


def to_policy(
    algorithm: BaseAlgorithm,
    env: VecNormalize,
    recipe: Recipe,
    task: TrackingTask,
    training: dict[str, Any],
) -> Policy:
    """The deterministic policy of a learner, with the normalisation of its features."""
    net = algorithm.policy
    if recipe.algorithm == "sac":
        hidden, last = net.actor.latent_pi, net.actor.mu
    else:
        hidden, last = net.mlp_extractor.policy_net, net.action_net
    layers = [layer for layer in hidden if hasattr(layer, "weight")] + [last]
    arrays = [
        tuple(layer.get_parameter(name).detach().numpy().copy() for layer in layers)
        for name in ("weight", "bias")
    ]
    return Policy(
        algorithm=recipe.algorithm,
        weights=arrays[0],
        biases=arrays[1],
        mean=env.obs_rms.mean.copy(),
        deviation=np.sqrt(env.obs_rms.var + env.epsilon),
        clip=float(env.clip_obs),
        activation=recipe.activation,
        squash=recipe.algorithm == "sac",
        share=recipe.share,
        task={"dt": task.dt, "torque_limit": task.torque_limit},
        training=training,
    )


def write_onnx(policy: Policy, path: Path) -> Path:
    """Write a policy as an ONNX graph from ``features`` to ``action``, both (robots, ...) float32.

    The graph holds normalisation, network and limits; what the features are is told by
    ``controllers.rl_features.NAMES`` and by the description of the input.

    Raises:
        ImportError: the package onnx is not installed.
    """
    try:
        from onnx import TensorProto, checker, helper, numpy_helper
    except ImportError as error:
        raise ImportError("writing ONNX needs the package onnx: pip install onnx") from error
    constants: dict[str, np.ndarray] = {
        "mean": policy.mean,
        "scale": 1.0 / policy.deviation,
        "low": np.array(-policy.clip),
        "high": np.array(policy.clip),
        "minus_one": np.array(-1.0),
        "one": np.array(1.0),
        "share": np.array(policy.share),
    }
    nodes = [
        helper.make_node("Sub", ["features", "mean"], ["centred"]),
        helper.make_node("Mul", ["centred", "scale"], ["scaled"]),
        helper.make_node("Clip", ["scaled", "low", "high"], ["layer_0"]),
    ]
    activation, signal = {"tanh": "Tanh", "relu": "Relu"}[policy.activation], "layer_0"
    for k, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        constants |= {f"weight_{k}": weight, f"bias_{k}": bias}
        inputs, out = [signal, f"weight_{k}", f"bias_{k}"], f"sum_{k}"
        nodes.append(helper.make_node("Gemm", inputs, [out], transB=1))
        last = k == len(policy.weights) - 1
        kind = ("Tanh" if policy.squash else "Identity") if last else activation
        signal = f"layer_{k + 1}"
        nodes.append(helper.make_node(kind, [out], [signal]))
    nodes.append(helper.make_node("Clip", [signal, "minus_one", "one"], ["limited"]))
    nodes.append(helper.make_node("Mul", ["limited", "share"], ["action"]))
    sizes = policy.sizes
    graph = helper.make_graph(
        nodes,
        f"youbot_{policy.algorithm}",
        [helper.make_tensor_value_info("features", TensorProto.FLOAT, ["robots", sizes[0]])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["robots", sizes[-1]])],
        [numpy_helper.from_array(np.asarray(v, np.float32), k) for k, v in constants.items()],
        doc_string="features: " + "; ".join(NAMES),
    )
    model = helper.make_model(
        graph, producer_name="youbot-workbench", opset_imports=[helper.make_opsetid("", OPSET)]
    )
    command = dict(policy.training.get("provenance") or {}).get("command", "")
    helper.set_model_props(model, {"command": str(command)})
    model.ir_version = 8
    checker.check_model(model, full_check=True)
    return write_atomically(path, model.SerializeToString())
