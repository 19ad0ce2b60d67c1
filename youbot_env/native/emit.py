"""Writes a traced function as C that works on tiles of robots.

A tile is ``LANES`` robots whose numbers stay in the fastest cache.  All that is the same for all
robots is computed before the first tile.  Between loops of a tile its robots are one loop over
lanes, which the compiler turns into vector instructions; what a later loop over lanes reads lies in
an array of the tile.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from youbot_env.native.trace import Graph, Node

LANES = 64
TYPES = {"d": "double", "f": "float", "i": "uint32_t", "b": "uint8_t"}
INFIX = {
    "add": "+", "sub": "-", "mul": "*", "div": "/", "lt": "<", "le": "<=", "gt": ">", "ge": ">=",
    "or": "|", "and": "&", "xor": "^", "plus": "+", "times": "*", "shift": ">>",
}  # fmt: skip
PRELUDE, DRAW = ((Path(__file__).parent / name).read_text() for name in ("prelude.h", "draw.h"))


@dataclass(frozen=True)
class Array:
    """An array in memory that a function reads or writes, one entry a robot and component.

    Attributes:
        slot: which of the pointers.
        kind: type of an entry, as kinds of nodes.
        layout: ``robots`` (components, width): all robots; ``packed`` (components, chosen): those
            that the call is for, side by side; ``rows`` (robots, components), as users give actions
            and take observations; ``table`` (instants, components), read at the instant of each
            robot.
        components: how many.
        instants: slot of the instants (robots,) uint32 of a table.
    """

    slot: int
    kind: str
    layout: str = "robots"
    components: int = 1
    instants: int = 0


@dataclass(frozen=True)
class Output:
    """What is written where: ``node`` into one component of an array."""

    array: Array
    component: int
    node: Node


@dataclass(frozen=True)
class Copied:
    """What is written as it stands in memory: the row of a robot, into a row of another array.

    Attributes:
        array: written, of layout ``rows``.
        component: the first one written.
        source: read, of layout ``rows`` or ``table`` and the same kind.
    """

    array: Array
    component: int
    source: Array


def read(graph: Graph, array: Array) -> tuple[Node, ...]:
    """Nodes of the components of an array."""
    return tuple(graph.node("load", (array, k), array.kind, True) for k in range(array.components))


def function_text(
    name: str, graph: Graph, outputs: list[Output], chosen: bool, copied: tuple[Copied, ...] = ()
) -> str:
    """C of ``void name(void *const *p, const double *u, const long *z)``.

    Args:
        name: of the function.
        graph: the traced expressions.
        outputs: what it writes.
        chosen: whether it works on the robots of a list, pointer 0, and not on all.
        copied: what it copies beside that.

    Returns:
        The text.  ``p`` are the pointers by slot, ``u`` the numbers that are the same for all,
        ``z`` how many robots, width of the arrays of all robots, of the packed ones.
    """
    return _Writer(name, graph, outputs, chosen, copied).text()


class _Writer:
    def __init__(self, name: str, graph: Graph, outputs: list[Output], chosen: bool, copied):
        self.name, self.graph, self.outputs, self.chosen = name, graph, outputs, chosen
        self.copied = copied
        self.loops = {id(loop): k for k, loop in enumerate(graph.loops)}
        self._find_used()
        self._place()

    # What is needed, and where

    def _find_used(self) -> None:
        used: set[int] = set()
        stack = [output.node for output in self.outputs]
        while stack:
            node = stack.pop()
            if node.number in used:
                continue
            used.add(node.number)
            stack += [a for a in node.args if isinstance(a, Node)]
            if node.op in ("within", "after"):
                number, k = node.args[:2]
                loop = self.graph.loops[number]
                stack += [loop.before[k], loop.within[k], loop.after[k], loop.count]
        self.used = [node for node in self.graph.nodes if node.number in used]
        numbers = {node.number for node in self.used}
        self.carried = {
            number: [k for k, node in enumerate(loop.within) if node.number in numbers]
            for number, loop in enumerate(self.graph.loops)
        }

    def _place(self) -> None:
        """Give each node the latest region that is early enough for all that use it.

        Regions 0, 2, 4, ... are loops over lanes, 1, 3, ... the repeated pieces between them.
        """
        last = 2 * len(self.graph.loops)
        region = {node.number: last for node in self.used}
        users: list[tuple[Node, int]] = []
        for output in self.outputs:
            users.append((output.node, last))
        for number in self.carried:
            loop = self.graph.loops[number]
            users += [(loop.before[k], 2 * number) for k in self.carried[number]]
            users += [(loop.after[k], 2 * number + 1) for k in self.carried[number]]
        for node, at in users:
            region[node.number] = min(region[node.number], at)
        for node in reversed(self.used):
            at = region[node.number]
            for arg in node.args:
                if isinstance(arg, Node):
                    region[arg.number] = min(region[arg.number], at)
        self.region = {}
        for node in self.used:
            at = region[node.number]
            if node.loop is not None:
                at = 2 * self.loops[id(node.loop)] + 1
            elif at % 2:
                at -= 1  # the same at every turn: once, before the loop
            self.region[node.number] = at

    # Text

    def text(self) -> str:
        """See ``function_text``."""
        last = 2 * len(self.graph.loops)
        self.crossing: dict[int, Node] = {}
        bodies = [self._body(at) for at in range(last + 1)]
        for number in self.crossing:
            bodies[self.region[number]].append(f"t{number}[i] = v{number};")
        lines = [f"void {self.name}(void *const *p, const double *u, const long *z) {{"]
        lines += [f"  {line}" for line in self._arrays()]
        lines += ["  const long count = z[0], width = z[1];"]
        lines += ["  const long packed = z[2];"]
        lines += ["  (void)width; (void)packed; (void)u;"]
        lines += [f"  {line}" for line in self._uniform()]
        lines += [f"  for (long begin = 0; begin < count; begin += {LANES}) {{"]
        lines += [f"    {line}" for line in self._tile()]
        for node in self.crossing.values():
            lines.append(f"    {TYPES[node.kind]} t{node.number}[{LANES}];")
        for number, carried in self.carried.items():
            for k in carried:
                kind = TYPES[self.graph.loops[number].within[k].kind]
                lines.append(f"    {kind} c{number}_{k}[{LANES}];")
        for at, body in enumerate(bodies):
            if at % 2:
                count = self._whole(self.graph.loops[at // 2].count)
                lines.append(f"    for (long turn = 0; turn < {count}; turn++)")
            lines.append(f"    EVERY_LANE for (int i = 0; i < {LANES}; i++) {{")
            lines += [f"      {line}" for line in body]
            lines.append("    }")
        lines += [f"    {line}" for line in self._scattered()]
        return "\n".join([*lines, "  }", "}", ""])

    def _whole(self, node: Node) -> str:
        return f"(long){self._uniform_value(node)}"

    def _read_arrays(self) -> list[Array]:
        loads = [node.args[0] for node in self.used if node.op == "load"]
        return list(dict.fromkeys(loads))

    def _arrays(self) -> Iterable[str]:
        sources = [copied.source for copied in self.copied]
        reads = {array.slot: array.kind for array in (*self._read_arrays(), *sources)}
        reads |= {a.instants: "i" for a in (*self._read_arrays(), *sources) if a.layout == "table"}
        written = {output.array.slot: output.array.kind for output in self.outputs}
        for slot, kind in reads.items():
            yield f"const {TYPES[kind]} *restrict a{slot} = p[{slot}];"
        for slot, kind in written.items():
            yield f"{TYPES[kind]} *restrict a{slot} = p[{slot}];"
        if self.chosen:
            yield "const int32_t *restrict chosen = p[0];"

    @property
    def _robot(self) -> str:
        return "robot[i]" if self.chosen else "(begin + i)"

    def _row(self, array: Array) -> str:
        """Where the row of robot i begins."""
        place = (
            f"(long)a{array.instants}[{self._robot}]" if array.layout == "table" else self._robot
        )
        return f"a{array.slot} + {place} * {array.components}"

    def _tile(self) -> Iterable[str]:
        yield f"const long lanes = count - begin < {LANES} ? count - begin : {LANES};"
        yield "(void)lanes;"
        if self.chosen:
            # The last robot fills up the last tile: it is computed again and comes out the same.
            yield f"int32_t robot[{LANES}], place[{LANES}];"
            yield f"for (int i = 0; i < {LANES}; i++) {{"
            yield "  place[i] = (int32_t)(begin + (i < lanes ? i : lanes - 1));"
            yield "  robot[i] = chosen[place[i]];"
            yield "}"
        # What does not lie side by side is gathered and scattered one robot after the other: the
        # instructions that do so for a vector take longer on many processors.
        for array in self._read_arrays():
            if not self._staged(array):
                continue
            # Loops, not one line for each of hundreds of components: these take minutes to compile.
            kind, n = TYPES[array.kind], array.components
            yield f"{kind} r{array.slot}[{n}][{LANES}];"
            each = f"for (int k = 0; k < {n}; k++)"
            if array.layout in ("rows", "table"):
                # Behind the last robot users' arrays end.
                given = "i < lanes ? row[k] : 0" if array.layout == "rows" else "row[k]"
                yield f"for (int i = 0; i < {LANES}; i++) {{"
                yield f"  const {kind} *row = {self._row(array)};"
                yield f"  {each} r{array.slot}[k][i] = {given};"
                yield "}"
            else:
                yield f"{each} for (int i = 0; i < {LANES}; i++)"
                yield f"  r{array.slot}[k][i] = {self._address(array, 'k')};"
        for array in self._written():
            if self._staged(array):
                kind = "int32_t" if array.kind == "b" else TYPES[array.kind]
                yield f"{kind} o{array.slot}[{array.components}][{LANES}];"

    def _written(self) -> list[Array]:
        return list(dict.fromkeys(output.array for output in self.outputs))

    def _staged(self, array: Array) -> bool:
        """Whether it is read before the loops over lanes and written after them.

        That is what does not lie side by side, and entries of one byte: the smallest type of a loop
        decides how many lanes it takes at a time.
        """
        return self.chosen or array.layout in ("rows", "table") or array.kind == "b"

    def _scattered(self) -> Iterable[str]:
        for array in self._written():
            if not self._staged(array):
                continue
            kind, last = (
                TYPES[array.kind],
                1 + max(output.component for output in self.outputs if output.array == array),
            )
            each = f"for (int k = 0; k < {last}; k++)"
            if array.layout != "rows":
                yield f"{each} for (int i = 0; i < lanes; i++)"
                yield f"  {self._address(array, 'k')} = ({kind})o{array.slot}[k][i];"
                continue
            yield "for (int i = 0; i < lanes; i++) {"
            yield f"  {kind} *row = {self._row(array)};"
            yield f"  {each} row[k] = o{array.slot}[k][i];"
            for copied in self.copied:
                size = f"{copied.source.components} * sizeof *row"
                if copied.array == array:
                    yield f"  memcpy(row + {copied.component}, {self._row(copied.source)}, {size});"
            yield "}"

    def _uniform(self) -> Iterable[str]:
        kinds = {"b": "int"}
        for node in self.used:
            if node.varies or node.op == "const":
                continue
            kind = kinds.get(node.kind, "double")
            value = f"u[{node.args[0]}]" if node.op == "uniform" else self._expression(node, "d")
            yield f"const {kind} u{node.number} = {value};"
            if kind == "double":
                yield f"const float w{node.number} = (float)u{node.number};"

    def _uniform_value(self, node: Node) -> str:
        return _literal(node.value, "d") if node.op == "const" else f"u{node.number}"

    def _body(self, at: int) -> list[str]:
        lines: list[str] = []
        self._here, self._read_here = at, set()
        number = at // 2
        if at % 2:
            for k in self.carried[number]:
                node = self.graph.loops[number].within[k]
                lines.append(f"const {TYPES[node.kind]} v{node.number} = c{number}_{k}[i];")
        for node in self.used:
            if not node.varies or node.op == "within" or self.region[node.number] != at:
                continue
            value = self._expression(node, node.kind, lines)
            kind = "int" if node.kind == "b" else TYPES[node.kind]
            lines.append(f"const {kind} v{node.number} = {value};")
        if number < len(self.graph.loops):
            loop = self.graph.loops[number]
            ends = loop.after if at % 2 else loop.before
            for k in self.carried[number]:
                value = self._value(ends[k], loop.within[k].kind, lines)
                lines.append(f"c{number}_{k}[i] = {value};")
        else:
            for output in self.outputs:
                array, k = output.array, output.component
                value = self._value(output.node, array.kind, lines)
                staged = self._staged(array)
                target = f"o{array.slot}[{k}][i]" if staged else self._address(array, k)
                lines.append(f"{target} = {value};")
        return lines

    def _address(self, array: Array, k: int | str) -> str:
        name = f"a{array.slot}"
        if array.layout == "packed":
            return f"{name}[{k} * packed + {'place[i]' if self.chosen else 'begin + i'}]"
        return f"{name}[{k} * width + {'robot[i]' if self.chosen else 'begin + i'}]"

    def _value(self, node: Node, kind: str, lines: list[str]) -> str:
        """The node as a value of a kind, within a loop over lanes."""
        if node.op == "const":
            return _literal(node.value, kind)
        if not node.varies:
            if kind == "i":
                return f"(uint32_t)u{node.number}"
            return f"{'w' if kind == 'f' and node.kind != 'b' else 'u'}{node.number}"
        at = self.region[node.number]
        if at != self._here and node.number not in self._read_here:
            source = f"t{node.number}[i]"
            self._read_here.add(node.number)
            self.crossing[node.number] = node
            lines.append(f"const {TYPES[node.kind]} v{node.number} = {source};")
        name = f"v{node.number}"
        if node.kind == kind or kind == "b":
            return name
        return f"({TYPES[kind]}){name}"

    def _expression(self, node: Node, kind: str, lines: list[str] | None = None) -> str:
        lines = [] if lines is None else lines

        def value(arg: Node, wanted: str) -> str:
            if node.varies:
                return self._value(arg, wanted, lines)
            return self._uniform_value(arg)

        op, args = node.op, node.args
        if op == "load":
            array, k = args
            return f"r{array.slot}[{k}][i]" if self._staged(array) else self._address(array, k)
        if op == "after":
            return f"c{args[0]}_{args[1]}[i]"
        if op == "cast":
            source = value(args[0], args[0].kind)
            # Conversions from signed integers are single instructions.
            return f"({TYPES[kind]}){'(int32_t)' if args[0].kind == 'i' else ''}{source}"
        if op in ("lt", "le", "gt", "ge"):
            varying = [a.kind for a in args if a.varies]
            kind = "d" if "d" in varying or not varying else varying[0]
        if op in ("or", "and"):
            kind = "b"
        if op == "where":
            condition = value(args[0], "b")
            return f"{condition} ? {value(args[1], kind)} : {value(args[2], kind)}"
        if op in ("cos", "sin") and node.varies and args[0].kind == "d":
            return f"{op}_d({value(args[0], 'd')})"
        operands = [value(a, kind) for a in args]
        if op in INFIX:
            return f" {INFIX[op]} ".join(operands)
        if op == "neg":
            return f"-{operands[0]}"
        return f"{op}_{kind if node.varies else 'u'}({', '.join(operands)})"


def _literal(value: float, kind: str) -> str:
    if kind == "i":
        return f"{int(value)}u"
    if kind == "b":
        return str(int(bool(value)))
    text = repr(float(value))
    if text in ("inf", "-inf", "nan"):
        return {"inf": "INFINITY", "-inf": "-INFINITY", "nan": "NAN"}[text]
    text = text if value >= 0 and text[0] != "-" else f"({text})"
    if kind == "f":
        return text.replace(")", "f)") if text.endswith(")") else f"{text}f"
    return text
