"""Which combinations of parameters a motion or a log determines, and estimation within those.

Everything is read off the Gramian ``W = int H'H dt`` of the regression ``y = H x`` in the paper's
coordinates x1..x7 (eq. 7): directions without a trace, directions with a faint one, how far
parameters inflate each other's variance, and which blocks of parameters are independent.

A direction without a trace is not estimated: noise in the columns would make numbers of it, with
small standard errors and no meaning.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eigh, null_space, orth
from scipy.sparse.csgraph import connected_components

from ident.estimators import Estimate
from ident.identifiability_words import describe_motion, null_words, weak_words
from ident.motion_columns import effect_columns, motion_columns
from ident.recursive import sample_times
from ident.regression import Regression, linear_names
from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.parameters import x_scale
from youbot_env.references import Reference, make_reference

X_NAMES = tuple(f"x{k}" for k in range(1, 8))
# Columns that correlate less than this inflate each other's variance by less than 1 %.
INDEPENDENT = 0.1
# A direction that moves the drive's force by less than this share of its rms drowns in what every
# real log leaves unexplained.
FAINT = 0.02
# Energy a direction needs, in energies of the columns' own noise, to count as seen.  Below, noise
# in the columns would pull a least-squares estimate toward zero by more than 3 %.
ABOVE_NOISE = 30.0
# Noise of a column without any, in energies of a strong column: rounding and coarse sampling.
LEAST = 3e-12
# Part in a cancellation, of the largest, below which a column is said not to take part.
SMALL = 0.1
# Offset of the centre of mass that is worth knowing, in lengths of the wheel base's half diagonal.
OFFSET = 0.05
# A platform weighs this many times as much as its wheels, at least.
WHEELS = 2.0


@dataclass(frozen=True)
class Observability:
    """What the columns of a regression see.

    Attributes:
        names: (P,) ``x1`` .. ``x7`` of paper eq. (7), then ``effect.parameter``.
        gramian: (P, P) int H'H dt in these coordinates.
        rank: number of directions that leave a trace.
        null: (P - rank, P) directions that leave none, in reduced row echelon form.
        weak: (k, P) directions that move the drive's force by less than 2 % of its rms, in
            ``parameter_sizes``.
        vif: (P,) variance inflation factors; infinite where a null direction takes part.
        share: (P,) part of the rms drive force that each parameter alone explains at its size.
        condition: condition number of the columns scaled to equal length; infinite below full rank.
        blocks: sets of names that can be identified apart from each other.
        words: null and weak directions for people.
    """

    names: tuple[str, ...]
    gramian: np.ndarray
    rank: int
    null: np.ndarray
    weak: np.ndarray
    vif: np.ndarray
    share: np.ndarray
    condition: float
    blocks: tuple[tuple[str, ...], ...]
    words: list[str]

    def sees(self) -> np.ndarray:
        """(P,) whether each parameter is determined, i.e. no null direction takes part."""
        return np.isfinite(self.vif)


def observe_motion(
    reference: str | Reference, model: Model, seconds: float, dt: float = 0.01, seed: int = 0
) -> Observability:
    """Observability of a motion that is followed exactly and measured without noise.

    Args:
        reference: the motion or its name.
        model: platform, effects and sizes of the parameters.
        seconds: length, s; blocks are sharpest over whole periods.
        dt: step of the integral, s.
        seed: of motions that are drawn.
    """
    time = np.arange(round(seconds / dt)) * dt
    motion = make_reference(reference).sample(time, seed)
    H = np.concatenate([motion_columns(motion, model), effect_columns(motion, time, model)], -1)
    values, names = dict(zip(model.names(), model.values(), strict=True)), linear_names(model)
    y = H @ np.array([values[name] for name in names])
    piece = np.zeros(len(time), int)
    exact = Regression(names, H, y, time, piece, model.platform.lever)
    return _observe(exact, np.zeros((len(names),) * 2), model, "motion")


def observe_regression(regression: Regression, model: Model) -> Observability:
    """Observability of a log; a direction counts as seen where it stands out of the noise.

    Args:
        regression: rows of the log.
        model: platform and sizes of the parameters.
    """
    return _observe(regression, column_noise(regression), model, "log")


def column_noise(regression: Regression) -> np.ndarray:
    """(P, P) part of int H'H dt that noise of the columns explains, from their second differences.

    White noise has six times its own energy there, smooth motion next to none.
    """
    H, weights = regression.H, sample_times(regression)
    second = H[2:] - 2.0 * H[1:-1] + H[:-2]
    inside = regression.piece[2:] == regression.piece[:-2]
    white = second[inside] * np.sqrt(weights[2:][inside] / 6.0)[:, None, None]
    return np.einsum("nap,naq->pq", white, white)


def scaled_energy(
    regression: Regression, noise: np.ndarray, model: Model
) -> tuple[np.ndarray, np.ndarray]:
    """Gramian of the columns and of their noise, (P, P) each, without dimension.

    In sizes of the parameters and of the drive's rms an eigenvalue is the square of a share of the
    drive's force.
    """
    weights, sizes = sample_times(regression), parameter_sizes(regression.names, model)
    force = float(np.einsum("n,na,na->", weights, regression.y, regression.y)) or 1.0
    scaling = np.outer(sizes, sizes) / force
    gramian = np.einsum("n,nap,naq->pq", weights, regression.H, regression.H)
    return gramian * scaling, noise * scaling


def parameter_sizes(names: tuple[str, ...], model: Model) -> np.ndarray:
    """(P,) size of each parameter, SI: its value, or what is typical where that is smaller."""
    values = dict(zip(model.names(), model.values(), strict=True))
    least = typical_sizes(model)
    for active in model.effects:
        for flat in active.values:
            least[f"{active.identifier}.{flat}"] = abs(active.effect.parameter_of(flat).default)
    sizes = [max(abs(values[name]), least.get(name, 0.0)) for name in names]
    return np.array([size if size > 0 else 1.0 for size in sizes])


def typical_sizes(model: Model) -> dict[str, float]:
    """Sizes of the seven parameters on a platform like the model's, SI, whatever it starts from.

    Those of the data sheet, scaled so that a platform of another size fades out and swings as fast.
    """
    nominal, platform = load_model("nominal"), model.platform
    sheet, own = nominal.parameters.theta(nominal.platform), nominal.platform
    lightest = WHEELS * len(platform.wheels) * platform.wheel_mass
    mass = max(abs(model.parameters.m0), lightest)
    heavier = mass / sheet.m0
    wheel = heavier * (platform.wheel_radius / own.wheel_radius) ** 2
    roller = heavier * (platform.roller_radius / own.roller_radius) ** 2
    return {
        "m0": lightest,
        "I0": sheet.I0 * heavier * (platform.reach / own.reach) ** 2,
        "I1": sheet.I1 * wheel,
        "max": OFFSET * platform.reach * mass,
        "may": OFFSET * platform.reach * mass,
        "mu1": sheet.mu1 * wheel,
        "mu2": sheet.mu2 * roller,
    }


def coordinate_factors(names: tuple[str, ...], model: Model) -> np.ndarray:
    """(P,) factors from theta and effects' parameters to the coordinates of ``Observability``.

    Paper eq. (7) where the platform has such a lever (omni wheels turn without rolling rollers).
    """
    paper = np.array(x_scale(model.platform))
    return np.concatenate([np.where(paper > 0, paper, 1.0), np.ones(len(names) - 7)])


def _observe(regression: Regression, noise: np.ndarray, model: Model, what: str) -> Observability:
    """Analyse the columns of a motion or a log."""
    names, weights = regression.names, sample_times(regression)
    scale = coordinate_factors(names, model)
    labels, sizes = (*X_NAMES, *names[7:]), parameter_sizes(names, model)
    shared, rough = scaled_energy(regression, noise, model)
    null = blind_directions(shared, rough) * sizes * scale
    null /= np.array([row[np.flatnonzero(row)[0]] for row in null]).reshape(-1, 1)

    seen = null_space(null / (sizes * scale)) if len(null) else np.eye(len(names))
    strength, faint = np.linalg.eigh(seen.T @ shared @ seen)
    shares = np.sqrt(np.maximum(strength, 0.0))
    weak = (seen @ faint[:, shares < FAINT]).T

    blind, length = null.any(axis=0), np.sqrt(np.diag(shared))
    variance = np.diag(seen @ np.linalg.inv(seen.T @ shared @ seen) @ seen.T)
    inflation = np.where(blind, np.inf, variance * length**2)
    variance = np.where(blind, np.inf, variance)
    correlation = shared / np.outer(length, length) if not len(null) else None
    words = null_words(null, labels, names, f"this {what} ({describe_motion(regression, model)})")
    words += weak_words(weak, sizes, shares[shares < FAINT], names, model)
    return Observability(
        names=labels,
        gramian=np.einsum("n,nap,naq->pq", weights, regression.H, regression.H)
        / np.outer(scale, scale),
        rank=seen.shape[1],
        null=null,
        weak=weak,
        vif=inflation,
        share=1.0 / np.sqrt(variance),
        condition=np.inf if correlation is None else float(np.linalg.cond(correlation)) ** 0.5,
        blocks=independent_blocks(shared - rough, labels, _dead(shared, rough)),
        words=words,
    )


def blind_directions(gramian: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Directions (k, P) that show no more than the noise of their columns.

    Args:
        gramian: (P, P) of all columns, dimensionless with entries of order one for strong columns.
        noise: (P, P) part of it that noise explains.
    """
    dead = _dead(gramian, noise)
    alone, index = np.eye(len(gramian))[dead], np.flatnonzero(~dead)
    if not len(index):
        return alone
    length = np.sqrt(np.diag(gramian)[index])
    inner = np.ix_(index, index)
    floor = noise[inner] / np.outer(length, length) + np.eye(len(index)) * LEAST
    ratio, directions = eigh(gramian[inner] / np.outer(length, length), floor)
    # Columns of unit length: an entry is what that column contributes to the cancellation.
    together = np.zeros((int(np.sum(ratio <= ABOVE_NOISE)), len(gramian)))
    together[:, index] = echelon(directions[:, ratio <= ABOVE_NOISE].T) / length
    return np.concatenate([alone, together])


def independent_blocks(gramian: np.ndarray, names: tuple[str, ...], dead: np.ndarray) -> tuple:
    """Sets of names whose columns are uncorrelated with all others; dead names are left out."""
    index = np.flatnonzero(~dead)
    if not len(index):
        return ()
    length = np.sqrt(np.diag(gramian)[index])
    correlation = gramian[np.ix_(index, index)] / np.outer(length, length)
    _, number = connected_components(np.abs(correlation) > INDEPENDENT, directed=False)
    members = [tuple(names[k] for k in index[number == one]) for one in np.unique(number)]
    return tuple(sorted(members, key=lambda block: (len(block), block)))


def echelon(directions: np.ndarray) -> np.ndarray:
    """Reduced row echelon form of directions (k, P); small entries are cleared."""
    rows, done = np.array(directions, float), 0
    for column in range(rows.shape[1]):
        if done == len(rows):
            break
        pivot = done + int(np.argmax(np.abs(rows[done:, column])))
        if abs(rows[pivot, column]) < SMALL * np.abs(rows[done:]).max():
            continue
        rows[[done, pivot]] = rows[[pivot, done]]
        rows[done] /= rows[done, column]
        others = np.arange(len(rows)) != done
        rows[others] -= np.outer(rows[others, column], rows[done])
        done += 1
    return np.where(np.abs(rows) < SMALL * np.abs(rows).max(axis=1, keepdims=True), 0.0, rows)


def _dead(gramian: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(P,) whether a column shows nothing but noise or rounding."""
    return np.diag(gramian) <= ABOVE_NOISE * (np.diag(noise) + LEAST)


ROUNDING = 1e-6


@dataclass(frozen=True)
class Seen:
    """The affine space ``start + basis @ b`` in which an estimate is looked for.

    Attributes:
        names: (P,) of the regression's parameters.
        start: (P,) prior values.
        sizes: (P,) what one unit of each coordinate is worth.
        basis: (P, k) directions that are seen.
        null: (P - k, P) directions that are not.
        held: names of parameters that are held at a bound.
    """

    names: tuple[str, ...]
    start: np.ndarray
    sizes: np.ndarray
    basis: np.ndarray
    null: np.ndarray
    held: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, observability: Observability, regression: Regression, start: np.ndarray, model: Model
    ) -> Seen:
        """Take the directions from an analysis of the regression; model gives the sizes."""
        names = regression.names
        scale = coordinate_factors(names, model)
        sizes, null = parameter_sizes(names, model), observability.null / scale
        free = np.eye(len(names))
        if regression.allowed is not None:
            free = orth(regression.allowed / sizes[:, None])
        # Null directions that are not allowed anyway leave rounding only.
        blind = null / sizes
        blind /= np.linalg.norm(blind, axis=1, keepdims=True)
        _, strength, right = np.linalg.svd(blind @ free)
        seen = free @ right[np.count_nonzero(strength > ROUNDING) :].T
        return cls(names, start, sizes, sizes[:, None] * seen, null)

    def reduce(self, regression: Regression) -> Regression:
        """Rows whose unknowns are the coordinates b."""
        y = regression.y - regression.H @ self.start
        names = tuple(f"b{k}" for k in range(self.basis.shape[1]))
        return replace(regression, names=names, H=regression.H @ self.basis, y=y, allowed=None)

    def restore(self, estimate: Estimate) -> Estimate:
        """Turn an estimate of b into one of the parameters."""
        return replace(
            estimate,
            names=self.names,
            values=self.start + self.basis @ estimate.values,
            covariance=self.basis @ estimate.covariance @ self.basis.T,
            undetermined=orth((self.null / self.sizes).T) if len(self.null) else self.null.T,
            scale=1.0 / self.sizes,
        )

    def determines(self, weights: np.ndarray) -> bool:
        """Whether the logs alone fix ``weights @ parameters`` (P,)."""
        moved = np.abs(self.null @ weights)
        return bool(np.all(moved <= SMALL * np.abs(self.null * weights).sum(axis=1)))
