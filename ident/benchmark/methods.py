"""Who answers: the diagnosis of this project, and the baselines.

A method is a function ``(fit, verify, seed) -> answer`` of logs of one robot, with the answer in
the form of ``Diagnosis.as_dict``: ``verdict`` and ``named`` at least.

Two public tools for sparse models are among them, PySINDy and SysIdentPy.  Both get what this
project has: the filtered equations, and the column of every effect of the library at its typical
size, so that they need not invent it, beside generic functions of the velocities.  Neither package
is needed for anything else.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any

import numpy as np

from ident.estimators import least_squares
from ident.filters import FirstOrderFilter
from ident.log import Log
from ident.regression import AXES, CORNER, Regression, build_regression
from youbot_env.effects import effect_names, get_effect
from youbot_env.model import Model
from youbot_env.model_file import load_model

# Thresholds of PySINDy, as shares of the rms force; the verifying log chooses, as is the custom.
THRESHOLDS = (0.01, 0.02, 0.05, 0.1, 0.2)
# SysIdentPy sees means over so many samples, next to unfiltered: the next velocity is then exactly
# linear in the last and in the forces.  BIC chooses among up to so many terms.
STRIDE, TERMS, UNFILTERED = 5, 20, 300.0
GENERIC = {
    "1": np.ones_like, "|v|": np.abs, "v|v|": lambda v: v * np.abs(v), "v^3": lambda v: v**3,
    "sgn v": lambda v: np.tanh(v / 0.01),
}  # fmt: skip


def quiet(answer: Callable) -> Callable:
    """Keep to itself that a threshold leaves nothing, or that columns depend on each other."""

    @wraps(answer)
    def silenced(*logs: Log) -> dict[str, Any]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return answer(*logs)

    return silenced


@dataclass(frozen=True)
class Columns:
    """A log as a table for sparse regression.

    Attributes:
        names: of the K columns; an effect's identifier, or ``generic`` for functions of velocity.
        values: (N, 3, K) filtered forces of each column, N m.
        base: (N, 3, 7) columns of the seven parameters, N m.
        y: (N, 3) filtered forces of the drive, N m.
        velocity: (N, 3) body velocities, m/s, m/s, rad/s.
    """

    names: tuple[str, ...]
    values: np.ndarray
    base: np.ndarray
    y: np.ndarray
    velocity: np.ndarray


def columns_of(log: Log, corner: float = CORNER) -> Columns:
    """Columns of all effects of the library and of generic functions of the velocities."""
    model = load_model("nominal")
    regression = build_regression(log, model, corner)
    theta = least_squares(regression, np.array(model.values())).values
    model = model.with_values(theta)
    rest, names, columns = regression.residual(theta), [], []
    for identifier in effect_names():
        for values in _arrangements(identifier, model):
            try:
                other = build_regression(log, model.with_effects({identifier: values}), corner)
                column = rest - _residual(other, model, identifier, values)
            except ValueError:
                continue
            if np.isfinite(column).all() and np.any(column):
                names.append(identifier)
                columns.append(column)
    velocity = np.stack([np.interp(regression.time, log.time, v) for v in log.velocity().T], axis=1)
    filters = FirstOrderFilter(regression.time, corner)
    for function in GENERIC.values():
        for axis in range(len(AXES)):
            column = np.zeros_like(rest)
            column[:, axis] = filters.linear(function(velocity[:, axis]))
            names.append("generic")
            columns.append(column)
    return Columns(tuple(names), np.stack(columns, axis=-1), regression.H, regression.y, velocity)


@quiet
def sparse_regression(fit: Log, verify: Log) -> dict[str, Any]:
    """Effects whose columns PySINDy's thresholded least squares keeps, largest first."""
    from pysindy.optimizers import STLSQ

    seen, other = columns_of(fit), columns_of(verify)
    common = [k for k, name in enumerate(seen.names) if name in other.names]
    X, y, scale, base = _without_base(seen, common)
    best = None
    for threshold in THRESHOLDS:
        found = STLSQ(threshold=threshold, normalize_columns=False).fit(X, y).coef_.ravel()
        weights = found / scale
        theta = base[1] - base[0] @ weights
        error = np.mean((_flat(other.y) - _flat(other.base) @ theta
                         - _chosen(other, seen, common) @ weights) ** 2)  # fmt: skip
        if best is None or error < best[0]:
            best = (error, found)
    return _answer(np.abs(best[1]), [seen.names[k] for k in common])


@quiet
def forward_regression(fit: Log, verify: Log) -> dict[str, Any]:
    """Effects among the terms that SysIdentPy's FROLS picks, one linear NARX model an axis.

    Payloads and errors of the kinematics are no candidates: their columns hold accelerations, and
    would give away the very velocity that is to be predicted.
    """
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    seen = columns_of(fit, UNFILTERED)
    v = seen.velocity
    products = np.stack([v[:, 1] * v[:, 2], v[:, 0] * v[:, 2], v[:, 2] ** 2], axis=1)
    known = np.hstack([seen.y, v, products])
    weight = np.zeros(len(seen.names))
    usable = [k for k, name in enumerate(seen.names) if not _accelerates(name)]
    for axis in range(len(AXES)):
        columns = [k for k in usable if np.any(seen.values[:, axis, k])]
        inputs = _means(np.hstack([known, seen.values[:, axis, columns]]))
        inputs = inputs / np.maximum(inputs.std(axis=0), 1e-12)
        output = v[: len(inputs) * STRIDE : STRIDE, axis, None] / v[:, axis].std()
        model = FROLS(
            ylag=1, xlag=[[1]] * inputs.shape[1], order_selection=True, info_criteria="bic",
            n_info_values=TERMS, estimator=LeastSquares(), basis_function=Polynomial(degree=1),
        )  # fmt: skip
        model.fit(X=inputs, y=output)
        for code, share in zip(np.ravel(model.final_model), model.err, strict=False):
            # Input j at lag 1 has the code 1000 (j + 2) + 1; outputs have 1001, the constant 0.
            place = int(code) // 1000 - 2 - known.shape[1]
            if place >= 0:
                weight[columns[place]] = max(weight[columns[place]], float(share))
    return _answer(weight, list(seen.names))


def _accelerates(name: str) -> bool:
    """Tell whether the column of an effect holds accelerations, which tell the next velocity."""
    if name == "generic":
        return False
    return any(get_effect(name).acts(hook) for hook in ("kinematics", "slip", "inertial"))


def _means(rows: np.ndarray) -> np.ndarray:
    """Means over ``STRIDE`` rows each; a rest is left out."""
    count = len(rows) // STRIDE
    return rows[: count * STRIDE].reshape(count, STRIDE, -1).mean(axis=1)


def _arrangements(identifier: str, model: Model):
    """Typical values; of a law with one parameter that may differ by wheel, one wheel at a time.

    Contrasts sum to zero over the wheels: the columns of four torque gains alone would add up to
    the very force that is to be explained.
    """
    (first, *more), names = get_effect(identifier).parameters, model.platform.wheel_names
    if not first.per_wheel or more:
        yield None
        return
    others = -first.default / (len(names) - 1) if first.contrast else 0.0
    for wheel in names[:-1] if first.contrast else names:
        rest = {f"{first.name}_{name}": others for name in names}
        yield rest | {f"{first.name}_{wheel}": first.default}


def _residual(regression: Regression, model: Model, identifier: str, values) -> np.ndarray:
    """What the equations leave at the base parameters with an effect of typical size."""
    full = model.with_effects({identifier: values})
    known = dict(zip(full.names(), full.values(), strict=True))
    return regression.residual(np.array([known[name] for name in regression.names]))


def _without_base(seen: Columns, common: list[int]):
    """Columns and forces with what the base explains taken out, unit rms each.

    Returns:
        ``(X (3N, K), y (3N,), scale (K,), (base weights of X (7, K), of y (7,)))``; weights of
        plain columns are those of X divided by ``scale``.
    """
    H, X, y = _flat(seen.base), _flat(seen.values[..., common]), _flat(seen.y)
    of_X, of_y = (np.linalg.lstsq(H, right, rcond=None)[0] for right in (X, y))
    size = np.sqrt(np.mean(y**2))
    X = X - H @ of_X
    scale = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-9 * size) / size
    return X / scale / size, (y - H @ of_y) / size, scale, (of_X, of_y)


def _chosen(other: Columns, seen: Columns, common: list[int]) -> np.ndarray:
    """Columns of another log in the order of the first."""
    places: dict[str, list[int]] = {}
    for k, name in enumerate(other.names):
        places.setdefault(name, []).append(k)
    order = [places[seen.names[k]].pop(0) for k in common]
    return _flat(other.values[..., order])


def _flat(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, *values.shape[2:])


def _answer(weight: np.ndarray, names: list[str]) -> dict[str, Any]:
    best: dict[str, float] = {}
    for name, value in zip(names, weight, strict=True):
        if value > 0:
            best[name] = max(best.get(name, 0.0), float(value))
    ranked = [name for name in sorted(best, key=best.get, reverse=True) if name != "generic"]
    missing = "outside_library" if best else "nothing_missing"
    named = [{"effect": name, "group": [name], "size": {}} for name in ranked]
    return {"verdict": "named" if ranked else missing, "named": named}


def diagnosis(fit: Log | list[Log], verify: Log, seed: int) -> dict[str, Any]:
    """Ask ``ident.diagnose``, which sees the verifying record only to report errors on it."""
    from ident import diagnose

    return diagnose(fit, model="nominal", test=verify, seed=seed).as_dict()


def pysindy(fit: Log, verify: Log, seed: int) -> dict[str, Any]:
    """Sparse regression by PySINDy over the columns of all effects."""
    return sparse_regression(fit, verify)


def sysidentpy(fit: Log, verify: Log, seed: int) -> dict[str, Any]:
    """Terms that SysIdentPy's forward regression picks for a NARX model."""
    return forward_regression(fit, verify)


METHODS = {"diagnosis": diagnosis, "pysindy": pysindy, "sysidentpy": sysidentpy}
