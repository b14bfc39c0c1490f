"""Margins with legs that bend: of presets and rivals over calibrated robots, and the model's falls in the simulator."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.errors import SpidarError
from spidar_gym.margins import arguments_of, flight_law, flight_mode, law_of, leg_margins, robots_of, with_damping
from spidar_gym.native.linear import Loop, linear_law, linear_robot, modelled, settle
from spidar_gym.native.plant import Plant
from spidar_gym.robot import FORMS, N_ROTORS
from spidar_gym.sim.config import PlantConfig
from spidar_gym.so3 import quat_to_matrix

CONTROLLERS = (
    "as_flown", "paper", "tuned_v1", "tuned", "retuned", "steady", "baselines.adrc:Adrc", "baselines.indi:Indi",
    "baselines.compensation:Compensation", "baselines.mpc:MPC", "baselines.steady_rivals:AdrcSteady",
    "baselines.steady_rivals:IndiSteady", "baselines.steady_rivals:CompensationSteady",
    "baselines.steady_rivals:MPCSteady",
)  # fmt: skip
"""Presets, and rivals that have a flight controller."""
CHECKED = ("as_flown", "paper", "tuned_v1", "tuned", "retuned", "baselines.adrc:Adrc")
"""Controllers whose falls are compared with the simulator's."""
CONDITIONS = ((8.9, 0.03), (1.4, 0.03), (0.8, 0.05), (0.55, 0.03))
"""Damping of the joints [Nm s/rad] and delay of the commands [s] of the cases; the thrust lags by `LAG`."""
LAG = 0.04
"""Lag of the thrust [s]."""
SECONDS, END = 40.0, 2.0
"""Duration of a flight, and of its end, where it still swings or not [s]."""
KICK = 2.0 * np.array([1.0, 0.6, -0.3, -0.2, -1.0, -0.5, 0.4, 0.1])
"""Thrusts that are added in the first three ticks [N]."""
TILT, AWAY = 0.5, 1.0
"""Tilt [rad] and distance [m] at which a robot has fallen."""
STILL = 1e-3
"""Angular velocity below which the end of a flight is still [rad/s]."""
NEAR = 1.03
"""Ratio of the two gains between which a fall is bracketed."""


@dataclass(frozen=True)
class Case:
    """A controller in a form, on a robot."""

    controller: str
    """Preset, or `module:Class`."""
    form: str
    """Name of the form."""
    damping: float
    """Damping of all joints [Nm s/rad]."""
    delay: float
    """Delay of the commands [s]."""


@dataclass(frozen=True)
class Asked:
    """A controller, and the robots over which its margins are sought."""

    controller: str
    """Preset, or `module:Class`."""
    world: str
    """Calibrated world."""
    robots: int
    """Number of its robots."""


def find_margins(asked: Asked) -> dict[str, Any]:
    """Compute the worst margins of a controller."""
    arguments = arguments_of(asked.controller)
    margins = leg_margins(flight_law(arguments), robots_of(asked.world, asked.robots), mode=flight_mode(arguments))
    found = asdict(margins)
    found["damping"] = found["damping"] if math.isfinite(found["damping"]) else None
    return {"controller": asked.controller, **found}


def margin_study(
    controllers: Sequence[str], world: str, robots: int, *, workers: int = 1, folder: Path | None = None,
    on_done: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Compute the worst margins of controllers; resumes from `folder`."""
    for name in controllers:
        arguments_of(name)  # raises for an unknown one
    items = [Asked(name, world, robots) for name in controllers]
    return finish(find_margins, items, workers=workers, folder=folder, on_done=lambda *_: on_done())


# ---- the model's falls in the simulator ----


def cases() -> list[Case]:
    """Return all cases of the comparison."""
    return [Case(name, form, *own) for name in CHECKED for form in FORMS for own in CONDITIONS]


def check_study(
    *, workers: int = 1, folder: Path | None = None, on_done: Callable[[], object] = lambda: None
) -> list[dict[str, Any]]:
    """Compare the linear model with the simulator in all cases; resumes from `folder`."""
    return finish(compare, cases(), workers=workers, folder=folder, on_done=lambda *_: on_done())


def compare(case: Case) -> dict[str, Any]:
    """Find the gain at which the model has a growing mode, and those at which the simulated robot swings and falls.

    Without sensors, air and dry friction, and with the controller and the robot that fly everywhere else.
    """
    config = with_damping(PlantConfig(), case.damping)
    config = modelled(replace(config, actuators=replace(config.actuators, delay=case.delay, thrust_lag=LAG)))
    controller = law_of(case.controller)
    hover = settle(controller, FORMS[case.form], config)
    loop = Loop(linear_robot(hover, config), linear_law(hover))
    gain, frequency = loop.gain_margin(rings=True)
    memory, step = controller.memory, controller.last_step

    def fly(factor: float) -> tuple[bool, bool]:
        controller.memory, controller.last_step = memory, step
        plant = Plant(config)
        start = hover.state
        plant.reset(start.position_w, start.quat_wb, start.joint_position, start.vectoring, start.thrust)
        plant.data.qpos[:], plant.data.act[:], plant.data.ctrl[:] = hover.qpos, hover.act, hover.act
        state, rest, fastest = plant.state(), np.zeros(0), 0.0
        for k in range(ticks := round(SECONDS / plant.period)):
            command = controller.step(state, hover.reference)
            asked = np.concatenate((command.thrust, command.vectoring.reshape(-1)))
            rest = asked if k == 0 else rest
            asked = rest + factor * (asked - rest)
            asked[:N_ROTORS] += KICK if k < 3 else 0.0
            thrust = np.clip(asked[:N_ROTORS], 0.0, config.robot.max_thrust)
            state = plant.step(replace(command, thrust=thrust, vectoring=asked[N_ROTORS:].reshape(N_ROTORS, 2)))
            tilt = math.acos(min(1.0, float(quat_to_matrix(state.quat_wb)[2, 2])))
            if not (tilt < TILT and float(np.linalg.norm(state.position_w - start.position_w)) < AWAY):
                plant.close()
                return True, True
            if k >= ticks - round(END / plant.period):
                fastest = max(fastest, float(np.abs(state.omega_b).max()))
        plant.close()
        return False, fastest > STILL

    falls = _first(lambda factor: fly(factor)[0], gain)
    swings = _first(lambda factor: fly(factor)[1], gain)
    return {**asdict(case), "model": gain, "frequency": frequency, "swings": swings, "falls": falls}


def _first(happens: Callable[[float], bool], near: float) -> float | None:
    """Return the gain from which on something happens, within 0.7 … 1.5 of one; None if it does not, 0 if always."""
    low, high = 0.7 * near, 1.5 * near
    if happens(low):
        return 0.0
    if not happens(high):
        return None
    while high > NEAR * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if happens(middle) else (middle, high)
    return math.sqrt(low * high)


def check_lines(rows: Iterable[Mapping[str, Any]]) -> list[list[str]]:
    """Return the table of the comparison."""
    lines = [
        ["controller", "form", "damping", "delay", "model: grows from", "at", "swings from", "falls from", "ratio"]
    ]
    for row in rows:
        gain, falls = row["model"], row["falls"]
        words = {None: f"not below {1.5 * gain:.2f}", 0.0: f"below {0.7 * gain:.2f}"}
        seen = [words[row[name]] if not row[name] else f"{row[name]:.2f}" for name in ("swings", "falls")]
        mode = "–" if row["frequency"] < 0.0 else f"{row['frequency']:.0f} rad/s"
        lines.append([
            row["controller"], row["form"], f"{row['damping']:g}", f"{1e3 * row['delay']:.0f} ms", f"{gain:.2f}", mode,
            *seen, f"{falls / gain:.2f}" if falls else "–",
        ])  # fmt: skip
    return lines


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the number of falls that the model foretells within 10 %, in words."""
    fell = [row["falls"] / row["model"] for row in rows if row["falls"]]
    swung = [row["swings"] / row["model"] for row in rows if row["swings"]]
    if not fell or not swung:
        raise SpidarError("nothing swung or fell; valid: the committed cases")
    near = sum(abs(ratio - 1.0) <= 0.1 for ratio in fell)
    onset = sum(abs(ratio - 1.0) <= 0.1 for ratio in swung)
    return (
        f"{near} of {len(fell)} falls and {onset} of {len(swung)} onsets of a lasting swing are within 10 % of the "
        f"model's gain; {len(rows) - len(fell)} of {len(rows)} cases do not fall up to 1.5 times that gain"
    )
