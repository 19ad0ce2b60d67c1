"""What somebody states about how a log was recorded: ``drive_hold=sampled, drive_offset=0.02``."""

from __future__ import annotations

from collections.abc import Iterable

from youbot_env.effects import effect_names, get_effect
from youbot_env.platform import Platform


def parse_declaration(items: Iterable[str], platform: Platform) -> dict[str, dict[str, float]]:
    """Turn ``EFFECT=VALUE`` and ``EFFECT.PARAMETER=VALUE`` into sensor effects with their values.

    What is not stated of an effect is nothing.

    Raises:
        ValueError: no sensor effect, no value, or one that cannot be.
    """
    found: dict[str, dict[str, float]] = {}
    for item in items:
        place, given, text = (part.strip() for part in item.partition("="))
        name, _, parameter = place.partition(".")
        sensors = [n for n in effect_names() if get_effect(n).link == "sensor"]
        if name not in sensors:
            raise ValueError(f"recording {item!r}: {name!r} is none of {', '.join(sensors)}")
        effect = get_effect(name)
        if not (given and text):
            raise ValueError(f"recording {item!r}: write {place}=VALUE")
        parameter = parameter or effect.parameters[0].name
        values = found.setdefault(name, {p.name: 0.0 for p in effect.parameters})
        value: float | str = text
        if text not in effect.parameter_of(parameter).choices:
            try:
                value = float(text)
            except ValueError:
                words = ", ".join(effect.parameter_of(parameter).choices)
                remedy = f"choose {words}" if words else "give a number, with a decimal point"
                raise ValueError(f"recording {item!r}: {text!r}; {remedy}") from None
        values[parameter] = effect.complete({**values, parameter: value}, platform)[parameter]
    return found
