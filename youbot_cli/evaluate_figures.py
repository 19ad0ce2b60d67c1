"""Figures and films of a comparison of controllers."""

from __future__ import annotations

import io

import numpy as np

from controllers import make
from controllers.evaluation.claims import PAPER_LIMIT
from controllers.evaluation.motions import REFERENCES, Motion
from controllers.evaluation.results import Results
from controllers.evaluation.run import SETTINGS, drive, make_env
from controllers.evaluation.subjects import IDENTIFIED, INFORMED, NOMINAL, ORACLE, Subject
from controllers.evaluation.tornado import INTERVAL, LEFT_OUT, PERCENT, Cost
from ident.report import look
from youbot_cli.evaluate_tables import named
from youbot_env.simulation import Sensors

EFFECTS = "#2f8f6b"
# In the order of drawing: what comes later lies on top.
COLOURS = {
    ORACLE: look.MEASURED,
    NOMINAL: look.NOMINAL,
    IDENTIFIED: look.IDENTIFIED,
    INFORMED: EFFECTS,
}
WIDE = {ORACLE: 3.2}
DASHES = {"computed_torque": "-", "mpc": (0, (4, 1.5))}
PLANTS = {"analytic": "equations with hidden effects", "rollers": "real rollers (MuJoCo)"}
METRICS = {"position": "rms position error, mm", "velocity": "rms velocity error, mm/s"}
KINDS = {LEFT_OUT: look.NOMINAL, PERCENT: look.IDENTIFIED, INTERVAL: look.MEASURED}
# Films: one turn of the eight at this frequency; every so many periods a frame, px, colours.
FILMED, STRIDE, WIDTH, PALETTE = Motion("eight", 1.0, length=6.28), 10, 440, 64


@look.figure(6.6)
def frequency_figure(canvas, results: Results, reference: str) -> None:
    """Error over frequency: position and velocity down, plants across."""
    plants = [name for name in PLANTS if name in results.of("plant")]
    axes = canvas.subplots(2, len(plants), sharex=True, sharey="row", squeeze=False)
    for row, metric in zip(axes, METRICS, strict=True):
        for axis, plant in zip(row, plants, strict=True):
            _curves(axis, results, metric, plant=plant, reference=reference)
    for axis, plant in zip(axes[0], plants, strict=True):
        axis.set_title(PLANTS[plant])
    for axis, label in zip(axes[:, 0], METRICS.values(), strict=True):
        axis.set_ylabel(label)
    for axis in axes[-1]:
        axis.set_xlabel("frequency of the motion, rad/s")
    _finish(canvas, axes, 0.84)


@look.figure(9.0)
def references_figure(canvas, results: Results) -> None:
    """Position error over frequency: references down, plants across."""
    plants = [name for name in PLANTS if name in results.of("plant")]
    followed = [name for name in REFERENCES if name in results.of("reference")]
    axes = canvas.subplots(len(followed), len(plants), sharex=True, squeeze=False)
    for row, reference in zip(axes, followed, strict=True):
        for axis, plant in zip(row, plants, strict=True):
            which = {"plant": plant, "reference": reference}
            if len(results.robots("position", **which)):
                _curves(axis, results, "position", **which)
            else:
                axis.set_axis_off()
                axis.text(0.5, 0.5, "not run", transform=axis.transAxes, ha="center")
        row[0].set_ylabel(f"{reference}\nposition error, mm")
    for axis, plant in zip(axes[0], plants, strict=True):
        axis.set_title(PLANTS[plant])
    for column in axes.T:
        lowest = [axis for axis in column if axis.axison][-1]
        lowest.set_xlabel("frequency of the motion, rad/s")
        lowest.tick_params(labelbottom=True)
    _finish(canvas, axes, 0.885, 0.1)


def _curves(axis, results: Results, metric: str, **which) -> None:
    from matplotlib.ticker import LogLocator

    for controller in ("kinematic", *DASHES):
        for model, colour in COLOURS.items():
            one = which | {"controller": controller, "model": model}
            points = [
                (w, results.mean(metric, frequency=w, **one))
                for w in results.of("frequency")
                if len(results.robots(metric, frequency=w, **one))
            ]
            if not points:
                continue
            label = named(controller, model)
            style = {"ls": DASHES.get(controller, "-"), "color": colour, "lw": WIDE.get(model, 1.3)}
            if controller == "kinematic":
                style = {"color": look.INK, "lw": 2.2, "marker": "o", "ms": 4}
            x = [w for w, _ in points]
            values, low, high = (1e3 * np.array([f[k] for _, f in points]) for k in range(3))
            axis.plot(x, values, label=label, **style)
            axis.fill_between(x, low, high, color=style["color"], alpha=0.12, lw=0)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.axvline(PAPER_LIMIT, color=look.INK, lw=0.9, ls=":")
    ticks = results.of("frequency")
    axis.set_xticks(ticks, [f"{w:g}" for w in ticks])
    axis.minorticks_off()
    axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.yaxis.set_major_formatter("{x:g}")


def _finish(canvas, axes, top: float, between: float = 0.06) -> None:
    """One legend, by column one controller; room for it; the limit of the paper named."""
    handles, labels = axes[0][0].get_legend_handles_labels()
    canvas.legend(handles, labels, loc="upper left", ncols=3, columnspacing=1.8)
    axes[0][0].annotate(
        "0.5 rad/s (paper)", (PAPER_LIMIT, 0.93), xycoords=("data", "axes fraction"),
        xytext=(4, 0), textcoords="offset points", fontsize=8.5,
    )  # fmt: skip
    canvas.subplots_adjust(
        top=top, left=0.09, right=0.985, bottom=0.08, hspace=0.12, wspace=between
    )


@look.figure(6.2)
def tornado_figure(canvas, costs: list[Cost]) -> None:
    """What each wrong parameter or missing effect adds to the error, the dearest on top."""
    dearest: dict[str, float] = {}
    for cost in costs:
        name = cost.name.partition(".")[0] if "." in cost.name else cost.name
        dearest.setdefault(name, cost.added.value)
    names = list(dearest)[::-1]
    axis = canvas.subplots()
    height = 0.8 / len(KINDS)
    for shift, (kind, colour) in enumerate(KINDS.items()):
        rows = [c for c in costs if c.kind == kind]
        at = [names.index(c.name.partition(".")[0]) + (1 - shift) * height for c in rows]
        values = 1e3 * np.array([c.added.value for c in rows])
        ends = 1e3 * np.array([[c.added.low, c.added.high] for c in rows]).T
        error = np.abs(np.where(np.isfinite(ends), ends, values) - values)
        label = {LEFT_OUT: "left out", PERCENT: "20 % off", INTERVAL: "off by its 95 % half width"}
        axis.barh(at, values, 0.9 * height, color=colour, label=label[kind], xerr=error,
                  error_kw={"lw": 0.9, "ecolor": look.INK})  # fmt: skip
        for y, value, end in zip(at, values, values + error[1], strict=True):
            axis.annotate(f"{value:.2g}", (max(value, end), y), (4, 0), va="center", fontsize=8,
                          textcoords="offset points")  # fmt: skip
    axis.set_yticks(range(len(names)), [look.SYMBOLS.get(n, n.replace("_", " ")) for n in names])
    axis.set_xlabel("added rms error of the wheels' places, mm")
    axis.grid(axis="y", visible=False)
    handles, labels = axis.get_legend_handles_labels()
    look.legend(canvas, handles, labels)
    canvas.subplots_adjust(top=0.92, left=0.2, right=0.97, bottom=0.09)


def film(subject: Subject, rivals: tuple[tuple[str, str], ...]) -> bytes:
    """GIF of one turn of the eight, controllers with their models side by side."""
    from PIL import Image, ImageDraw

    columns = [_frames(subject, controller, model) for controller, model in rivals]
    pictures = [Image.fromarray(np.hstack(pair)) for pair in zip(*columns, strict=True)]
    for picture in pictures:
        for number, (controller, model) in enumerate(rivals):
            words = named(controller, model)
            place = (60 + number * picture.width // len(rivals), 24)
            ImageDraw.Draw(picture).text(place, words, look.INK, font_size=20)
    height = round(WIDTH * pictures[0].height * len(rivals) / pictures[0].width)
    small = [p.resize((WIDTH * len(rivals), height), Image.Resampling.LANCZOS) for p in pictures]
    palette = small[0].quantize(PALETTE)
    flat = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in small]
    stream, pause = io.BytesIO(), 10 * STRIDE
    flat[0].save(stream, "GIF", save_all=True, append_images=flat[1:], duration=pause, loop=0)
    return stream.getvalue()


def _frames(subject: Subject, controller: str, model: str) -> list[np.ndarray]:
    driver = make(controller, subject.model(model), **SETTINGS.get(controller, {}))
    env = make_env(subject, driver, Sensors(), render_mode="rgb_array")
    frames, count = [], 0

    def watch(env) -> None:
        nonlocal count
        if count % STRIDE == 0:
            frames.append(env.render())
        count += 1

    drive(driver, env, FILMED, subject.seed, watch)
    env.close()
    return frames
