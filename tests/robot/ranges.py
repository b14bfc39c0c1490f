"""Measures for which lengths, masses and inertias robots are simulated accurately: `python -m tests.robot.ranges`."""

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np
import pinocchio as pin

from spidar_gym import __version__
from spidar_gym.console import run_cli
from spidar_gym.errors import InvalidValueError
from spidar_gym.files import json_text, output_folder, write_text
from spidar_gym.processes import Pool, cpu_count
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.robot.description import mjcf, model_file
from spidar_gym.robot.payload import Payload
from spidar_gym.robot.ranges import INERTIAS, MASSES, PLACES, Range
from spidar_gym.robot.spec import PARTS
from spidar_gym.robot.valid import MECHANICAL
from spidar_gym.text import format_table

COMMAND = "python -m tests.robot.ranges --out docs/results/robot_ranges.json"
HEADING = ["what is changed", "simulated well", "accepted"]
NOTE = (
    "Tried by decades from 10^-20 to 10^20. Well: the mass matrices of MuJoCo and Pinocchio agree to 1e-9 of their "
    "largest entry, and in a fall of a second, spinning, the centre of mass gains the velocity g t to 1e-4 of it and "
    "the angular momentum stays to 1e-3. Rotors are made as strong as a robot needs."
)
SECONDS = 1.0
"""Duration of the fall, spinning and without motors [s]."""
APART, FALL, SPIN = 1e-9, 1e-4, 1e-3
"""Largest relative errors: between the mass matrices of MuJoCo and Pinocchio, over the largest entry; of the velocity
that the centre of mass gains in the fall; and of the angular momentum, which is constant."""
DECADES = 20
"""Decades below and above 1 that are tried."""


@contextmanager
def any_size() -> Iterator[None]:
    """Disable the validation of ranges."""
    with patch.object(Range, "require", lambda *_args, **_options: None):
        yield


def lifted(make: Callable[[float], RobotSpec]) -> RobotSpec:
    """Build a robot with rotors of sufficient thrust; `make` takes the largest thrust of a rotor [N]."""
    with any_size():
        needed = 2.0 * make(1e290).hover_thrust
    return make(max(ROBOT.max_thrust, needed))


def loaded(body: str, **payload: Any) -> RobotSpec:
    """Build a robot with a payload."""
    return lifted(lambda thrust: RobotSpec(max_thrust=thrust, payloads=(Payload(body, **payload),)))


def larger(scale: float) -> RobotSpec:
    """Build a robot with all lengths and positions multiplied by a factor."""
    lengths = [
        f.name for f in fields(RobotSpec) if f.name not in (*MECHANICAL, "described_mass", "part_masses", "payloads")
    ]

    def scaled(value: Any) -> Any:
        return tuple(scale * x for x in value) if isinstance(value, tuple) else scale * value

    own = {name: scaled(getattr(ROBOT, name)) for name in lengths}
    return lifted(lambda thrust: RobotSpec(max_thrust=thrust, **own))


def heavier(mass: float) -> RobotSpec:
    """Build a robot of another described mass, with zero idle thrust and sufficient thrust."""
    return lifted(lambda thrust: RobotSpec(described_mass=mass, max_thrust=thrust, idle_thrust=0.0))


CHANGES: dict[str, tuple[Callable[[float], RobotSpec], Range]] = {
    "place of a part of 35 g [m]": (lambda x: RobotSpec(flight_controller=(x, 0.0, 0.0)), PLACES),
    "place of a payload of 1 kg on the torso [m]": (
        lambda x: loaded("torso", mass=1.0, position=(x, 0.0, 0.0)), PLACES,
    ),
    "place of a payload of 0.2 kg on an outer link [m]": (
        lambda x: loaded("link8", mass=0.2, position=(x, 0.0, 0.0)), PLACES,
    ),
    "all lengths and places, × the nominal": (larger, Range(0.015, 15.0, "×")),
    "described mass [kg]": (heavier, MASSES),
    "mass of a payload on the torso [kg]": (lambda m: loaded("torso", mass=m, position=(0.0, 0.0, 0.1)), MASSES),
    "mass of a payload on an outer link [kg]": (lambda m: loaded("link8", mass=m, position=(0.2, 0.0, 0.0)), MASSES),
    **{
        f"mass of the part {name} [kg]": (
            lambda m, name=name: lifted(lambda thrust: RobotSpec(max_thrust=thrust, part_masses={name: m})), MASSES,
        )
        for name in PARTS
    },
    "principal moments of a payload of 1 kg on the torso [kg m²]": (
        lambda i: loaded("torso", mass=1.0, inertia=(i, i, i, 0.0, 0.0, 0.0)), INERTIAS,
    ),
    "principal moments of a payload of 0.2 kg on an outer link [kg m²]": (
        lambda i: loaded("link8", mass=0.2, inertia=(i, i, i, 0.0, 0.0, 0.0)), INERTIAS,
    ),
}  # fmt: skip
"""Changed quantity → robot as a function of its value, and the accepted range."""


def is_well_simulated(robot: RobotSpec) -> bool:
    """Return whether two engines agree on a robot, and whether it conserves momentum in a fall.

    MuJoCo and Pinocchio compute the mass matrix in twenty poses. Then the robot falls for a second in MuJoCo, at the
    time step of the environments, spinning, with moving joints and without motors and contacts. Its centre of mass must
    accelerate with g, and its angular momentum must stay constant.
    """
    try:
        model = mujoco.MjModel.from_xml_string(mjcf(robot))
    except ValueError:  # MuJoCo's compiler: too small
        return False
    with model_file(robot) as path:
        other = pin.buildModelFromMJCF(str(path))
    return _apart(model, other) <= APART and all(
        drift <= most for drift, most in zip(_drifts(model), (FALL, SPIN), strict=True)
    )


def _apart(model: mujoco.MjModel, other: pin.Model) -> float:
    """Compute the largest difference of the two mass matrices, relative to the largest entry.

    Only the joints' rows are compared: the engines use different axes for the torso's six rows, and the joints' rows
    contain the inertia of all bodies that move with the joints.
    """
    data, work, rng = mujoco.MjData(model), other.createData(), np.random.default_rng(0)
    names = [model.joint(i).name for i in range(1, model.njnt)]
    rows = [int(model.joint(name).dofadr[0]) for name in names]
    columns = [other.idx_vs[other.getJointId(name)] for name in names]
    worst = 0.0
    for _ in range(20):
        q = pin.neutral(other)
        for name in names:
            data.joint(name).qpos = q[other.idx_qs[other.getJointId(name)]] = rng.uniform(-1.5, 1.5)
        mujoco.mj_forward(model, data)
        M = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, M)
        two = pin.crba(other, work, q)
        two = np.triu(two) + np.triu(two, 1).T - np.diag(other.armature)
        one = (M - np.diag(model.dof_armature))[np.ix_(rows, rows)]
        worst = max(worst, float(np.abs(one - two[np.ix_(columns, columns)]).max() / np.abs(one).max()))
    return worst


def _drifts(model: mujoco.MjModel) -> tuple[float, float]:
    """Compute the relative errors of the centre of mass's velocity and of the angular momentum after a fall."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION | mujoco.mjtDisableBit.mjDSBL_CONTACT
    data, torso = mujoco.MjData(model), model.body("torso").id
    data.qpos[2], data.qvel[3:6] = 10.0, (0.5, 0.3, 0.4)
    data.qvel[6:] = np.random.default_rng(0).normal(0.0, 0.1, model.nv - 6)

    def momenta() -> tuple[np.ndarray, np.ndarray]:
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        return data.subtree_linvel[torso].copy(), data.subtree_angmom[torso].copy()

    velocity, momentum = momenta()
    for _ in range(round(SECONDS / model.opt.timestep)):
        mujoco.mj_step(model, data)
    after, left = momenta()
    gained = SECONDS * model.opt.gravity
    with np.errstate(invalid="ignore", over="ignore"):
        return (
            float(np.linalg.norm(after - velocity - gained) / np.linalg.norm(gained)),
            float(np.linalg.norm(left - momentum) / np.linalg.norm(momentum)),
        )


def well(change: str, value: float) -> bool:
    """Return whether the changed robot is valid and simulated accurately."""
    try:
        with any_size():
            return is_well_simulated(CHANGES[change][0](value))
    except InvalidValueError:
        return False


def measure(change: str) -> list[str]:
    """Compute a row of the table: the decades that are simulated accurately, and the accepted range."""
    sys.stderr.flush()
    with open(os.devnull, "w", encoding="utf-8") as nothing:
        os.dup2(nothing.fileno(), 2)  # MuJoCo warns about every robot that it cannot simulate
    least, most = (
        next((k for k in range(0, step * DECADES, step) if not well(change, 10.0 ** (k + step))), step * DECADES)
        for step in (-1, 1)
    )
    accepted = CHANGES[change][1]
    return [change, f"10^{least} … 10^{most}", f"{accepted.least:g} … {accepted.most:g}"]


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(prog="python -m tests.robot.ranges", description=__doc__)
    parser.add_argument("--out", type=Path, help="file for the table, as in docs/results")
    out = parser.parse_args().out
    with Pool(cpu_count()) as pool:
        lines = [HEADING, *pool.map(measure, list(CHANGES))]
    print(format_table(lines))
    if out:
        output_folder(out.parent)
        result = {
            "command": COMMAND,
            "version": __version__,
            "date": date.today().isoformat(),
            "lines": lines,
            "notes": [NOTE],
        }
        write_text(out, json_text(result))


if __name__ == "__main__":
    run_cli("tests.robot.ranges", main)
