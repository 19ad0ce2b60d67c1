"""The law of a vector environment as machine code, traced and compiled."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from youbot_env.envs.law import Law
from youbot_env.envs.options import EpisodeOptions
from youbot_env.native import build
from youbot_env.native.emit import DRAW, PRELUDE, Array, Copied, Output, function_text, read
from youbot_env.native.trace import Graph, Node, NotTraceable, tracing_ops
from youbot_env.plant import BoundModel, State


def address(array: np.ndarray) -> int:
    """Where the first entry lies in memory."""
    return array.__array_interface__["data"][0]


@dataclass(frozen=True)
class Kernel:
    """Compiled functions, each ``f(pointers, numbers, sizes)``; see ``emit.function_text``.

    Attributes:
        functions: ``step`` (all robots), ``look``, ``draw`` and ``start`` (some), ``robots`` (where
            each episode draws one), ``period`` (all of these), ``fill`` and ``fill chosen`` (where
            references lie in rings).
        slots: place of each pointer by name.
        places: place of each number by name.
    """

    functions: dict[str, Callable]
    slots: dict[str, int]
    places: dict[str, int]


def kernel_of(law: Law, table: bool) -> Kernel:
    """Trace and compile the law, or find what was compiled before.

    Args:
        law: of the environment.
        table: whether all episodes follow one reference, read from a table.

    Raises:
        NoCompiler: C cannot be compiled here.
        NotTraceable: an effect does what cannot be traced.
    """
    tracer = _Tracer(law, table)
    functions = {}
    for names, texts, flags in tracer.traced():
        library = build.load("\n".join((PRELUDE, *texts)), flags)
        for name in names:
            function = getattr(library, name.replace(" ", "_"))
            function.argtypes, function.restype = [ctypes.c_void_p] * 3, None
            functions[name] = function
    return Kernel(functions, tracer.slots, tracer.places)


class _Tracer:
    """Writes the functions, and gives each array a slot and each number a place."""

    def __init__(self, law: Law, table: bool):
        self.law, self.table = law, table
        self.slots: dict[str, int] = {"chosen": 0}
        self.places: dict[str, int] = {}
        self.texts: list[str] = []
        self.held = max(law.history, 2)
        # The first ones are those that ``draw`` and ``period`` know by their number.
        for name in (
            "generators", "numbers", "function step", "function start", "function look",
            "function robots", "ended", "rows", "possible", "seen reward", "seen terminated",
            "seen truncated", "seen done",
        ):  # fmt: skip
            self._slot(name)
        # Pointers that are always set have a slot even where no function reads them.
        for name in ("state", "next", "integral", "next integral"):
            self._slot(name)
        for k in range(self.held):
            self._slot(f"command {k}")
        self.places["draws"] = 0

    def traced(self) -> list:
        """All of ``trace``, with one error for whatever a law does that cannot be traced."""
        try:
            return list(self.trace())
        except (TypeError, AttributeError, ValueError) as error:
            raise NotTraceable(f"a law cannot be traced ({error})") from error

    def trace(self) -> Iterator[tuple[list[str], list[str], tuple[str, ...]]]:
        """Write the functions: names, texts and how they may be compiled, one library each.

        The ends of an episode depend on settings of the user, a period on the effects: the second
        takes longest to compile and serves more often.
        """
        self._step()
        self._look()
        yield ["step", "look"], self.texts, build.FINITE
        self.texts = [DRAW]
        names = ["draw", "period", "start"]
        self._start()
        randomization = self.law.randomization
        if randomization is not None and randomization.drawn_together(self.law.model):
            self._robots()
            names.append("robots")
        if not self.table:
            self._fill("fill", chosen=False)
            self._fill("fill chosen", chosen=True)
            names += ["fill", "fill chosen"]
        yield names, self.texts, ()

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
        if self.law.randomization is not None:
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
        ops, followed = self.ops, None
        if reference.constant is not None:
            followed = [self._number(f"followed {k}") for k in range(reference.size)]
        elif reference.draws is None:
            followed = self._read("given", "d", reference.size, layout="packed")
        numbers = self._read("numbers", "d", law.draws, layout="packed")
        # Traced with the offset that is drawn and the reference's velocity, and with given ones.
        given = EpisodeOptions(
            offset=tuple(self._number(f"offset {k}") for k in range(3)),
            velocity=tuple(self._number(f"velocity {k}") for k in range(3)),
        )
        follows, displaced = self._number("follow") > 0.5, self._number("displace") > 0.5
        usual = EpisodeOptions(follow=True)
        followed, start, keys = law.start(followed, numbers, usual, ops)
        _, placed, _ = law.start(followed, numbers, given, ops)
        pose, velocity = (
            tuple(ops.where(condition, a, b) for a, b in zip(one, other, strict=True))
            for condition, one, other in (
                (displaced, placed.pose, start.pose),
                (follows, start.velocity, placed.velocity),
            )
        )
        start = start._replace(pose=pose, velocity=velocity)
        self._write("state", "d", law.structure.flatten(start))
        self._write("integral", "d", (0.0,) * law.wheels)
        for k in range(self.held):
            self._write(f"command {k}", "f", (0.0,) * law.wheels)
        self._write("steps", "i", [0.0])
        if keys:
            self._write("keys", "i", keys)
        if not self.table:
            self._write("followed", "d", followed)
        self._end("start", chosen=True)

    def _robots(self) -> None:
        model, randomization = self.law.model, self.law.randomization
        self._begin()
        numbers = self._read("numbers", "d", randomization.draws(model), layout="packed")
        values, possible = randomization.candidate(model, numbers, self.ops)
        self._write("values", "f", values)
        self._write("", "b", [possible], self._array("possible", "b", 1, "packed"))
        self._end("robots", chosen=True)

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
