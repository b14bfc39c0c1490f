"""Measure an upper bound of what a residual on `tuned` can gain, with exact disturbances instead of its observer.

    python -m train.ceiling

The control laws here read the true state of the simulation, without noise or delay. They cancel, one tick late, every
change of the robot's momentum that weight and rotors do not explain. A network with sensors has less information,
however long its memory.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import tyro

from spidar_gym.arrays import JointVector, Wrench
from spidar_gym.console import progress, run_cli
from spidar_gym.control.flight.compensation import CompensationMemory
from spidar_gym.control.flight.controller import FlightController
from spidar_gym.control.flight.memory import ControlState
from spidar_gym.control.presets import TUNED
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.errors import require_least
from spidar_gym.model.dynamics import Model
from spidar_gym.model.rotor import thrust_map, vectoring_to_force
from spidar_gym.processes import Pool, cpu_count
from spidar_gym.robot import GRAVITY
from spidar_gym.so3 import quat_to_matrix
from spidar_gym.state import Reference, RobotState
from spidar_gym.text import format_table
from train.lib.evaluate import Base, PairedEvaluator, Verdict

TRACKS = ("flight-wind", "flight-randomised")
"""Tracks with disturbances that the controller's feedback does not measure."""
LAG = 0.07
"""Assumed time constant of the rotors in a law that does not read their true thrust [s]."""


@dataclass(frozen=True)
class Args:
    """Measure the gain of control laws with exact knowledge of the disturbances."""

    scenarios: int = 12
    """Number of validation scenarios of each track."""
    workers: int = cpu_count()
    """Number of processes that fly."""

    def __post_init__(self) -> None:
        require_least(1, scenarios=self.scenarios, workers=self.workers)


class Knowing(FlightController):
    """Controller `tuned` whose observer is replaced by the disturbance wrench from the simulation."""

    sees_rotors: bool = True
    """Whether to use the rotors' true wrench; otherwise the commanded wrench with a first-order lag of `LAG`."""
    time: float = 0.0
    """Time constant of a low-pass on the wrench [s]; 0 is off."""

    def reset(self, state: RobotState, joint_position: JointVector | None = None, trim: Wrench | None = None) -> None:
        """Reset the memory; the integrals start at 0, without the trim, as the disturbance is known."""
        super().reset(state, joint_position)
        self._truth = Model()
        self._momentum: np.ndarray | None = None
        self._given_w, self.pull_w = np.zeros(6), np.zeros(6)

    def compensate(
        self, state: RobotState, reference: Reference, control_state: ControlState, joints: JointVector
    ) -> tuple[CompensationMemory, Wrench]:
        """Compute the compensation of `tuned` minus the disturbance wrench."""
        memory, more = super().compensate(state, reference, control_state, joints)
        # `preview` is a method of the environment, which has the true state.
        env = getattr(self.preview, "__self__", None)
        assert isinstance(env, HoverEnv)
        self._look(env.state, control_state)
        R_wb = control_state.R_wb
        return memory, more - np.concatenate((self.pull_w[:3] @ R_wb, self.pull_w[3:] @ R_wb))

    def _look(self, true: RobotState, control_state: ControlState) -> None:
        """Update `pull_w`: the change of momentum in the last tick beyond weight and rotors, world axes [N, Nm]."""
        R, dt = quat_to_matrix(true.quat_wb), self.dt
        snapshot = self._truth.snapshot(true.joint_position, R, true.vectoring)
        legs = snapshot.momentum_map @ true.joint_velocity
        momentum = np.concatenate((
            snapshot.mass * true.velocity_w
            + R @ (snapshot.mass * np.cross(true.omega_b, snapshot.com_b) + legs[:3]),
            R @ (snapshot.inertia_c @ true.omega_b + legs[3:]),
        ))  # fmt: skip
        if self.sees_rotors:
            forces = vectoring_to_force(true.thrust, true.vectoring).reshape(-1)
            now = thrust_map(snapshot.R_bl, snapshot.rotor_c) @ forces
            now = np.concatenate((R @ now[:3], R @ now[3:]))
            given = 0.5 * (now + self._given_w)
        else:
            asked = np.zeros(6) if self.last_step is None else self.last_step.allocation.wrench
            asked = np.concatenate((control_state.R_wb @ asked[:3], control_state.R_wb @ asked[3:]))
            if self._momentum is None:
                asked[2] = snapshot.mass * GRAVITY
                self._given_w = asked
            now = given = self._given_w + (1.0 - np.exp(-dt / LAG)) * (asked - self._given_w)
        if self._momentum is not None:
            pull = (momentum - self._momentum) / dt - given
            pull[2] += snapshot.mass * GRAVITY
            share = 1.0 - np.exp(-dt / self.time) if self.time > 0.0 else 1.0
            self.pull_w = self.pull_w + share * (pull - self.pull_w)
        self._momentum, self._given_w = momentum, now


class Described(Knowing):
    """Law that also cancels model errors such as weak rotors, with a low-pass that is stable for randomised robots."""

    sees_rotors = False
    time = 0.1


LAWS: dict[str, type[Knowing]] = {
    "knows what pulls, a tick late": Knowing,
    "knows all that is not described, 0.1 s": Described,
}
"""Control laws by their heading in the table."""


def measure(args: Args, on_scenario: Callable[[], object] = lambda: None) -> dict[str, Verdict]:
    """Compare each law with `tuned` on the validation scenarios: law → verdict."""
    config = replace(TUNED, compensation=replace(TUNED.compensation, observer_gain=0.0))
    with Pool(args.workers) as pool:
        evaluator = PairedEvaluator(
            TRACKS, Base({"preset": "tuned"}), args.scenarios, control="core", on_scenario=on_scenario, each=pool.map
        )  # fmt: skip
        return {
            name: evaluator.evaluate(Base({"controller": config, "law": law}), on_scenario)
            for name, law in LAWS.items()
        }


def ceiling_lines(verdicts: dict[str, Verdict]) -> list[list[str]]:
    """Return a table row for each law: changes of position and attitude errors on each track."""
    lines = [["against tuned", *(f"{track}, position / attitude" for track in TRACKS), "success"]]
    for name, verdict in verdicts.items():
        cells = [" / ".join(f"{100.0 * value:+.0f} %" for value in cell.values()) for cell in verdict.cells.values()]
        lines.append([name, *cells, f"{verdict.success:+.0%}" if verdict.success else ""])
    return lines


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.ceiling")
    total = (1 + len(LAWS)) * len(TRACKS) * args.scenarios
    with progress(total=total, unit="scenario", desc="ceiling") as bar:
        verdicts = measure(args, bar.update)
    print(format_table(ceiling_lines(verdicts)))


if __name__ == "__main__":
    run_cli("train.ceiling", main)
