"""`scaled`: the least thrust that gives the wrench, then all of it alike scaled into the joints' torque limits.

What a pipeline does whose allocation knows rotors only, and that saturates at its end. As of a daisy chain, what does
not fit is given up; but here direction is kept, and the size goes.
"""

from dataclasses import replace

import numpy as np

from baselines.unlimited import WithoutTorques
from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.control import Allocation, Demand
from spidar_gym.robot import ROBOT


class ScaledThrust(WithoutTorques):
    """s f, f without torque limits and s ≤ 1 the largest with |g − T s f| ≤ τ̄, or that which comes nearest to it."""

    def allocate(
        self, demand: Demand, mode: str, previous_l: np.ndarray, guess: np.ndarray | None = None
    ) -> Allocation:
        """The forces of one tick."""
        found = super().allocate(demand, mode, previous_l, guess)
        s = scale(found.joint_torques, demand.gravity_torque, ROBOT.max_joint_torque)
        if s == 1.0:
            return found
        scaled = self._answer(demand, s * found.forces_l.reshape(-1), found.status, found.iterations, found.slack, 0.0)
        return replace(scaled, solve_time=found.solve_time)


def scale(torque: np.ndarray, gravity_torque: np.ndarray, limit: float) -> float:
    """The largest s in [0, 1] of forces whose torques keep the limit, or keep nearest to it.

    Args:
        torque: g − T f of the whole forces [Nm].
        gravity_torque: g, without any force [Nm].
        limit: τ̄ [Nm].
    """
    slope = torque - gravity_torque
    # Every bound is a line over s: a + b s ≤ 0.
    a, b = np.concatenate((gravity_torque - limit, -gravity_torque - limit)), np.concatenate((slope, -slope))
    if (a + b <= 0.0).all():
        return 1.0
    rising, falling = b > 0.0, b < 0.0
    most = float((-a[rising] / b[rising]).min(initial=1.0))
    least = float((-a[falling] / b[falling]).max(initial=0.0))
    if least <= most:
        return most
    # None keeps all: the largest violation is least where a line that rises meets one that falls.
    meets = (a[falling][None] - a[rising][:, None]) / (b[rising][:, None] - b[falling][None])
    places = np.clip(np.append(meets.reshape(-1), (0.0, 1.0)), 0.0, 1.0)
    return float(places[np.argmin((a[None] + b[None] * places[:, None]).max(axis=1))])


class Scaled(PresetPolicy):
    """The paper's controller, forces of the least thrust scaled until the joints bear them; flights only."""

    presets = {HOVER: {"preset": "paper", "allocator": ScaledThrust}}  # noqa: RUF012
