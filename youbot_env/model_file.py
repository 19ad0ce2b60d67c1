"""Model files: YAML in and out, checked on the way in, written whole or not at all."""

from __future__ import annotations

import math
import os
import tempfile
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import yaml

from youbot_env import schema
from youbot_env.arguments import check_kind
from youbot_env.model import Model
from youbot_env.parameters import UNITS, ImpossibleParameters, Parameters
from youbot_env.platform import PLATFORMS, Platform, Wheel
from youbot_env.shipped import Shipped
from youbot_env.strict_yaml import read_yaml

MODELS = Shipped(Path(__file__).parent / "models", ".yaml", ("models",))
DEGREES = ("roller_angle", "heading")
# Of correlations; those of models/identified.yaml are symmetric to 2e-16.
ROUNDING = 1e-9


class ModelFileError(ValueError):
    """A model file that cannot be used; the message says where and what to do."""


def load_model(source: str | os.PathLike | Model) -> Model:
    """Read a model.

    Args:
        source: path of a YAML file; the name of a model in the folder ``models`` of the working
            directory or of a shipped one (``nominal``, ``paper``, ``identified``); or a model,
            which is returned as it is.

    Raises:
        TypeError: none of these.
        ModelFileError: unreadable file, malformed YAML, unknown or missing entries.
        ImpossibleParameters: values that no robot can have.
    """
    if isinstance(source, Model):
        return source
    check_kind("model", source, (str, os.PathLike), "a model, the path of its file or a name")
    path = find_model(source)
    try:
        data = read_yaml(path)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ModelFileError(f"{path} is not valid YAML: {error}") from error
    try:
        return model_from_dict(data, default_name=path.stem).check()
    except ImpossibleParameters as error:
        raise ImpossibleParameters(f"{path}: {error}") from error
    except ValueError as error:
        raise ModelFileError(f"{path}: {error}") from error


def find_model(source: str | os.PathLike) -> Path:
    """Return the path of a model file given by path or by name, see ``youbot_env.shipped``."""
    path = MODELS.find(source)
    if path is None:
        raise ModelFileError(
            f"no model file {str(source)!r}; give the path of a YAML file or one of the shipped "
            f"models {MODELS.names()}"
        )
    return path


def model_from_dict(data: object, default_name: str = "model") -> Model:
    """Build a model from the content of a model file."""
    if not isinstance(data, dict):
        raise ModelFileError(f"expected sections {schema.MODEL.names}, found {type(data).__name__}")
    _refuse_unknown(data, schema.MODEL.names, "among the sections")
    for section in schema.MODEL.needed:
        if section not in data:
            raise ModelFileError(f"section {section!r} is missing")
    platform = platform_from_dict(data["platform"])
    entries = _mapping(data["parameters"], "parameters")
    values, sources, errors = {}, {}, {}
    for name, entry in entries.items():
        entry = entry if isinstance(entry, dict) else {"value": entry}
        _refuse_unknown(entry, schema.PARAMETER.names, f"in {name}")
        if "value" not in entry:
            raise ModelFileError(f"parameters: {name} has no value")
        if name in UNITS and entry.get("unit", UNITS[name]) != UNITS[name]:
            raise ModelFileError(
                f"parameters: {name} has unit {entry['unit']!r}; convert it to {UNITS[name]!r}"
            )
        values[name] = entry["value"]
        sources[name] = str(entry.get("source", ""))
        if entry.get("standard_error") is not None:
            error = _number(entry["standard_error"], f"standard_error of {name}")
            errors[name] = schema.PARAMETER["standard_error"].check(error, f"{name}: ")
    parameters = Parameters.from_mapping(values)
    for entry in schema.PARAMETERS.entries:
        # What is too small is told together, as of a robot that cannot be.
        lowest = -math.inf if entry.low is None else entry.low
        entry.check(max(getattr(parameters, entry.name), lowest), "parameters: ")
    model = Model(
        platform,
        parameters,
        name=str(data.get("name", default_name)),
        sources=sources,
        standard_errors=errors,
        provenance=_mapping(data.get("provenance") or {}, "provenance"),
    ).with_effects(_effects(data.get("effects") or []))
    return replace(model, covariance=_covariance(data.get("covariance"), len(model.names())))


def _effects(data: object) -> dict:
    """Values by identifier, as ``Model.with_effects`` takes them."""
    if not isinstance(data, list):
        raise ModelFileError(
            f"effects: {data!r} is not a list; write one '- identifier: NAME' for each effect"
        )
    chosen = {}
    for entry in data:
        entry = {"identifier": entry} if isinstance(entry, str) else _mapping(entry, "effects")
        _refuse_unknown(entry, ("identifier", "parameters"), "in effects")
        identifier = entry.get("identifier")
        if not isinstance(identifier, str):
            raise ModelFileError(f"effects: {entry} has no identifier; give one of docs/effects.md")
        if identifier in chosen:
            raise ModelFileError(f"effects: {identifier!r} is listed twice; remove one")
        chosen[identifier] = entry.get("parameters")
    return chosen


def _covariance(data: object, size: int) -> list[list[float]] | None:
    if data is None:
        return None
    rows = data if isinstance(data, list) else []
    shape = [len(row) if isinstance(row, list) else 0 for row in rows]
    if shape != [size] * size:
        raise ModelFileError(
            f"covariance: it needs {size} rows of {size} numbers, one for each value of the model; "
            "negative; identify again or remove the section"
        )
    values = [[_number(value, "covariance") for value in row] for row in rows]
    _check_covariance(np.array(values))
    return values


def _check_covariance(values: np.ndarray) -> None:
    """Refuse what no estimate can have: its correlations are not symmetric or not a covariance."""
    variances = np.diag(values)
    if (variances < 0.0).any():
        raise ModelFileError(
            f"covariance: variance {variances.min():g} in row {variances.argmin() + 1} is "
            "negative; identify again or remove the section"
        )
    scale = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    correlation = values / scale[:, None] / scale
    uneven = np.abs(correlation - correlation.T).max(initial=0.0)
    # Both sides of an uneven matrix count in its symmetric half; only then eigenvalues are real.
    least = np.linalg.eigvalsh((correlation + correlation.T) / 2).min(initial=0.0)
    if uneven > ROUNDING or least < -ROUNDING:
        what = "is not symmetric" if uneven > ROUNDING else f"has eigenvalue {least:.3g}"
        raise ModelFileError(
            f"covariance: its matrix of correlations {what}, which no estimate has; identify again "
            "or remove the section"
        )


def model_to_dict(model: Model) -> dict:
    """Return what a model file holds."""
    parameters = {
        name: {
            "value": float(value),
            "unit": UNITS[name],
            "standard_error": model.standard_errors.get(name),
            "source": model.sources.get(name, ""),
        }
        for name, value in model.parameters.as_dict().items()
    }
    data = {"name": model.name, "platform": platform_to_dict(model.platform)}
    data["parameters"] = parameters
    data["effects"] = [
        {"identifier": a.identifier, "parameters": {k: float(v) for k, v in a.values.items()}}
        for a in model.effects
    ]
    if model.covariance is not None:
        data["covariance"] = model.covariance
    if model.provenance:
        data["provenance"] = model.provenance
    return data


def platform_to_dict(platform: Platform) -> dict:
    """Return what the section ``platform`` of a model file holds."""
    data = asdict(platform)
    for wheel in data["wheels"]:
        for name in DEGREES:
            wheel[f"{name}_deg"] = _degrees(wheel.pop(name))
    data["wheels"] = list(data["wheels"])
    return data


def _degrees(angle: float) -> float:
    """Degrees that turn back into exactly this angle, rad: the roundest near it that do."""
    exact = math.degrees(angle)
    near = (math.nextafter(exact, side) for side in (-math.inf, math.inf))
    candidates = (*(round(exact, digits) for digits in (9, 12)), exact, *near)
    return next((d for d in candidates if math.radians(d) == angle), exact)


def save_model(model: Model, path: str | os.PathLike) -> None:
    """Write a model file through a temporary file, so that a failure leaves the old one."""
    text = yaml.safe_dump(model_to_dict(model), sort_keys=False, allow_unicode=True, width=100)
    write_atomically(path, text)


def write_atomically(path: str | os.PathLike, content: str | bytes) -> Path:
    """Write to a temporary file beside ``path``, rename it into place, and return the path.

    The content is on the disk before the name is, so that a power cut leaves the old file or the
    new one.  A link stays a link: the file that it leads to is replaced.
    """
    path = Path(path)
    target = path.resolve() if path.is_symlink() else path
    data = content.encode("utf-8") if isinstance(content, str) else content
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, target)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path


def platform_from_dict(data: object) -> Platform:
    """Build a platform from its name or from the section ``platform`` of a model file.

    Wheels stand at ``x, y`` m, or at ``distance`` m from the centre and ``at_deg`` from forward;
    the latter are omni wheels that roll at right angles to it unless they say otherwise.

    Raises:
        ModelFileError: a missing, unknown or wrong entry.
        ValueError: wheels that cannot be.
    """
    if isinstance(data, str):
        if data not in PLATFORMS:
            raise ModelFileError(f"unknown platform {data!r}; known: {sorted(PLATFORMS)}")
        return PLATFORMS[data]()
    data = dict(_mapping(data, "platform"))
    _refuse_unknown(data, schema.PLATFORM.names, "in platform")
    for name in schema.PLATFORM.needed:
        if name not in data:
            raise ModelFileError(f"platform: {name} is missing")
    wheels, table = [], data.pop("wheels")
    if not isinstance(table, list):
        raise ModelFileError(f"platform: wheels = {table!r} is not a list; write one '- ' a wheel")
    for number, entry in enumerate(table, start=1):
        entry = dict(_mapping(entry, f"wheel {number}"))
        try:
            wheels.append(_wheel(entry, number))
        except KeyError as error:
            raise ModelFileError(f"platform: wheel {number} has no {error.args[0]}") from error
        except (TypeError, ValueError) as error:
            raise ModelFileError(f"platform: wheel {number} {entry}: {error}") from error
    name = str(data.pop("name", "platform"))
    try:
        numbers = {key: float(value) for key, value in data.items()}
    except (TypeError, ValueError) as error:
        raise ModelFileError(f"platform: {data}: {error}") from error
    for key, value in numbers.items():
        schema.PLATFORM[key].check(value, "platform: ")
    return Platform(name, tuple(wheels), **numbers)


def _wheel(entry: dict, number: int) -> Wheel:
    _refuse_unknown(entry, schema.WHEEL.names, "in wheels")
    for key in entry:
        if key != "name":
            schema.WHEEL[key].check(float(entry[key]), "")
    if "distance" in entry or "at_deg" in entry:
        distance, at = float(entry.pop("distance")), float(entry.pop("at_deg"))
        if "x" in entry or "y" in entry:
            raise ValueError("give x and y, or distance and at_deg")
        angle = math.radians(at)
        place = {"x": distance * math.cos(angle), "y": distance * math.sin(angle)}
        entry = {"roller_angle_deg": 0.0, "heading_deg": at + 90.0} | entry | place
    return Wheel(
        str(entry.get("name", number)),
        float(entry["x"]),
        float(entry["y"]),
        math.radians(float(entry["roller_angle_deg"])),
        math.radians(float(entry.get("heading_deg", 0.0))),
    )


def _number(value: object, place: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ModelFileError(f"{place}: {value!r} is not a finite number; correct or remove it")
    return float(value)


def _mapping(value: object, place: str) -> dict:
    if not isinstance(value, dict):
        raise ModelFileError(f"{place}: expected 'name: value' entries, found {value!r}")
    return value


def _refuse_unknown(data: dict, known: tuple[str, ...], place: str) -> None:
    unknown = [key for key in data if key not in known]
    if unknown:
        raise ModelFileError(f"unknown entry {unknown} {place}; known: {list(known)}")
