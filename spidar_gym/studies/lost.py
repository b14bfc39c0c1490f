"""Loss of a rotor: static feasibility and a simulated flight for each rotor, form and fault."""

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np

from spidar_gym.control.flight.controller import CONTROL_RATE, FlightController
from spidar_gym.control.presets import controller_config
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.policies.rollout import rollout
from spidar_gym.robot import FORMS, N_ROTORS, ROBOT
from spidar_gym.sim.disturbances import FAULTS
from spidar_gym.state import Reference

FAULT_SECONDS = 12.0
"""Length of a flight with a rotor that fails after 2 s [s]."""


def lost_rotors(preset: str = "paper", *, on_flight: Callable[[], object] = lambda: None) -> list[dict[str, Any]]:
    """Fail each rotor in each form, in thrust or in vectoring; compute static feasibility, and simulate a flight.

    The fault is reported to the allocation. A form is feasible if the allocation of a level hover fulfils all
    constraints.
    """
    rows = []
    controller = FlightController(controller_config(preset))
    for fault, form, rotor in product(FAULTS, FORMS, range(1, N_ROTORS + 1)):
        q, mask = FORMS[form], np.arange(1, N_ROTORS + 1) == rotor
        vectoring = controller.rest_vectoring(q)
        reference = Reference(
            np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), np.zeros(3), q, **{f"lost_{fault}": mask}
        )
        weight = np.array([0.0, 0.0, ROBOT.weight, 0.0, 0.0, 0.0])
        demand = controller.demand_at(q, np.eye(3), vectoring, weight, reference)
        static = controller.allocator.allocate(demand, "flight", np.zeros((N_ROTORS, 3)))
        row = {
            "fault": fault,
            "form": form,
            "rotor": rotor,
            "feasible": bool(static.slack < 1e-6),
            "static_torque_nm": float(np.abs(static.joint_torques).max()),
            "static_thrust_n": float(static.thrust.max()),
            **_fly_lost(preset, form, {"lost_rotor": rotor, "fault": fault}),
        }
        rows.append(row)
        on_flight()
    return rows


def _fly_lost(preset: str, form: str, disturbances: dict[str, Any]) -> dict[str, Any]:
    env = HoverEnv(
        forms=form, preset=preset, perturbation=0.0, disturbances=disturbances, horizon_s=FAULT_SECONDS
    )  # fmt: skip
    position, attitude, bounded, flown = 0.0, 0.0, True, 0
    info: dict[str, Any] = {}
    for step in rollout(env, seed=0, ticks=env.horizon):
        info, flown = step.info, flown + 1
        position = max(position, float(np.linalg.norm(info["position_error"])))
        attitude = max(attitude, float(np.linalg.norm(info["attitude_error"])))
        thrust = info["thrust_command"]
        bounded &= bool(np.isfinite(thrust).all() and thrust.min() >= 0.0 and thrust.max() <= ROBOT.max_thrust + 1e-9)
    return {
        "position_m": position,
        "attitude_rad": attitude,
        "commands_in_bounds": bounded,
        "failure": info["failure"],
        "seconds": flown / CONTROL_RATE,
    }


def lost_lines(rows: list[dict[str, Any]]) -> list[list[str]]:
    """Return the rows as a table."""
    lines = [["fault", "form", "rotor", "statics", "τ static", "λ static", "position", "attitude", "flight"]]
    for row in rows:
        flight = f"{row['failure']} after {row['seconds']:.1f} s" if row["failure"] else "in the air"
        if not row["commands_in_bounds"]:
            flight += ", a command out of bounds"
        lines.append(
            [
                row["fault"],
                row["form"],
                f"{row['rotor']}",
                "feasible" if row["feasible"] else "infeasible",
                f"{row['static_torque_nm']:.2f} Nm",
                f"{row['static_thrust_n']:.1f} N",
                f"{row['position_m']:.3f} m",
                f"{row['attitude_rad']:.3f} rad",
                flight,
            ]
        )
    return lines
