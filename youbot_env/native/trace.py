"""Records what a function over components computes, as a graph of expressions.

A ``Node`` stands for a component: it takes part in arithmetic, and ``tracing_ops`` are the
elementary functions on it.  Constants are folded and equal expressions are one node.  What is the
same for all robots is told from what each has of its own, as it need be computed only once.

Numbers that differ between robots are double ("d") or single precision ("f"), truth values ("b") or
32-bit integers without sign ("i").  Numbers that are the same for all take the precision of what
they meet, as Python's numbers do beside NumPy's arrays.  Elementary functions beyond the square
root give single precision; sine and cosine of a double reduce the angle in double precision first.
"""

from __future__ import annotations

import math
import operator
from types import SimpleNamespace
from typing import Any

from youbot_env.backend import FLOAT, Ops

FOLDED = {
    "add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv,
    "lt": operator.lt, "le": operator.le, "gt": operator.gt, "ge": operator.ge,
    "neg": operator.neg, "min": min, "max": max, "sign": FLOAT.sign,
    "abs": abs, "floor": math.floor, "sqrt": math.sqrt,
    "cos": math.cos, "sin": math.sin, "tan": math.tan, "tanh": math.tanh, "exp": math.exp,
    "log": math.log,
}  # fmt: skip
TRANSCENDENTAL = ("cos", "sin", "tan", "tanh", "exp", "log")
COMPARED = ("lt", "le", "gt", "ge")
WHOLE = ("plus", "times", "xor", "shift")  # of 32-bit integers


class NotTraceable(TypeError):
    """A law that does what an expression cannot: it asks whether a value is true, for example."""


class Node:
    """One expression.

    Attributes:
        op: what it does; ``args`` are nodes, or for inputs what says where they are read.
        kind: "d", "f", "b" or "i".
        varies: whether robots differ in it.
        loop: the loop within which it changes, or None.
    """

    __slots__ = ("args", "graph", "kind", "loop", "number", "op", "varies")

    def __init__(self, graph: Graph, op: str, args: tuple, kind: str, varies: bool, loop):
        self.graph, self.op, self.args, self.kind = graph, op, args, kind
        self.varies, self.loop, self.number = varies, loop, len(graph.nodes)

    @property
    def value(self) -> float | None:
        """The number, where the expression is one."""
        return self.args[0] if self.op == "const" else None

    def __bool__(self) -> bool:
        raise NotTraceable("a law asks whether a value is true; use ops.where")

    def __float__(self) -> float:
        raise NotTraceable("a law turns a value into a Python number; use ops")

    def __add__(self, other):
        return self.graph.call("plus" if self.kind == "i" else "add", self, other)

    def __radd__(self, other):
        return self.graph.call("add", other, self)

    def __sub__(self, other):
        return self.graph.call("sub", self, other)

    def __rsub__(self, other):
        return self.graph.call("sub", other, self)

    def __mul__(self, other):
        return self.graph.call("times" if self.kind == "i" else "mul", self, other)

    def __rmul__(self, other):
        return self.graph.call("mul", other, self)

    def __truediv__(self, other):
        return self.graph.call("div", self, other)

    def __rtruediv__(self, other):
        return self.graph.call("div", other, self)

    def __neg__(self):
        return self.graph.call("neg", self)

    def __abs__(self):
        return self.graph.call("abs", self)

    def __pow__(self, power):
        return self.graph.power(self, power)

    def __lt__(self, other):
        return self.graph.call("lt", self, other)

    def __le__(self, other):
        return self.graph.call("le", self, other)

    def __gt__(self, other):
        return self.graph.call("gt", self, other)

    def __ge__(self, other):
        return self.graph.call("ge", self, other)

    def __or__(self, other):
        return self.graph.call("or", self, other)

    def __and__(self, other):
        return self.graph.call("and", self, other)

    def __rand__(self, other):
        return self.graph.call("and", other, self)

    def __ror__(self, other):
        return self.graph.call("or", other, self)

    def __xor__(self, other):
        return self.graph.call("xor", self, other)

    def __rshift__(self, other):
        return self.graph.call("shift", self, other)


class Loop:
    """A repeated piece: what it carries from one turn to the next.

    Attributes:
        count: node, how many turns.
        before, within, after: nodes of what is carried: at first, at the beginning and at the end
            of a turn.
    """

    def __init__(self, count: Node, before: list[Node]):
        self.count, self.before = count, before
        self.within: list[Node] = []
        self.after: list[Node] = []


class Graph:
    """The expressions of one function, each once.

    Attributes:
        nodes: in the order of their making, so arguments come first.
        loops: in the order in which they run.
    """

    def __init__(self):
        self.nodes: list[Node] = []
        self.loops: list[Loop] = []
        self._known: dict[tuple, Node] = {}

    def node(self, op: str, args: tuple, kind: str, varies: bool, loop=None) -> Node:
        """Return the expression, a new one where it is not known yet."""
        key = (op, kind, *(a.number if isinstance(a, Node) else ("as it is", a) for a in args))
        if key not in self._known:
            made = Node(self, op, args, kind, varies, loop)
            self.nodes.append(made)
            self._known[key] = made
        return self._known[key]

    def constant(self, value: float) -> Node:
        """A number."""
        return self.node("const", (float(value),), "d", False)

    def uniform(self, place: int) -> Node:
        """A number given at run time, the same for all robots, by its place among these."""
        return self.node("uniform", (place,), "d", False)

    def wrap(self, value) -> Node:
        """A node of whatever takes part in arithmetic."""
        if isinstance(value, Node):
            return value
        if isinstance(value, bool | int | float) or hasattr(value, "__float__"):
            return self.constant(float(value))
        raise NotTraceable(f"a law computes with {type(value).__name__}")

    def cast(self, value, kind: str) -> Node:
        """The value in another precision; values that are the same for all have none."""
        value = self.wrap(value)
        if not value.varies or value.kind == kind:
            return value
        if value.op == "cast" and value.args[0].kind == "i":
            value = value.args[0]
        return self.node("cast", (value,), kind, True, value.loop)

    def call(self, op: str, *given) -> Node:
        """Apply an operation; ``FOLDED`` names most of them."""
        args = tuple(self.wrap(a) for a in given)
        values = [a.value for a in args]
        if all(v is not None for v in values) and op in FOLDED:
            return self.constant(FOLDED[op](*values))
        short = self._shortened(op, args, values)
        if short is not None:
            return short
        varies = any(a.varies for a in args)
        loop = _innermost(args)
        numbers = args[1:] if op == "where" else args
        if op in COMPARED or op in ("or", "and"):
            kind = "b"
        elif any(a.kind == "i" for a in args):
            kind = "i"
        else:
            kinds = {a.kind for a in numbers if a.varies}
            kind = "f" if varies and "d" not in kinds else "d"
        if op in TRANSCENDENTAL and varies:
            if not (op in ("cos", "sin") and args[0].kind == "d"):
                args = (self.cast(args[0], "f"),)
            kind = "f"
        return self.node(op, args, kind, varies, loop)

    def _shortened(self, op: str, args: tuple, values: list) -> Node | None:
        """The same in fewer operations, where a constant allows it."""
        if op == "mul":
            for one, other in ((0, 1), (1, 0)):
                if values[one] == 1.0:
                    return args[other]
                if values[one] == 0.0:
                    return self.constant(0.0)
                if values[one] == -1.0:
                    return self.call("neg", args[other])
        if op == "add":
            for one, other in ((0, 1), (1, 0)):
                if values[one] == 0.0:
                    return args[other]
                if args[other].op == "neg":
                    return self.call("sub", args[one], args[other].args[0])
        if op == "sub":
            if values[1] == 0.0:
                return args[0]
            if values[0] == 0.0:
                return self.call("neg", args[1])
            if args[1].op == "neg":
                return self.call("add", args[0], args[1].args[0])
        if op == "div":
            if values[0] == 0.0:
                return self.constant(0.0)
            # What is the same for all is divided by once.
            if not args[1].varies and args[0].varies:
                return self.call("mul", args[0], self.call("div", 1.0, args[1]))
        if op == "neg" and args[0].op == "neg":
            return args[0].args[0]
        if op in ("or", "and"):
            for one, other in ((0, 1), (1, 0)):
                if values[one] is not None:
                    decided = bool(values[one]) == (op == "or")
                    return args[one] if decided else args[other]
        if op == "where":
            if args[1] is args[2]:
                return args[1]
            if values[0] is not None:
                return args[1] if values[0] else args[2]
        return None

    def power(self, base: Node, exponent) -> Node:
        """``base ** exponent`` for a number; by products and square roots where these suffice."""
        if not isinstance(exponent, int | float):
            return self.call("exp", exponent * self.call("log", base))
        if exponent < 0:
            return 1.0 / self.power(base, -exponent)
        whole = math.floor(exponent)
        if exponent == whole:
            result, square = self.constant(1.0), base
            while whole:
                result = result * square if whole % 2 else result
                square, whole = square * square, whole // 2
            return result
        for roots in (1, 2, 3):
            if (exponent * 2**roots).is_integer():
                root = base
                for _ in range(roots):
                    root = self.call("sqrt", root)
                return self.power(root, int(exponent * 2**roots))
        return self.call("exp", exponent * self.call("log", base))

    def iterate(self, count, body, carry):
        """``body`` applied ``count`` times to ``carry``, nested tuples of components."""
        if isinstance(count, int) and count == 1:
            return body(carry)
        before = [self.wrap(leaf) for leaf in _leaves(carry)]
        kinds = [b.kind if b.varies else "d" for b in before]
        loop, ends = self._turn(count, body, carry, before, kinds)
        # What one turn leaves in single precision need not be carried in double precision.
        less = ["f" if e.varies and e.kind == "f" else k for e, k in zip(ends, kinds, strict=True)]
        if less != kinds:
            loop, ends = self._turn(count, body, carry, before, less)
        number = len(self.loops)
        self.loops.append(loop)
        loop.after = [self.cast(e, w.kind) for e, w in zip(ends, loop.within, strict=True)]
        result = [self.node("after", (number, k), w.kind, True) for k, w in enumerate(loop.within)]
        return _rebuilt(carry, iter(result))

    def _turn(self, count, body, carry, before: list[Node], kinds: list[str]):
        """One turn of a loop whose carried values have these kinds: the loop, and its results.

        What is carried may differ between robots after a turn though it did not before.
        """
        loop = Loop(self.wrap(count), before)
        loop.within = [
            self.node("within", (len(self.loops), k, *kinds), kind, True, loop)
            for k, kind in enumerate(kinds)
        ]
        ends = body(_rebuilt(carry, iter(loop.within)))
        return loop, [self.wrap(leaf) for leaf in _leaves(ends)]


def _innermost(args: tuple) -> Loop | None:
    loops = {id(a.loop): a.loop for a in args if a.loop is not None}
    if len(loops) > 1:
        raise NotTraceable("a value of one loop is used within another")
    return next(iter(loops.values()), None)


def _leaves(value) -> list:
    if isinstance(value, tuple | list):
        return [leaf for part in value for leaf in _leaves(part)]
    return [value]


def _rebuilt(like, leaves) -> Any:
    if isinstance(like, tuple | list):
        parts = [_rebuilt(part, leaves) for part in like]
        return type(like)(*parts) if hasattr(like, "_fields") else type(like)(parts)
    return next(leaves)


def tracing_ops(graph: Graph) -> Ops:
    """The elementary functions that record themselves in a graph."""

    def named(op: str):
        return lambda *args: graph.call(op, *args)

    return SimpleNamespace(
        name="tracing",
        coarse=lambda a: graph.cast(a, "f"),
        cos_sin=lambda angle: (graph.call("cos", angle), graph.call("sin", angle)),
        real=lambda a: graph.cast(a, "d"),
        bits=lambda a: graph.cast(a, "i"),
        iterate=graph.iterate,
        minimum=named("min"),
        maximum=named("max"),
        **{
            name: named(name)
            for name in ("cos", "sin", "tan", "tanh", "exp", "log", "sqrt", "abs", "sign",
                         "where", "floor")
        },
    )  # fmt: skip
