"""The law of a vector environment as machine code, traced and compiled."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from youbot_env.envs.law import Law
from youbot_env.envs.options import EpisodeOptions
from youbot_env.native import build
from youbot_env.native.emit import PRELUDE, Array, Copied, Output, function_text, read
from youbot_env.native.trace import Graph, Node, tracing_ops
from youbot_env.plant import BoundModel, State


def address(array: np.ndarray) -> int:
    """Where the first entry lies in memory."""
    return array.__array_interface__["data"][0]


@dataclass(frozen=True)
class Machine:
    """Compiled functions, each ``f(pointers, numbers, sizes)``; see ``emit.function_text``.

    Attributes:
        functions: ``step`` (all robots), ``start`` and ``look`` (some), ``fill`` and ``fill chosen``
            (where references are kept in rings), ``draw``.
        slots: place of each pointer by name.
        places: place of each number by name.
    """

    functions: dict[str, Callable]
    slots: dict[str, int]
    places: dict[str, int]


def machine_of(law: Law, table: bool) -> Machine:
    """Trace and compile the law, or find what was compiled before.

    Args:
        law: of the environment.
        table: whether all episodes follow one reference, read from a table.

    Raises:
        NoCompiler: C cannot be compiled here.
        NotTraceable, TypeError: an effect does what cannot be traced.
    """
    tracer = _Tracer(law, table)
    names = tracer.trace()
    library = build.load("\n".join((PRELUDE, *tracer.texts)))
    functions = {}
    for name in (*names, "draw"):
        function = getattr(library, name.replace(" ", "_"))
        function.argtypes, function.restype = [ctypes.c_void_p] * 3, None
        functions[name] = function
    return Machine(functions, tracer.slots, tracer.places)


class _Tracer:
    """Writes the functions, and gives each array a slot and each number a place."""

    def __init__(self, law: Law, table: bool):
        self.law, self.table = law, table
        self.slots: dict[str, int] = {"chosen": 0}
        self.places: dict[str, int] = {}
        self.texts: list[str] = []
        self.held = max(law.history, 2)
        # Pointers that are always set have a slot even where no function reads them.
        for k in range(self.held):
            self._slot(f"command {k}")
        for name in ("state", "next", "integral", "next integral", "actions"):
            self._slot(name)

    def trace(self) -> list[str]:
        """Write all functions; returns their names."""
        self._step()
        self._look()
        self._start()
        names = ["step", "look", "start"]
        if not self.table:
            self._fill("fill", chosen=False)
            self._fill("fill chosen", chosen=True)
            names += ["fill", "fill chosen"]
        return names

    # Arrays and numbers

    def _slot(self, name: str) -> int:
        return self.slots.setdefault(name, len(self.slots))

    def _array(self, name: str, kind: str, components: int = 1, layout: str = "robots") -> Array:
        instants = self._slot("steps") if layout == "table" else 0
        return Array(self._slot(name), kind, layout, components, instants)

    def _begin(self) -> None:
        self.graph = Graph()
        self.ops = tracing_ops(self.graph)
        self.outputs: list[Output] = []
        self.copied: list[Copied] = []

    def _number(self, name: str) -> Node:
        return self.graph.uniform(self.places.setdefault(name, len(self.places)))

    def _read(self, *array, **layout) -> tuple[Node, ...]:
        return read(self.graph, self._array(*array, **layout))

    def _write(self, name: str, kind: str, values, whole: Array | None = None) -> None:
        values = tuple(values)
        array = whole or self._array(name, kind, len(values))
        self.outputs += [Output(array, k, self.graph.wrap(value)) for k, value in enumerate(values)]

    def _end(self, name: str, chosen: bool) -> None:
        self.texts.append(
            function_text(
                name.replace(" ", "_"), self.graph, self.outputs, chosen, tuple(self.copied)
            )
        )

    def _state(self) -> State:
        structure = self.law.structure
        return structure.unflatten(self._read("state", "d", structure.state_size))

    def _robot(self) -> BoundModel:
        structure = self.law.structure
        if self.law.drawn:
            return structure.bind(self._read("values", "f", structure.value_count))
        return structure.bind(self._number(f"value {k}") for k in range(structure.value_count))

    def _reference(self) -> tuple[tuple, list[Array]]:
        """Reference pose now, and where its twists now and at the previews lie."""
        count = self.law.task.preview + 1
        if self.table:
            poses = self._read("poses", "d", 3, layout="table")
            return poses, [self._array("twists", "f", 3 * count, "table")]
        twists = [self._array(f"twist {k}", "f", 3, "rows") for k in range(count)]
        return self._read("pose now", "d", 3), twists

    # Functions

    def _step(self) -> None:
        law, task = self.law, self.law.task
        self._begin()
        ops, (steps,) = self.ops, self._read("steps", "i")
        count, state, robot = ops.real(steps), self._state(), self._robot()
        action = tuple(
            ops.minimum(ops.maximum(a, -1.0), 1.0)
            for a in self._read("actions", "f", task.action_space.shape[0], layout="rows")
        )
        if task.action_level == "velocity":  # the loops' errors are small beside the speeds
            action = tuple(ops.real(a) for a in action)
        older = [self._read(f"command {k}", "f", law.wheels) for k in range(1, self.held)]
        integral = self._read("integral", "d", law.wheels)
        before = (count - 1.0) * task.dt
        torque, integral = law.torque(robot, state, older[0], action, integral, before, ops)
        torque = tuple(ops.coarse(m) for m in torque)
        if law.substeps > 1:
            law = law.with_substeps(self._number("substeps"))
        after = law.advance(robot, state, (torque, *older[: law.history - 1]), before, ops)
        self._write("next", "d", law.structure.flatten(after))
        self._write("command 0", "f", torque)
        if task.action_level == "velocity":
            self._write("next integral", "d", integral)
        late = (count >= self._number("most_steps")) | (count * task.dt >= self._number("end"))
        look = self._see(after, action, steps, torque)
        self._write("seen reward", "f", [look.reward])
        for name, value in (("terminated", look.lost), ("truncated", late)):
            self._write(f"seen {name}", "b", [value])
        self._write("seen done", "b", [look.lost | late])
        self._end("step", chosen=False)

    def _see(self, state: State, action: tuple, steps: Node, torque: tuple):
        law, ops = self.law, self.ops
        wanted, twists = self._reference()
        look = law.look(state, wanted, action, self._read("keys", "i", 2), steps, ops)
        high = law.task.observation_space.high.tolist()
        whole = self._array("seen observation", "f", len(high), "rows")
        pairs = zip(look.observation, high[: len(look.observation)], strict=True)
        self._write("", "f", [ops.minimum(ops.maximum(c, -b), b) for c, b in pairs], whole)
        at = len(look.observation)
        for twist in twists:
            self.copied.append(Copied(whole, at, twist))
            at += twist.components
        self._write("seen time", "d", [ops.real(steps) * law.task.dt])
        self._write("seen pose", "d", state.pose)
        self._write("seen reference_pose", "d", wanted)
        self._write("seen torque", "f", torque)
        return look

    def _look(self) -> None:
        self._begin()
        (steps,), state = self._read("steps", "i"), self._state()
        torque = self._read("command 0", "f", self.law.wheels)
        self._see(state, (0.0,) * self.law.task.action_space.shape[0], steps, torque)
        self._end("look", chosen=True)

    def _start(self) -> None:
        law, reference = self.law, self.law.reference
        self._begin()
        ops = self.ops
        if reference.constant is not None:
            values = [self._number(f"followed {k}") for k in range(reference.size)]
        elif reference.draws is None:
            values = self._read("numbers", "d", reference.size, layout="packed")
        else:
            numbers = self._read("numbers", "d", reference.draws, layout="packed")
            values = law.drawn_values(iter(numbers), ops)
        first = reference.evaluate(values, 0.0, ops)
        offset = self._read("offset", "d", 3, layout="packed")
        start = law.start(first, offset, EpisodeOptions(follow=True), ops)
        follows = self._number("follow") > 0.5
        velocity = tuple(
            ops.where(follows, v, self._number(f"velocity {k}"))
            for k, v in enumerate(start.velocity)
        )
        start = start._replace(velocity=velocity)
        self._write("state", "d", law.structure.flatten(start))
        self._write("integral", "d", (0.0,) * law.wheels)
        for k in range(self.held):
            self._write(f"command {k}", "f", (0.0,) * law.wheels)
        self._write("steps", "i", [0.0])
        if not self.table:
            self._write("followed", "d", values)
        self._end("start", chosen=True)

    def _fill(self, name: str, chosen: bool) -> None:
        law = self.law
        self._begin()
        (steps,) = self._read("steps", "i")
        values = self._read("followed", "d", law.reference.size)
        t = (self.ops.real(steps) + self._number("ahead")) * law.task.dt
        motion = law.reference.evaluate(values, t, self.ops)
        self._write("pose then", "d", motion.pose)
        high = law.task.observation_space.high[8:11].tolist()
        pairs = zip(motion.twist(self.ops), high, strict=True)
        twist = [self.ops.minimum(self.ops.maximum(c, -b), b) for c, b in pairs]
        self._write("", "f", twist, self._array("twist then", "f", 3, "rows"))
        self._end(name, chosen)
