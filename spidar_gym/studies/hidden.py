"""Hidden robots: how well the logs of two tests tell the parameters of robots that the identification does not know.

Robots are sampled from a calibrated world with a seed from the operating system. Each is put on the stand and flown
through the tests; its parameters are sealed by a hash. The identification runs in a process that is given the logs and
the reading of a scale. When the reports of all robots are hashed, the parameters are opened and compared.
"""

import hashlib
import json
import math
import secrets
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from spidar_gym.border import BorderError, parse_json, read_file, require_form
from spidar_gym.errors import SpidarError
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.logs.mcap import write_mcap
from spidar_gym.logs.open import read_log
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.randomize import Randomization, randomize
from spidar_gym.sim.scene import TIMESTEP
from spidar_gym.sitl.missions import robot_test
from spidar_gym.sitl.play import play

WORLD = "calibrated_1"
"""World of the robots."""
LISTED = {
    "bench": ("delay", "damping", "friction", "stiffness", "speed"),
    "thrust": ("gain_over_mass", "mean_gain_over_mass", "lag", "mean_lag"),
}
"""Tests that are flown, and the parameters that each is to tell."""
SCALE = 0.02
"""Standard deviation of the scale [kg]."""
WANTED = {"damping": 0.3, "delay": 0.003, "lag": 0.005, "mean_lag": 0.005, "mean_gain_over_mass": 0.02}
"""Largest wanted errors: of damping and mean gain over mass relative, of delay and lags [s]."""
RELATIVE = ("damping", "stiffness", "speed", "gain_over_mass", "mean_gain_over_mass")
"""Parameters whose errors are relative."""
ROW = {
    "robot": int, "kind": str, "seed": int, "parameter": str, "count": int, "told": int, "within": int,
    "worst_error": float, "rms_error": float, "mean_width": float,
}  # fmt: skip
"""Form of a row of the result."""
MOST_BYTES = 2**24


def sample(folder: Path, robots: int, world: str = WORLD, again: Path | None = None) -> None:
    """Sample the robots and seal their parameters, unless the folder has them already.

    Args:
        folder: Folder of the study.
        robots: Number of robots, kinds of the world in turn.
        world: Calibrated world.
        again: File of a former result, whose first robots are sampled once more; they are no longer hidden.
    """
    sealed = folder / "sealed" / "robots.json"
    if sealed.exists():
        if (have := len(sealed_robots(folder))) != robots:
            raise SpidarError(f"{folder} has {have} robots; valid: --robots {have}, or a new folder")
        return
    output_folder(sealed.parent)
    seeds = [secrets.randbits(62) for _ in range(robots)] if again is None else _former(again)[:robots]
    if len(seeds) < robots:
        raise SpidarError(f"{again} has {len(seeds)} robots; valid: --robots 1 … {len(seeds)}")
    rows = [{"seed": seed, "robots": Randomization.parse(world).in_turn(k).name} for k, seed in enumerate(seeds)]
    write_text(sealed, json_text({"robots": rows}))
    write_text(folder / "sealed.sha256", hashlib.sha256(sealed.read_bytes()).hexdigest())


def fly(folder: Path, k: int) -> None:
    """Fly the tests with a robot, unless its logs exist; the logs are converted to MCAP."""
    row = sealed_robots(folder)[k]
    own, how = output_folder(folder / "logs" / f"{k:02}"), Randomization.parse(row["robots"])
    for name in LISTED:
        target = own / f"{name}.mcap"
        if not target.exists():
            raw = own / f"{name}.log"
            played = play(robot_test(name), seed=row["seed"], robots=how, log=raw)
            if played.run.board:
                raise SpidarError(f"robot {k}: the test {name} ended with a forced landing: {played.run.board}")
            write_mcap(read_log(raw), target)
            raw.unlink()
    config = robot_of(row)
    reading = config.body.total_mass + SCALE * np.random.Generator(np.random.PCG64([row["seed"], 1])).standard_normal()
    write_text(own / "scale.txt", f"{reading:.3f}")


def report(folder: Path, k: int, threads: int) -> None:
    """Identify a robot from its logs in another process, unless its report exists."""
    own, target = folder / "logs" / f"{k:02}", folder / "reports" / f"{k:02}"
    if (target / "report.json").exists():
        return
    mass = (own / "scale.txt").read_text(encoding="utf-8").strip()
    logs = [f"{name}.mcap" for name in LISTED]
    command = [sys.executable, "-c", "from spidar_gym.cli.main import main; main()", "identify", *logs, "--mass", mass]
    command += [
        "--mass-deviation",
        f"{SCALE}",
        "--threads",
        f"{threads}",
        "--out",
        str((target / "robot.toml").resolve()),
    ]
    done = subprocess.run(command, cwd=own, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SpidarError(f"robot {k}: {done.stderr.strip().splitlines()[-1]}")


def score(folder: Path) -> list[dict[str, Any]]:
    """Hash all reports, then open the parameters and compare: a row for each robot and listed parameter."""
    count = len(list((folder / "reports").glob("[0-9][0-9]/report.json")))
    paths = [folder / "reports" / f"{k:02}" / "report.json" for k in range(count)]
    write_text(
        folder / "reports.sha256",
        "".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.parent.name}/{path.name}\n" for path in paths),
    )
    rows = sealed_robots(folder)
    if len(rows) != count:
        raise SpidarError(f"{count} reports of {len(rows)} robots; valid: all, by the same command")
    found = []
    for k, (row, path) in enumerate(zip(rows, paths, strict=True)):
        content = parse_json(read_file(path, MOST_BYTES))
        truth = truth_of(robot_of(row))
        for listed in LISTED.values():
            for name in listed:
                lines = [line for line in content["parameters"] if line["parameter"] == name]
                own = {"robot": k, "kind": row["robots"].partition(":")[2], "seed": row["seed"], "parameter": name}
                found.append(own | _compared(name, lines, truth[name]))
    return found


def _former(path: Path) -> list[int]:
    """Return the seeds of the robots of a former result (`BorderError` for another file)."""
    try:
        content = parse_json(read_file(path, MOST_BYTES))
        require_form(content, {"hidden": [ROW]}, "it")
    except BorderError as error:
        raise SpidarError(f"{path} is no result of the study hidden: {error}; valid: its hidden.json") from error
    return list({row["robot"]: row["seed"] for row in content["hidden"]}.values())


def sealed_robots(folder: Path) -> list[dict[str, Any]]:
    """Read the sealed robots; their hash is checked."""
    path = folder / "sealed" / "robots.json"
    try:
        data, pin = read_file(path, MOST_BYTES), read_file(folder / "sealed.sha256", MOST_BYTES).decode().strip()
    except (BorderError, UnicodeDecodeError) as error:
        raise SpidarError(f"{folder} has no sealed robots: {error}; valid: a folder of the study hidden") from error
    if hashlib.sha256(data).hexdigest() != pin:
        raise SpidarError(f"{path} is not what was sealed; valid: a new folder")
    return json.loads(data)["robots"]


def robot_of(row: dict[str, Any]) -> PlantConfig:
    """Return a sealed robot, as `sitl.play.make_robot` samples it."""
    rng = np.random.Generator(np.random.PCG64(row["seed"]))
    return randomize(PlantConfig(), rng, Randomization.parse(row["robots"]))[0]


def truth_of(config: PlantConfig) -> dict[str, np.ndarray]:
    """Return the listed parameters of a robot."""
    a = config.actuators
    # Delays are rounded to physics steps; the mean of the rounded jitter is that of an engine's samples.
    jitter = np.rint(np.linspace(0.0, a.jitter, 10_001) / TIMESTEP).mean() * TIMESTEP
    gain = a.thrust_gain * a.module_gain / config.body.total_mass
    return {
        "delay": np.array([TIMESTEP * round(a.delay / TIMESTEP) + jitter]),
        "damping": np.full(16, a.joint_kd + a.joint_damping), "friction": np.full(16, a.joint_friction),
        "stiffness": a.joint_kp * a.servo_stiffness,
        "speed": config.joint_speed * a.joint_speed_factor * a.servo_speed,
        "gain_over_mass": gain, "mean_gain_over_mass": np.array([gain.mean()]), "lag": np.full(8, a.thrust_lag),
        "mean_lag": np.array([a.thrust_lag]),
    }  # fmt: skip


def _compared(name: str, lines: Sequence[dict[str, Any]], truth: np.ndarray) -> dict[str, Any]:
    """Return how the lines of a parameter compare with the truth."""
    told = [line["told"] for line in lines]
    value, low, high = (np.array([line[key] for line in lines], float) for key in ("value", "low", "high"))
    error, width = value - truth, high - low
    if name in RELATIVE:
        error, width = error / truth, width / truth
    return {
        "count": len(lines), "told": sum(told), "within": int(((low <= truth) & (truth <= high)).sum()),
        "worst_error": float(abs(error).max()), "rms_error": float(np.sqrt((error**2).mean())),
        "mean_width": float(width.mean()),
    }  # fmt: skip


def hidden(
    folder: Path, robots: int, *, world: str = WORLD, again: Path | None = None, threads: int = 2,
    on_step: Callable[[str], object] = lambda name: None,
) -> list[dict[str, Any]]:  # fmt: skip
    """Run the study, or resume it; returns a row for each robot and listed parameter.

    Args:
        folder: Folder of the study.
        robots: Number of robots.
        world: Calibrated world.
        again: As for `sample`.
        threads: Threads of an identification.
        on_step: Called after each flight and each report, with what comes next.
    """
    sample(folder, robots, world, again)
    for k in range(robots):
        on_step(f"fly robot {k}")
        fly(folder, k)
    for k in range(robots):
        on_step(f"identify robot {k}")
        report(folder, k, threads)
    return score(folder)


def hidden_lines(rows: Sequence[dict[str, Any]]) -> list[list[str]]:
    """Return the table: for each listed parameter the share within its interval, errors, and the interval's width."""
    lines = [["parameter", "numbers", "told", "within its interval", "RMS error", "worst", "mean width", "wanted"]]
    for name in (name for listed in LISTED.values() for name in listed):
        own = [row for row in rows if row["parameter"] == name]
        count = sum(row["count"] for row in own)
        rms = math.sqrt(sum(row["count"] * row["rms_error"] ** 2 for row in own) / count)
        lines.append([
            name.replace("_", " "), f"{count}", f"{sum(row['told'] for row in own)}",
            f"{sum(row['within'] for row in own) / count:.1%}", _size(name, rms),
            _size(name, max(row["worst_error"] for row in own)),
            _size(name, sum(row["count"] * row["mean_width"] for row in own) / count),
            "≤ " + _size(name, WANTED[name]) if name in WANTED else "–",
        ])  # fmt: skip
    count, within = (sum(row[key] for row in rows) for key in ("count", "within"))
    return [
        *lines,
        ["all", f"{count}", f"{sum(row['told'] for row in rows)}", f"{within / count:.1%}", "", "", "", "≥ 90 %"],
    ]


def _size(name: str, value: float) -> str:
    if name in RELATIVE:
        return f"{value:.1%}"
    return f"{value:.3f} Nm" if name == "friction" else f"{1e3 * value:.1f} ms"
