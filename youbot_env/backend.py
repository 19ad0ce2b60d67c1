"""The elementary functions of each number type the physics is evaluated on.

The physics is written once, over components: a component is a Python float, a NumPy array
over a batch axis, a CasADi symbol, a JAX array or a traced expression (``native.trace``).
Addition and multiplication work on all of them; the elementary functions below do not, so the
physics takes them as an argument ``ops``.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np


class Ops(Protocol):
    """Elementary functions on components; every backend provides exactly these.

    Beyond the functions of their names: ``coarse`` is a value in the precision of slopes, ``real``
    the number that an integer is, ``bits`` the integer of 32 bits without sign below a number,
    ``cos_sin`` both of an angle, and ``iterate(count, body, carry)``
    is ``body(body(... carry))``, carry being nested tuples of components.
    """

    cos: Any
    sin: Any
    cos_sin: Any
    coarse: Any
    tan: Any
    tanh: Any
    exp: Any
    sqrt: Any
    abs: Any
    sign: Any
    minimum: Any
    maximum: Any
    where: Any
    floor: Any
    log: Any
    real: Any
    bits: Any
    iterate: Any


def _iterate(count: int, body, carry):
    for _ in range(count):
        carry = body(carry)
    return carry


def _cos_sin_array(angle) -> tuple:
    """Cosine and sine of an array from the tangent of the half angle.

    NumPy has a vector kernel for tan and none for double-precision sin and cos: this is three
    times as fast and as exact (2 units in the last place).
    """
    tangent = np.tan(0.5 * angle)
    squared = tangent * tangent
    scale = 1.0 / (1.0 + squared)
    return (1.0 - squared) * scale, 2.0 * tangent * scale


FLOAT: Ops = SimpleNamespace(
    name="float",
    coarse=lambda a: a,
    cos_sin=lambda angle: (math.cos(angle), math.sin(angle)),
    cos=math.cos,
    sin=math.sin,
    tan=math.tan,
    tanh=math.tanh,
    exp=math.exp,
    sqrt=math.sqrt,
    abs=abs,
    sign=lambda a: (a > 0) - (a < 0),
    minimum=min,
    maximum=max,
    where=lambda condition, a, b: a if condition else b,
    floor=math.floor,
    log=math.log,
    real=float,
    bits=int,
    iterate=_iterate,
)

NUMPY: Ops = SimpleNamespace(
    name="numpy",
    coarse=lambda a: a,
    cos_sin=_cos_sin_array,
    cos=np.cos,
    sin=np.sin,
    tan=np.tan,
    tanh=np.tanh,
    exp=np.exp,
    sqrt=np.sqrt,
    abs=np.abs,
    sign=np.sign,
    minimum=np.minimum,
    maximum=np.maximum,
    where=np.where,
    floor=np.floor,
    log=np.log,
    real=lambda a: a.astype(float),
    bits=lambda a: a.astype(np.uint32),
    iterate=_iterate,
)

# Slopes in single precision, for large batches; the state they are added to stays double.
NUMPY_FAST: Ops = SimpleNamespace(
    **{**vars(NUMPY), "name": "numpy fast", "coarse": lambda a: a.astype(np.float32)}
)


def casadi_ops() -> Ops:
    """Elementary functions on CasADi symbols (CasADi is imported here and not before)."""
    import casadi as ca

    return SimpleNamespace(
        name="casadi",
        coarse=lambda a: a,
        cos_sin=lambda angle: (ca.cos(angle), ca.sin(angle)),
        cos=ca.cos,
        sin=ca.sin,
        tan=ca.tan,
        tanh=ca.tanh,
        exp=ca.exp,
        sqrt=ca.sqrt,
        abs=ca.fabs,
        sign=ca.sign,
        minimum=ca.fmin,
        maximum=ca.fmax,
        where=ca.if_else,
        floor=ca.floor,
        log=ca.log,
        real=lambda a: a,
        bits=ca.floor,
        iterate=_iterate,
    )


def jax_ops() -> Ops:
    """Elementary functions on JAX arrays (JAX is imported here and not before)."""
    import jax.numpy as jnp

    own = ("name", "cos_sin", "coarse", "real", "bits", "iterate")
    names = [name for name in vars(NUMPY) if name not in own]
    return SimpleNamespace(
        name="jax",
        coarse=lambda a: a,
        cos_sin=lambda angle: (jnp.cos(angle), jnp.sin(angle)),
        real=lambda a: a.astype(float),
        bits=lambda a: a.astype(np.uint32),
        iterate=_iterate,
        **{name: getattr(jnp, name) for name in names},
    )


def is_zero(value) -> bool:
    """Tell whether a value is the number zero, not an array or a symbol that may be."""
    return isinstance(value, float) and value == 0.0


def weighted_sum(weights, components):
    """Return ``sum(w * c)``, leaving out weights that are the number zero.

    The geometry of a symmetric platform holds many exact zeros; leaving them out keeps a batched
    evaluation as cheap as equations written for that platform by hand.
    """
    total = 0.0
    for weight, component in zip(weights, components, strict=True):
        if is_zero(weight):
            continue
        term = component if isinstance(weight, float) and weight == 1.0 else weight * component
        total = term if is_zero(total) else total + term
    return total
