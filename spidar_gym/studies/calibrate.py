"""Fit of a calibrated world to the published figures: mixtures of causes, their levers, profiles, a prediction.

A mixture explains the errors by its own causes. Each error of the flight has a lever, the effect that mostly causes it
in this mixture. The errors are nearly proportional to their levers, so a step of the fit divides each lever by the
ratio of the median error to the published one. Everything else is derived or chosen, and stated with its source.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.benchmark.resume import finish
from spidar_gym.errors import SpidarError
from spidar_gym.files import write_text
from spidar_gym.paper.calibration import FLIGHT, FLIGHT_NUMBERS, Run, play
from spidar_gym.sim.randomize import Randomization
from spidar_gym.sim.worlds import FOLDER, PINS, read_world, world_names
from spidar_gym.studies.reality import EXPERIMENTS, RMSE, summary

MIXTURES = {
    "wake": "the air: eddies of the rotors' own wake push and turn the robot",
    "capture": "the motion capture: its frame drifts; the modules' thrust is unsteady, and eddies are weaker",
    "build": "the build: unequal modules, vectoring zeros and masses; eddies with a mean are weaker",
}
"""Mixtures of causes."""
VARIANTS = {
    "described": "joint servos with the damping of the description",
    "damped": "joint servos with 0.55 … 1.4 Nm s/rad of damping in all, and dry friction of 0 … 0.5 Nm",
}
"""Variants of the hardware; no figure pins them, so both are equally frequent."""
X_Y, Z, ROLL_PITCH, YAW = (RMSE[0], RMSE[1]), (RMSE[2],), (RMSE[3], RMSE[4]), (RMSE[5],)
FLOW_XY, FLOW_Z, DRIFT = "recirculation.flow_xy", "recirculation.flow_z", "sensors.rotation_drift"
TURN_XY, TURN_Z = "recirculation.turn_xy", "recirculation.turn_z"
LEVERS: dict[str, dict[str, tuple[str, ...]]] = {
    "wake": {FLOW_XY: X_Y, FLOW_Z: Z, TURN_XY: ROLL_PITCH, TURN_Z: YAW},
    "capture": {DRIFT: X_Y, FLOW_Z: Z, TURN_XY: ROLL_PITCH, TURN_Z: YAW},
    "build": {FLOW_XY: X_Y, FLOW_Z: Z, TURN_XY: ROLL_PITCH, TURN_Z: YAW},
}
"""Mixture → lever → errors whose geometric mean it fits."""
FREE = (FLOW_XY, FLOW_Z, DRIFT, TURN_XY, TURN_Z)
"""All levers."""
START: dict[str, dict[str, float]] = {
    "wake": {FLOW_XY: 0.018, FLOW_Z: 0.040, TURN_XY: 0.050, TURN_Z: 0.017, DRIFT: 0.002},
    "capture": {FLOW_XY: 0.010, FLOW_Z: 0.039, TURN_XY: 0.033, TURN_Z: 0.016, DRIFT: 0.014},
    "build": {FLOW_XY: 0.015, FLOW_Z: 0.037, TURN_XY: 0.040, TURN_Z: 0.0125, DRIFT: 0.002},
}
"""Centres of the ranges before the fit; those that are no levers of their mixture stay."""
SPREAD = 0.15
"""Half of a fitted range over its centre [chosen]: the published errors are those of one robot."""
ROBOTS, ROUNDS, CLOSE = 96, 6, 0.03
"""Robots per mixture and round of the fit; largest number of rounds; deviation of every median that ends the fit."""
FIRST_SEED = 10**6
"""Seed of the first robot of a fit; the study of the result has robots of other seeds."""
PROFILES: dict[str, tuple[float, ...]] = {
    "recirculation.flow_seconds": (0.25, 0.5, 1.0, 2.0, 4.0),
    "recirculation.turn_seconds": (0.12, 0.25, 0.5, 1.0, 2.0),
    "aero.stacking_loss": (0.0, 0.03, 0.06, 0.12),
}
"""Parameter → centres at which the levers of the mixture `wake` are fitted anew."""
PROFILED = "wake"
"""Mixture of the profiles."""

Range = tuple[float, float]


@dataclass(frozen=True)
class Part:
    """A row of the world's file."""

    field: str
    """Field of `PlantConfig`."""
    origin: str
    """Origin of the ranges."""
    source: str
    """Source of the ranges."""
    ranges: Mapping[str, Range]
    """Range by mixture, by variant, or of `all`."""
    is_log: bool = False
    """Whether the logarithm is uniform."""
    of_crawl: bool = False
    """Whether the range is chosen for the figures of the crawl."""


def _all(low: float, high: float) -> dict[str, Range]:
    return {"all": (low, high)}


def _of(half: float, *, build: float, middle: float = 0.0) -> dict[str, Range]:
    """Return ranges about a middle that are wider in the mixture `build`."""
    halves = {"wake": half, "capture": half, "build": build}
    return {name: (middle - own, middle + own) for name, own in halves.items()}


def _near(**centres: float) -> dict[str, Range]:
    return {name: (0.7 * centre, 1.3 * centre) for name, centre in centres.items()}


CHOSEN: tuple[Part, ...] = (
    Part("body.total_mass", "derived", "thrust of 20 N a module: 16.3 kg; ± 0.3 kg chosen", _all(16.0, 16.6)),
    Part("actuators.delay", "chosen", "0 … 40 ms are usual", _all(0.02, 0.04)),
    Part("actuators.thrust_lag", "chosen", "ducted fans of this size: 10 … 60 ms", _all(0.03, 0.06)),
    Part("actuators.jitter", "chosen", "a network without real time", _all(0.0, 0.01)),
    Part("actuators.loss", "chosen", "a network without real time", _all(0.0, 0.02)),
    Part("actuators.vectoring_backlash", "chosen", "play of a small servo", _all(0.0, 0.005)),
    Part("actuators.vectoring_friction", "chosen", "a small share of the servo's torque", _all(0.0, 0.05)),
    Part("actuators.joint_kd", "chosen", "no figure pins it; the description has 8",
         {"described": (8.0, 8.0), "damped": (0.55, 1.4)}, is_log=True),
    Part("actuators.joint_damping", "chosen", "no figure pins it; the description has 0.9",
         {"described": (0.9, 0.9), "damped": (0.0, 0.0)}),
    Part("actuators.joint_friction", "chosen", "no figure pins it", {"described": (0.0, 0.0), "damped": (0.0, 0.5)}),
    Part("actuators.servo_speed", "chosen", "unequal, but no form is reached too late by more than the grace of 0.5 s",
         _all(0.94, 1.0)),
    Part("actuators.joint_offset", "chosen", "zeros of the encoders", _of(0.01, build=0.02)),
    Part("actuators.module_gain", "chosen", "unequal modules", _of(0.01, build=0.06, middle=1.0)),
    Part("actuators.duct_imbalance", "chosen", "unequal ducts", _of(0.01, build=0.05)),
    Part("actuators.thrust_tilt", "chosen", "ducts that are not quite straight", _of(0.005, build=0.025)),
    Part("actuators.vectoring_offset", "chosen", "zeros of the vectoring servos", _of(0.002, build=0.01)),
    Part("body.link_mass", "chosen", "cables and screws", _of(0.01, build=0.06, middle=1.0)),
    Part("actuators.thrust_noise", "chosen", "unsteady inflow", _near(wake=0.1, capture=1.8, build=0.1)),
    Part("aero.stacking_loss", "chosen", "λ₁ grows in form 3; the jets explain a tenth of it",
         _near(wake=0.03, capture=0.05, build=0.04)),
    Part("recirculation.mean_flow", "chosen", "a mean of the eddies", _of(0.002, build=0.008)),
    Part("recirculation.flow_seconds", "chosen", "not pinned: see profiles", _near(wake=0.7, capture=0.5, build=0.7)),
    Part("recirculation.turn_seconds", "chosen", "not pinned: see profiles", _near(wake=0.5, capture=0.5, build=0.5)),
    Part("recirculation.near", "chosen", "eddies grow near the floor", _all(0.0, 1.0)),
    Part("body.peg_friction", "chosen", "plastic on a smooth floor; the yaw drifts while legs are lifted",
         _all(0.05, 0.25), of_crawl=True),
    Part("ground.slope", "chosen", "the crawl ends 5 mm higher or lower, 0.6 m on", _all(0.0, 0.02), of_crawl=True),
    Part("ground.heading", "chosen", "any direction", _all(-math.pi, math.pi), of_crawl=True),
    Part("sensors.position_drift", "chosen", "1 mm is usual; in capture the crawl's final errors",
         {"wake": (0.001, 0.001), "capture": (0.004, 0.008), "build": (0.001, 0.001)}, of_crawl=True),
)  # fmt: skip
"""Rows that are not fitted."""
FLOOR_STEPS = 0.002
"""Height of a crawl's tiles [m], chosen: the torso tilts by some milliradians while the legs are lifted."""
LIMITS = "fitted to the RMSE of the flight, ± 15 % chosen"
"""Source of a fitted range."""


def world_text(
    centres: Mapping[str, Mapping[str, float]], *, chosen: Sequence[Part] = CHOSEN, floor_steps: float = FLOOR_STEPS
) -> str:
    """Return the file of a world with fitted ranges around the centres, by mixture and field."""
    fields = dict.fromkeys(field for own in centres.values() for field in own)
    fitted = [
        Part(field, "fitted", LIMITS, {
            name: (round((1.0 - SPREAD) * own[field], 6), round((1.0 + SPREAD) * own[field], 6))
            for name, own in centres.items()
        })
        for field in fields
    ]  # fmt: skip
    head = [
        'doc = "Robots that err as the real one: the errors of the paper\'s flight have three mixtures of causes."',
        "sensors = true", "trimmed = false", f"floor_steps = {floor_steps}",
        *_words("mixtures", {name: MIXTURES[name] for name in centres}), *_words("variants", VARIANTS),
    ]  # fmt: skip
    return "\n".join([*head, *(line for part in (*chosen, *fitted) for line in _lines(part, centres))]) + "\n"


def _words(title: str, words: Mapping[str, str]) -> list[str]:
    return ["", f"[{title}]", *(f'{name} = "{doc}"' for name, doc in words.items())]


def _lines(part: Part, mixtures: Mapping[str, Any]) -> list[str]:
    ranges = {name: ends for name, ends in part.ranges.items() if name not in MIXTURES or name in mixtures}
    own = ", ".join(f"{name} = [{low:.6g}, {high:.6g}]" for name, (low, high) in ranges.items())
    return [
        "", "[[row]]", f'field = "{part.field}"', f'origin = "{part.origin}"', f'source = "{part.source}"',
        f"log = {str(part.is_log).lower()}", f"ranges = {{ {own} }}",
    ]  # fmt: skip


def fit(
    name: str, folder: Path, *, robots: int = ROBOTS, workers: int = 1,
    start: Mapping[str, Mapping[str, float]] = START,
    chosen: Sequence[Part] = CHOSEN, floor_steps: float = FLOOR_STEPS, free: Sequence[str] = FREE,
    rounds: int = ROUNDS, on_flight: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Fit the levers of the mixtures to the published errors; resumes from `folder`.

    Args:
        name: Name of the world; `folder` receives its file, NAME.toml.
        folder: Folder for the file and finished flights.
        robots: Number of robots per mixture and round.
        workers: Number of processes.
        start: Centres of the ranges by mixture and field.
        chosen: Rows that are not fitted.
        floor_steps: Height of a crawl's tiles [m].
        free: Levers that are fitted.
        rounds: Largest number of rounds.
        on_flight: Called after each flight.

    Returns:
        One entry per round: the centres, and the `summary` of each mixture with them. The file has the last centres.
    """
    centres = {mixture: dict(own) for mixture, own in start.items()}
    history = list[dict[str, Any]]()
    for _ in range(rounds):
        path = folder / f"{name}.toml"
        write_text(path, world_text(centres, chosen=chosen, floor_steps=floor_steps))
        found = {
            mixture: summary(FLIGHT, figures)
            for mixture, figures in _flights(path, list(centres), robots, workers, folder, on_flight).items()
        }
        history.append({"centres": {mixture: dict(own) for mixture, own in centres.items()}, "found": found})
        off = {mixture: _ratios(mixture, own, free) for mixture, own in found.items()}
        if all(abs(math.log(ratio)) <= CLOSE for own in off.values() for ratio in own.values()):
            break
        for mixture, own in off.items():
            for lever, ratio in own.items():
                centres[mixture][lever] = float(f"{centres[mixture][lever] / ratio:.3g}")
    return history


def _flights(
    path: Path, mixtures: Sequence[str], robots: int, workers: int, folder: Path, on_flight: Callable[[], object]
) -> dict[str, list[dict[str, float]]]:
    """Fly `robots` robots of each mixture of a world, the variants in turn."""
    variants = list(VARIANTS)
    hows = {(m, v): Randomization.parse(f"{path}:{m}-{v}") for m in mixtures for v in variants}
    _, preset = EXPERIMENTS[0]
    runs = [
        Run(FLIGHT, preset, hows[mixture, variants[k % len(variants)]], FIRST_SEED + k)
        for mixture in mixtures
        for k in range(robots)
    ]
    found = finish(play, runs, workers=workers, folder=folder, on_done=lambda *_: on_flight())
    return {mixture: found[k * robots : (k + 1) * robots] for k, mixture in enumerate(mixtures)}


def _ratios(mixture: str, found: Mapping[str, Any], free: Sequence[str]) -> dict[str, float]:
    """Return the ratio of the median errors to the published ones for each lever, their geometric mean."""
    numbers = found["numbers"]
    if any(not math.isfinite(numbers[name]["median"]) for name in RMSE):
        raise SpidarError(f"the robots of the mixture {mixture} fall; valid: smaller effects")
    return {
        lever: math.exp(np.mean([math.log(numbers[name]["median"] / FLIGHT_NUMBERS[name].value) for name in names]))
        for lever, names in LEVERS[mixture].items()
        if lever in free
    }


def write_world(path: Path, name: str) -> Path:
    """Copy the file of a fitted world to the committed ones and pin its hash; return its place.

    Raises:
        SpidarError: Where the name has another content: a world is frozen.
    """
    text, place = path.read_text(encoding="utf-8"), FOLDER / f"{name}.toml"
    if place.exists() and place.read_text(encoding="utf-8") != text:
        raise SpidarError(f"{name} exists with other ranges; valid: a new name, because worlds are frozen")
    write_text(place, text)
    read_world(place)
    lines = [f"{read_world(FOLDER / f'{each}.toml').digest}  {each}.toml\n" for each in world_names()]
    write_text(FOLDER / PINS, "".join(lines))
    return place


def fit_lines(history: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return the table of the last round: levers, and medians of the errors over the published ones."""
    last = history[-1]
    lines = [["mixture", *(name.removeprefix("rmse_") for name in RMSE), "ratio 95 % / 5 %", "fell", "fitted centres"]]
    for mixture, found in last["found"].items():
        numbers = found["numbers"]
        ratios = [numbers[name]["median"] / numbers[name]["published"] for name in RMSE]
        widest = max(numbers[name]["ratio_90"] for name in RMSE)
        levers = ", ".join(
            f"{field.partition('.')[2]} {last['centres'][mixture][field]:g}" for field in LEVERS[mixture]
        )
        lines.append([mixture, *(f"{r:.2f}" for r in ratios), f"{widest:.2f}", str(found["failed"]), levers])
    return lines


def profile_lines(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return the table of the profiles."""
    words = ("within 5 cm", "deviation", "recovery", "thrusts")
    lines = [["parameter", "centre", "flow xy, z", "turn xy, z", "farthest median", "ratio 95 % / 5 %", *words]]
    for row in rows:
        numbers = row["numbers"]
        ratios = [numbers[name]["median"] / numbers[name]["published"] for name in RMSE]
        farthest, widest = max(ratios, key=lambda r: abs(math.log(r))), max(numbers[n]["ratio_90"] for n in RMSE)
        lines.append([
            row["field"], f"{row['value']:g}", f"{row[FLOW_XY]:g}, {row[FLOW_Z]:g}",
            f"{row[TURN_XY]:g}, {row[TURN_Z]:g}", f"{farthest:.2f}", f"{widest:.2f}",
            *(f"{row['words'][name]:.0%}" for name in words),
        ])  # fmt: skip
    return lines


def profile(
    folder: Path, *, robots: int = ROBOTS, workers: int = 1, rounds: int = 3,
    on_flight: Callable[[], object] = lambda: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Fit the levers anew at several values of parameters that trade off with them.

    Returns:
        One row per value: parameter, centre, fitted centres, and the `summary` of the mixture `PROFILED`.
    """
    rows = []
    for field, values in PROFILES.items():
        for value in values:
            chosen = tuple(replace(p, ranges=_near(**{PROFILED: value})) if p.field == field else p for p in CHOSEN)
            history = fit(
                f"profile_{field.partition('.')[2]}_{value:g}".replace(".", "_"), folder, robots=robots,
                workers=workers, start={PROFILED: START[PROFILED]}, chosen=chosen, rounds=rounds, on_flight=on_flight,
            )  # fmt: skip
            last = history[-1]
            rows.append({"field": field, "value": value, **last["centres"][PROFILED], **last["found"][PROFILED]})
    return rows


def blind_parts() -> tuple[Part, ...]:
    """Return the rows that are not fitted, without what was chosen for the crawl."""
    return tuple(part for part in CHOSEN if not part.of_crawl)


def blind_fit(folder: Path, **how: Any) -> list[dict[str, Any]]:  # noqa: ANN401 - of `fit`
    """Fit without the error in z and without the crawl, to predict both; vertical eddies are the horizontal ones."""
    start = {mixture: {**own, FLOW_Z: START["wake"][FLOW_XY]} for mixture, own in START.items()}
    free = (FLOW_XY, DRIFT, TURN_XY, TURN_Z)
    return fit("blind", folder, start=start, chosen=blind_parts(), floor_steps=0.0, free=free, **how)
