"""Motions that tell effects apart, each made to show one kind of behaviour.

``python -m ident.diagnosis.menu`` writes them to youbot_env/motions, where ``youbot record
--motion`` and the environments find them.
"""

from __future__ import annotations

import math

from youbot_env.references import MOTIONS, Fourier, Reference, calibration_sequence, save_motion

# Length of an experiment, s.
SECONDS = 60.0


def menu() -> dict[str, Reference]:
    """Motions by name; those other than ``calibration`` are files of that name."""
    return {
        "calibration": calibration_sequence(seconds=SECONDS),
        "slow_ramps": _sines(0.25, "slow ramps through zero",
                             ((1, 0.12, 0.0), (3, 0.03, 1.0)), ((1, 0.12, 2.0), (2, 0.05, 0.4)),
                             ((1, 0.25, 4.0), (3, 0.1, 2.0))),
        "fast_reversals": _sines(1.5, "fast reversals",
                                 ((1, 0.15, 0.0), (2, 0.15, 1.0)), ((1, 0.12, 2.1), (3, 0.12, 0.3)),
                                 ((2, 0.4, 4.0), (3, 0.3, 0.9))),
        "spin": _sines(0.5, "spin on the spot", (), (), ((1, 0.8, 0.0), (3, 0.3, 1.3))),
        "four_headings": _sines(0.1, "straight runs at all headings",
                                ((4, 0.22, 0.0), (10, 0.08, 1.0)),
                                ((5, 0.22, 2.0), (11, 0.08, 0.2)), ((1, 0.45, 0.0),)),
        "chirp": _sines(0.5, "oscillations up to 3 Hz",
                        tuple((n, 0.12 / math.sqrt(n), 1.7 * n) for n in (1, 2, 4, 8, 16, 36)),
                        tuple((n, 0.12 / math.sqrt(n), 2.3 * n) for n in (1, 3, 5, 10, 20, 32)),
                        tuple((n, 0.35 / math.sqrt(n), 0.9 * n) for n in (1, 2, 6, 12, 24))),
        "fast": _sines(0.4, "large speeds",
                       ((1, 0.35, 0.0), (3, 0.15, 1.0)), ((2, 0.3, 2.0), (3, 0.12, 0.1)),
                       ((1, 0.6, 3.0), (4, 0.3, 1.0))),
        "single_wheel": _sines(0.6, "wheels turning alone: forward, sideways and yaw together",
                               ((1, 0.15, 0.0), (2, 0.1, 0.0)), ((1, 0.15, math.pi), (3, 0.1, 0.0)),
                               ((1, 0.39, 0.0), (2, 0.2, math.pi))),
    }  # fmt: skip


def _sines(frequency: float, purpose: str, *axes: tuple[tuple[int, float, float], ...]) -> Fourier:
    """Motion of (harmonic, peak speed, phase) on x, y (m/s) and yaw (rad/s)."""
    count = max(n for sines in axes for n, _, _ in sines)
    amplitudes, phases = [], []
    for sines in axes:
        sizes, starts = [0.0] * count, [0.0] * count
        for n, speed, phase in sines:
            sizes[n - 1] = speed / (n * frequency)
            starts[n - 1] = math.remainder(phase, 2 * math.pi)
        amplitudes.append(tuple(sizes))
        phases.append(tuple(starts))
    speed = sum(speed for sines in axes[:2] for _, speed, _ in sines)
    return Fourier(speed=max(speed, 0.01), frequency=frequency, amplitudes=tuple(amplitudes),
                   phases=tuple(phases), purpose=purpose)  # fmt: skip


if __name__ == "__main__":
    for name, motion in menu().items():
        if isinstance(motion, Fourier):
            save_motion(motion, MOTIONS.folder / f"{name}.yaml")
