"""Many robots of tracking environments advanced together, by NumPy or by machine code.

Both kinds have one face and follow one ``Law``.  Machine code is a trace of the law, so it needs a
C compiler; NumPy needs nothing and takes 5 to 50 times as long.
"""

from __future__ import annotations

import ctypes
import warnings
from functools import cached_property

import numpy as np

from youbot_env.backend import NUMPY, NUMPY_FAST
from youbot_env.envs.kernel import address, kernel_of
from youbot_env.envs.law import Law
from youbot_env.envs.options import EpisodeOptions
from youbot_env.envs.randomization import TRIES
from youbot_env.envs.step_buffer import StepBuffer, StepLayout
from youbot_env.native.build import NoCompiler
from youbot_env.native.trace import NotTraceable
from youbot_env.plant import State

# Rows beyond which a table of the whole episode is not worth its memory.
LONGEST_TABLE = 20_000
USUAL = EpisodeOptions()
_told: set[str] = set()


def make_robots(law: Law, copies: int, steps: int, compiled: bool) -> Robots:
    """Robots for episodes of at most ``steps`` periods, in machine code where that can be had."""
    if compiled:
        try:
            return CompiledRobots(law, copies, steps)
        except NoCompiler as error:
            remedy = "install one (gcc or clang) and the same code runs 5 to 50 times faster"
            _tell(f"vector environments are evaluated by NumPy: {error}; {remedy}")
        except NotTraceable as error:
            remedy = "write the law with ops alone and it runs 5 to 50 times faster"
            _tell(f"this vector environment is evaluated by NumPy: {error}; {remedy}")
    return ArrayRobots(law, copies, steps)


def _tell(words: str) -> None:
    """Warn once in the life of the process."""
    if words not in _told:
        _told.add(words)
        warnings.warn(words, stacklevel=4)


class Robots:
    """What both kinds share: the memory of references and counters, and random numbers.

    Attributes:
        law: what the robots follow.
        values: of the models, (V,) or, where each episode draws a robot, (V, n).
        generators: one a robot; its random numbers are drawn in the order of need.
    """

    def __init__(self, law: Law, copies: int, steps: int):
        self.law, self.copies, self.most_steps = law, copies, steps
        self.generators: list[np.random.Generator] = []
        self._draws = law.draws
        observed = law.task.observation_space.shape[0]
        self.layout = StepLayout(copies, observed, law.wheels)
        width, task = self.layout.width, law.task
        self.steps = np.zeros(width, np.uint32)
        self._keys = np.zeros((2, width), np.uint32)
        self._integral = np.zeros((law.wheels, width))
        self._held = max(law.history, 2)
        self._commands = np.zeros((self._held, law.wheels, width), np.float32)
        self._newest = 0
        nominal = np.array(law.model.values())
        self.values = nominal
        if law.randomization is not None:
            self.values = np.repeat(nominal[:, None].astype(np.float32), width, axis=1)
        self._size, self._head = task.preview_length + 1, 0
        constant = law.reference.constant
        self._table = constant is not None and steps <= LONGEST_TABLE
        if self._table:
            # Robots that have ended take one period more before they begin again.
            times = np.arange(steps + 2 + task.preview_length) * task.dt
            motion = law.reference.evaluate(constant.tolist(), times, NUMPY)
            self._poses = _rows(motion.pose, times.shape)
            twists = self._clipped(_rows(motion.twist(NUMPY), times.shape))
            # Row k: what is seen of the reference at step k, previews included.
            ahead = np.arange(steps + 2)[:, None] + self._strides
            self._twists = twists[ahead].reshape(len(ahead), -1)
        else:
            # Rings over time, from now to the last preview.
            self._followed = np.zeros((law.reference.size, width))
            self._poses = np.zeros((self._size, 3, width))
            self._twists = np.zeros((self._size, width, 3), np.float32)

    @property
    def state(self) -> State:
        """Components (n,) of the state, in place."""
        raise NotImplementedError

    def begin(self, rows: np.ndarray, chosen: EpisodeOptions) -> None:
        """Start episodes of some robots (int32); each draws from its generator alone."""
        reference, followed = self.law.reference, self.law.reference.constant
        if self.law.randomization is not None:
            self._renew_values(rows)
        if followed is None and reference.draws is None:
            followed = np.array([reference.draw(rng) for rng in self._of(rows)]).T.copy()
        self._start(rows, followed, self.draw(rows, self._draws), chosen)

    def reseed(self, generators: list[np.random.Generator]) -> None:
        """Take other generators."""
        self.generators = generators

    def period(self, actions: np.ndarray, ended: np.ndarray) -> tuple[StepBuffer, np.ndarray]:
        """One period; those that had ended (n,) before it begin anew instead, without reward.

        Args:
            actions: (n, k), finite numbers, float32.
            ended: (n,) bool.

        Returns:
            What all see, and which began anew, int32.
        """
        seen, rows = self.step(actions), np.flatnonzero(ended).astype(np.int32)
        if rows.size:
            self.begin(rows, USUAL)
            self.look(rows, seen)
            seen.reward[rows], seen.ends[:, rows] = 0.0, False
        return seen, rows

    def step(self, actions: np.ndarray) -> StepBuffer:
        """One period with actions as ``period`` takes them; all go on."""
        raise NotImplementedError

    def look(self, rows: np.ndarray, seen: StepBuffer) -> None:
        """Write what some robots see now, without reward and ends."""
        raise NotImplementedError

    def draw(self, rows: np.ndarray, count: int) -> np.ndarray:
        """The next numbers (count, rows) in [0, 1) of some robots, as ``Generator.random``."""
        return np.array([rng.random(count) for rng in self._of(rows)]).T

    def _of(self, rows: np.ndarray) -> list[np.random.Generator]:
        return [self.generators[i] for i in rows.tolist()]

    def _start(self, rows, followed, numbers, chosen: EpisodeOptions) -> None:
        """See ``Law.start``; ``followed`` is (P,), (P, rows) or None."""
        raise NotImplementedError

    def _renew_values(self, rows: np.ndarray) -> None:
        """Draw robots as ``Randomization.draw`` does."""
        law, left = self.law, rows
        if law.randomization.drawn_together(law.model):
            for _ in range(TRIES):
                left = left[~self._candidates(left)]
                if not left.size:
                    return
        # One robot after the other; where it must fail it says why.
        drawn = [law.randomization.draw(law.model, rng).values() for rng in self._of(left)]
        self.values[:, left] = np.array(drawn).T

    def _candidates(self, rows: np.ndarray) -> np.ndarray:
        """Draw values once; returns for each robot whether they are possible."""
        law = self.law
        numbers = self.draw(rows, law.randomization.draws(law.model))
        values, possible = law.randomization.candidate(law.model, numbers, NUMPY)
        self.values[:, rows] = [np.broadcast_to(value, rows.shape) for value in values]
        return np.broadcast_to(possible, rows.shape)

    def _clipped(self, twists: np.ndarray) -> np.ndarray:
        """Twists (..., 3) as observations show them."""
        high = self.law.task.observation_space.high[8:11]
        return np.clip(twists.astype(np.float32), -high, high)

    @cached_property
    def _strides(self) -> np.ndarray:
        """Periods from now to what is seen of the reference."""
        return np.arange(self.law.task.preview + 1) * self.law.task.preview_stride


class ArrayRobots(Robots):
    """Evaluates the law on arrays, by NumPy."""

    def __init__(self, law: Law, copies: int, steps: int):
        super().__init__(law, copies, steps)
        flat = law.structure.flatten(law.structure.rest())
        self._state = law.structure.unflatten(np.zeros(copies) for _ in flat)
        self._bind()

    @property
    def state(self) -> State:
        """See the base class."""
        return self._state

    def _bind(self) -> None:
        drawn = self.law.randomization is not None
        values = self.values[:, : self.copies] if drawn else self.values.tolist()
        self._robot = self.law.structure.bind(values)

    def _renew_values(self, rows) -> None:
        super()._renew_values(rows)
        self._bind()

    def _start(self, rows, followed, numbers, chosen) -> None:
        """See the base class."""
        structure = self.law.structure
        followed, start, keys = self.law.start(followed, numbers, chosen, NUMPY)
        pairs = zip(structure.flatten(self._state), structure.flatten(start), strict=True)
        for component, value in pairs:
            component[rows] = value
        self._commands[:, :, rows], self._integral[:, rows] = 0.0, 0.0
        self.steps[rows] = 0
        for own, key in zip(self._keys, keys, strict=False):
            own[rows] = key
        if not self._table:
            values = np.array([np.broadcast_to(value, rows.shape) for value in followed])
            self._follow(rows, values)

    def _follow(self, rows: np.ndarray, values: np.ndarray) -> None:
        """Give some robots values of their references."""
        self._followed[:, rows] = values
        shape = (self._size, len(rows))
        times = np.arange(self._size)[:, None] * self.law.task.dt
        motion = self.law.reference.evaluate(list(values), times, NUMPY)
        slots = ((self._head + np.arange(self._size)) % self._size)[:, None]
        self._poses[slots, :, rows] = _rows(motion.pose, shape)
        self._twists[slots, rows] = self._clipped(_rows(motion.twist(NUMPY), shape))

    def step(self, actions) -> StepBuffer:
        """See the base class."""
        law, n = self.law, self.copies
        given = np.clip(actions, -1.0, 1.0).T
        # Slopes are evaluated in single precision; the wheel loops (integrals) are not.
        kind = np.float32 if law.task.action_level == "torque" else float
        action = tuple(np.ascontiguousarray(given, dtype=kind))
        time = self.steps[:n] * law.task.dt
        torque, integral = law.torque(
            self._robot, self._state, tuple(self._commands[self._newest, :, :n]), action,
            tuple(self._integral[:, :n]), time, NUMPY,
        )  # fmt: skip
        self._newest = (self._newest - 1) % self._held
        self._commands[self._newest, :, :n] = torque
        self._integral[:, :n] = integral
        commands = [torque] + [
            tuple(self._commands[(self._newest + k) % self._held, :, :n])
            for k in range(1, law.history)
        ]
        self._state = law.advance(self._robot, self._state, tuple(commands), time, NUMPY_FAST)
        self.steps[:n] += 1
        if not self._table:
            self._move_on()
        seen = self.layout.new()
        self._see(slice(0, n), seen, action)
        late = (self.steps[:n] >= self.most_steps) | (
            seen.time >= law.reference.duration - law.task.dt / 2
        )
        seen.truncated[:], seen.done[:] = late, late | seen.terminated
        return seen

    def _move_on(self) -> None:
        """The oldest slot of the rings takes the newest preview."""
        ahead = (self.steps + float(self.law.task.preview_length)) * self.law.task.dt
        motion = self.law.reference.evaluate(list(self._followed), ahead, NUMPY)
        self._poses[self._head] = _rows(motion.pose, ahead.shape).T
        self._twists[self._head] = self._clipped(_rows(motion.twist(NUMPY), ahead.shape))
        self._head = (self._head + 1) % self._size

    def look(self, rows, seen) -> None:
        """See the base class."""
        width = self.law.task.action_space.shape[0]
        self._see(rows, seen, (np.zeros(len(rows), np.float32),) * width, ends=False)

    def _see(self, rows, seen: StepBuffer, action: tuple, ends: bool = True) -> None:
        law, structure = self.law, self.law.structure
        state = structure.unflatten(c[rows] for c in structure.flatten(self._state))
        steps = self.steps[: self.copies][rows]
        if self._table:
            wanted, twists = self._poses[steps].T, self._twists[steps]
        else:
            wanted = self._poses[self._head, :, : self.copies][:, rows]
            twists = self._twists[(self._head + self._strides) % self._size, : self.copies]
            twists = twists[:, rows].swapaxes(0, 1).reshape(len(steps), -1)
        keys = tuple(self._keys[:, : self.copies][:, rows])
        look = law.look(state, tuple(wanted), action, keys, steps, NUMPY_FAST)
        block = np.empty((len(look.observation), len(steps)), np.float32)
        for row, component in enumerate(look.observation):
            block[row] = component
        high = law.task.observation_space.high[: len(block), None]
        seen.observation[rows, : len(block)] = np.clip(block, -high, high, out=block).T
        seen.observation[rows, len(block) :] = twists
        seen.time[rows] = steps * law.task.dt
        seen.pose[rows] = np.array(state.pose).T
        seen.reference_pose[rows] = wanted.T
        seen.torque[rows] = self._commands[self._newest, :, : self.copies][:, rows].T
        if ends:
            seen.reward[rows], seen.terminated[rows] = look.reward, look.lost


class CompiledRobots(Robots):
    """Calls the law as machine code, traced from the same functions."""

    def __init__(self, law: Law, copies: int, steps: int):
        super().__init__(law, copies, steps)
        size, width = law.structure.state_size, self.layout.width
        # A period reads one of them and writes the other.
        self._states = [np.zeros((size, width)) for _ in range(2)]
        self._integrals = [self._integral, np.zeros_like(self._integral)]
        self._connect()

    # Functions of machine code take addresses, which belong to one object in one process.

    def __getstate__(self) -> dict:
        own = ("_kernel", "_pointers", "_numbers", "_sizes", "_call", "_interfaces",
               "_drawn", "_pointed", "_told", "_functions")  # fmt: skip
        return {k: v for k, v in self.__dict__.items() if k not in own}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._connect()

    def _connect(self) -> None:
        """Find the machine code, and tell it where the arrays lie."""
        law = self.law
        self._kernel = kernel_of(law, self._table)
        slots, places = self._kernel.slots, self._kernel.places
        self._pointers = np.zeros(len(slots), np.uint64)
        self._numbers = np.zeros(max(len(places), 1))
        self._sizes = np.array([0, self.layout.width, 0, self._draws, 0, TRIES, 0, 0], np.int64)
        self._call = tuple(map(address, (self._pointers, self._numbers, self._sizes)))
        self._drawn, self._pointed, self._told = np.empty(0), None, None
        self._functions = self._kernel.functions
        self._together = self._table
        if law.randomization is not None:
            self._together &= "robots" in self._functions
            self._sizes[4] = law.randomization.draws(law.model) or 0
        self._renewed = np.empty(2 * self.layout.width, np.int32)
        self._possible = np.empty(self.layout.width, np.bool_)
        self._reserve(int(self._sizes[3:5].max()) * self.layout.width)
        self._point("rows", self._renewed)
        self._point("possible", self._possible)
        if self.generators:
            self._point("generators", self._interfaces)
        for name in ("step", "start", "look", "robots"):
            if name in self._functions:
                at = ctypes.cast(self._functions[name], ctypes.c_void_p).value
                self._pointers[slots[f"function {name}"]] = at
        self._point("steps", self.steps)
        self._point("keys", self._keys)
        self._point("values", self.values)
        if self._table:
            self._point("poses", self._poses)
            self._point("twists", self._twists)
        else:
            self._point("followed", self._followed)
            # Row h: where the previews lie when the head is at slot h.
            order = (np.arange(self._size)[:, None] + self._strides) % self._size
            slot = np.arange(self._size) * self._twists[0].nbytes + address(self._twists)
            self._twist_addresses = slot.astype(np.uint64)[order]
            self._twist_slots = [slots[f"twist {k}"] for k in range(len(self._strides))]
            self._point_at_head()
        self._point("state", self._states[0])
        self._point("next", self._states[1])
        self._point("integral", self._integrals[0])
        self._point("next integral", self._integrals[1])
        held = np.arange(self._held)
        blocks = (held * self._commands[0].nbytes + address(self._commands)).astype(np.uint64)
        # Row h: where the commands lie, newest first, when the newest is block h.
        self._command_addresses = blocks[(held[:, None] + held) % self._held]
        self._command_slots = [slots[f"command {k}"] for k in held]
        self._pointers[self._command_slots] = self._command_addresses[self._newest]
        self._seen_slots = [slots[f"seen {name}"] for name in self.layout.offsets]
        self._seen_offsets = np.array(list(self.layout.offsets.values()), np.uint64)
        end = law.reference.duration - law.task.dt / 2
        numbers = {"most_steps": self.most_steps, "end": end, "substeps": law.substeps}
        if law.randomization is None:
            numbers |= {f"value {k}": v for k, v in enumerate(self.values)}
        if law.reference.constant is not None:
            numbers |= {f"followed {k}": v for k, v in enumerate(law.reference.constant)}
        for name, value in numbers.items():
            self._tell(name, value)

    def _point(self, name: str, array: np.ndarray) -> None:
        if name in self._kernel.slots:
            self._pointers[self._kernel.slots[name]] = address(array)

    def _tell(self, name: str, value: float) -> None:
        if name in self._kernel.places:
            self._numbers[self._kernel.places[name]] = value

    def _point_at_head(self) -> None:
        self._pointers[self._twist_slots] = self._twist_addresses[self._head]
        self._point("pose now", self._poses[self._head])

    def _run(self, name: str, rows: np.ndarray | None = None) -> None:
        """Call a function for all robots, or for some, for which packed arrays are meant."""
        if rows is None:
            self._sizes[0] = self.copies
        else:
            self._sizes[0] = self._sizes[2] = len(rows)
            self._pointers[0] = address(rows)
        self._functions[name](*self._call)

    @property
    def state(self) -> State:
        """See the base class."""
        return self.law.structure.unflatten(self._states[0][:, : self.copies])

    def draw(self, rows, count) -> np.ndarray:
        """See the base class; by NumPy's interface for C, without a call of Python each.

        The next call writes over the result.
        """
        self._reserve(count * len(rows))
        self._numbers[0] = count
        self._run("draw", rows)
        return self._drawn[: count * len(rows)].reshape(count, -1)

    def _reserve(self, size: int) -> None:
        """Room for so many random numbers."""
        if self._drawn.size < size:
            self._drawn = np.empty(size)
            self._point("numbers", self._drawn)

    @cached_property
    def _interfaces(self) -> np.ndarray:
        """Where NumPy's interface for C to each generator lies in memory."""
        get = ctypes.pythonapi.PyCapsule_GetPointer
        get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
        capsules = (rng.bit_generator.capsule for rng in self.generators)
        return np.array([get(capsule, b"BitGenerator") for capsule in capsules], np.uint64)

    def reseed(self, generators: list[np.random.Generator]) -> None:
        """See the base class."""
        super().reseed(generators)
        self.__dict__.pop("_interfaces", None)
        self._point("generators", self._interfaces)

    def _candidates(self, rows) -> np.ndarray:
        """See the base class."""
        self.draw(rows, self.law.randomization.draws(self.law.model))
        self._run("robots", rows)
        return self._possible[: len(rows)].copy()

    def _start(self, rows, followed, numbers, chosen) -> None:
        """See the base class."""
        self._choose(chosen)
        if followed is not None and followed.ndim == 2:
            self._point("given", followed)
        self._run("start", rows)
        if not self._table:
            self._fill(rows, range(len(self._strides)))

    def _choose(self, chosen: EpisodeOptions) -> None:
        """Tell the machine code what the user said about the start."""
        if chosen != self._told:
            for k in range(3):
                self._tell(f"velocity {k}", chosen.velocity[k] if chosen.velocity else 0.0)
                self._tell(f"offset {k}", chosen.offset[k] if chosen.offset else 0.0)
            self._tell("follow", chosen.follow and chosen.velocity is None)
            self._tell("displace", chosen.offset is not None)
            self._told = chosen

    def _fill(self, rows: np.ndarray | None, previews) -> None:
        """Put the reference of some robots (or all) into the rings, at some of the previews."""
        if rows is not None and len(rows) == self.copies:
            rows = None  # where all are meant nothing is gathered
        for k in previews:
            ahead = int(self._strides[k])
            slot = (self._head + ahead) % self._size
            self._point("pose then", self._poses[slot])
            self._point("twist then", self._twists[slot])
            self._tell("ahead", ahead)
            self._run("fill" if rows is None else "fill chosen", rows)

    def step(self, actions) -> StepBuffer:
        """See the base class."""
        self.steps[: self.copies] += 1
        if not self._table:
            self._head = (self._head + 1) % self._size
            self._fill(None, [len(self._strides) - 1])
            # Later previews were nearer ones a while ago, but for episodes that are younger.
            young = np.flatnonzero(self.steps[: self.copies] < self.law.task.preview_stride)
            if young.size:
                self._fill(young.astype(np.int32), range(len(self._strides) - 1))
            self._point_at_head()
        return self._stepped(actions, "step")

    def period(self, actions, ended) -> tuple[StepBuffer, np.ndarray]:
        """See the base class; one call of machine code where all follow one reference."""
        if not self._together:
            return super().period(actions, ended)
        self.steps[: self.copies] += 1
        self._choose(USUAL)
        self._point("ended", ended)
        seen = self._stepped(actions, "period")
        began, impossible = self._sizes[6:].tolist()
        rows = self._renewed[:began]
        if impossible:  # one at a time, which says why
            self.begin(rows, USUAL)
        return seen, rows

    def _stepped(self, actions: np.ndarray, function: str) -> StepBuffer:
        """Call a function that moves all robots on by one period."""
        pointers, slots = self._pointers, self._kernel.slots
        self._newest = (self._newest - 1) % self._held
        pointers[self._command_slots] = self._command_addresses[self._newest]
        seen = self.layout.new()
        self._point_at(seen)
        actions = np.ascontiguousarray(actions, np.float32)
        pointers[slots["actions"]] = address(actions)
        self._run(function)
        self._states.reverse()
        self._integrals.reverse()
        self._point("state", self._states[0])
        self._point("next", self._states[1])
        if self.law.task.action_level == "velocity":
            self._point("integral", self._integrals[0])
            self._point("next integral", self._integrals[1])
        return seen

    def _point_at(self, seen: StepBuffer) -> None:
        if seen is not self._pointed:
            begin = np.uint64(address(seen.memory))
            self._pointers[self._seen_slots] = self._seen_offsets + begin
            self._pointed = seen

    def look(self, rows, seen) -> None:
        """See the base class."""
        self._point_at(seen)
        self._run("look", rows)


def _rows(components: tuple, shape: tuple) -> np.ndarray:
    """Components, each of a shape or of one that can be broadcast to it, as rows (..., 3)."""
    return np.stack([np.broadcast_to(c, shape) for c in components], axis=-1)
