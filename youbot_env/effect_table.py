"""The table of all effects for people, written from the effects themselves.

``python -m youbot_env.effect_table`` prints docs/effects.md.
"""

from __future__ import annotations

from youbot_env.effects import Effect, effect_names, get_effect

INTRODUCTION = """\
# Effects

Written by `python -m youbot_env.effect_table > docs/effects.md`; do not edit by hand.

Each effect is one file in `youbot_env/effects`. The identifier is its name on the command line, in
model files and in JSON. The link says where in the chain from torque command to sensor it acts.
Parameters are given with unit, typical size and bounds; *linear* ones enter the law linearly,
so that the law at one is their column in a regression. *Per wheel* means that each wheel may have
its own value. What is *of the record* belongs to one log (its floor, its load, its instruments),
all else goes with the robot. Effects of the link *sensor* leave the robot as it is: they say how
the rows of a log came to be. Signs: a torque or wrench written here is added to that of the drive.
Symbols: wheel speed φ', roller rate γ', shaft torque M, body velocity V and Ω, heading ψ.
"""


def effect_table() -> str:
    """Return docs/effects.md: one row for each effect shipped with the library, as Markdown."""
    header = ("Identifier", "Link", "Equation", "Parameters", "Looks like", "Told apart by")
    effects = [get_effect(name) for name in effect_names()]
    rows = [_row(e) for e in effects if e.__module__.startswith("youbot_env.effects.")]
    lines = [header, ("---",) * len(header), *rows]
    return INTRODUCTION + "\n" + "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _row(effect: Effect) -> tuple[str, ...]:
    # The Markdown viewer of GitHub refuses \operatorname, which everything else understands.
    equation = effect.equation.replace(r"\operatorname{", r"\mathrm{")
    return (
        f"`{effect.identifier}`<br>{effect.title}",
        effect.link,
        f"$`{equation}`$",
        "<br>".join(_parameter(parameter) for parameter in effect.parameters),
        ", ".join(f"`{name}`" for name in effect.confusables),
        "; ".join(effect.experiments),
    )


def _parameter(parameter) -> str:
    unit = f" {parameter.unit}" if parameter.unit else ""
    low, high = parameter.bounds
    if parameter.choices:
        return f"`{parameter.name}` {parameter.meaning}: {', '.join(parameter.choices)}"
    kinds = ["linear"] * parameter.linear + ["per wheel"] * parameter.per_wheel
    kinds += ["of the record"] * (parameter.scope == "record")
    kind = f" ({', '.join(kinds)})" if kinds else ""
    return (
        f"`{parameter.name}` {parameter.meaning}{kind}: "
        f"{parameter.default:.4g}{unit}, {low:.4g} to {high:.4g}"
    )


if __name__ == "__main__":
    print(effect_table(), end="")
