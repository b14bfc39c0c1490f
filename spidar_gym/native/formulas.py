"""The engine's formulas as single functions, for plots and tests: air, weather, power and voltage.

They call the functions that the simulation uses; `spidar_gym/native/engine/` has the equations. `tests/reference/`
implements each of them in NumPy.
"""

import ctypes
from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from spidar_gym.arrays import JointVector, RotorVector, Vector3
from spidar_gym.native.draws import from_numpy, take_back
from spidar_gym.native.engine_structs import engine_layouts
from spidar_gym.native.library import load_core, pointer
from spidar_gym.native.mujoco import Simulation, world
from spidar_gym.native.structs import fill
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.recirculation import RecirculationConfig


@cache
def _formula(name: str, inputs: int) -> Any:  # noqa: ANN401 - numbers, or arrays of any shape
    """Return a function of the library from numbers to a number, vectorised over arrays."""
    function = load_core()[name]
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * inputs
    return np.frompyfunc(function, inputs, 1)


@cache
def _function(name: str, result: Any = None) -> Any:  # noqa: ANN401 - of ctypes
    """Return a function of the library that takes pointers and numbers."""
    function = load_core()[name]
    function.restype = result
    return function


def jet_profile(
    s: np.ndarray | float,
    r: np.ndarray | float,
    w: np.ndarray | float,
    *,
    core_length: float,
    radius: float = ROBOT.propeller_radius,
) -> np.ndarray:
    """Compute the speed of the air in a ducted jet [m/s]; zero upstream of 1 cm behind the exit.

    A core of the exit speed w shrinks to a point over `core_length` diameters inside a Gaussian shear layer, whose
    width follows from ∫ρ u² dA = T at every s; beyond the core the jet spreads and slows down with 1/s.

    Args:
        s: Distance from the exit along the jet [m]; s, r and w broadcast.
        r: Distance from the axis [m].
        w: Speed at the exit, √(T / (ρ A)) [m/s].
        core_length: Length of the core [diameters].
        radius: Radius R of the exit [m].
    """
    return np.asarray(_formula("sp_jet_profile", 5)(s, r, w, core_length, radius), float)


def thrust_factor(inflow: np.ndarray | float, *, zero_thrust_speed: float) -> np.ndarray:
    """Compute the thrust over the thrust at rest, of a duct whose motor keeps its speed, within 0 … 1.3.

    Linear-lift blade element T = K (V_z − V_d) with the duct's momentum balance T = ρ A V_e (V_e − V). With
    μ = V / w, ε = V_e / w, χ = V_z / w: ε = ½ [(μ − g) + √((μ − g)² + 4 χ g)], g = 1 / (χ − 1), τ = ε (ε − μ).

    Args:
        inflow: μ, mean axial speed of the air flowing down onto the disc over the jet speed w at rest.
        zero_thrust_speed: χ.
    """
    return np.asarray(_formula("sp_thrust_factor", 2)(inflow, zero_thrust_speed), float)


@dataclass(frozen=True, slots=True)
class AirForces:
    """Result of one evaluation of the air."""

    generalized: Float[np.ndarray, " nv"]
    """Generalised force [N, Nm] for `qfrc_applied`."""
    thrust_factor: Float[np.ndarray, "16"]
    """Thrust of each duct over its thrust in still air; the ducts of module 1 first."""
    forces_w: Float[np.ndarray, "m 3"]
    """Force at each of the points below, world [N]."""
    points_w: Float[np.ndarray, "m 3"]
    """Duct centres, then three points of each link and five of the torso [m]."""
    object_force_w: Vector3
    """Force on the object, world [N]."""
    object_torque_w: Vector3
    """Its torque about the object's origin, world [Nm]."""


def evaluate_air(
    simulation: Simulation,
    thrust: RotorVector,
    *,
    wind_w: Vector3,
    noise: RotorVector,
    push_w: Vector3,
    config: AeroConfig | None = None,
    recirculation: RecirculationConfig | None = None,
    eddy: np.ndarray | None = None,
    robot: RobotSpec = ROBOT,
    thing: ObjectConfig | None = None,
) -> AirForces:
    """Evaluate the forces of the air on a robot whose kinematics are up to date.

    Args:
        simulation: Simulation of a scene of the robot; positions and velocities are read from its `data`.
        thrust: Thrust of the modules in still air [N].
        wind_w: Velocity of the air far away, world [m/s].
        noise: Thrust noise of each module [N].
        push_w: Force of a push at the torso's centre, world [N].
        config: Parameters of the air.
        recirculation: Parameters of the recirculation.
        eddy: State of its eddy, (6,): U, then Ω, less their means, over their standard deviations; none without it.
        robot: Robot of the scene.
        thing: Object of the scene; none by default.
    """
    layouts = engine_layouts()
    parameters, found = np.zeros((), layouts["aero_config"]), np.zeros((), layouts["air"])
    fill(parameters, config or AeroConfig())
    returning = np.zeros((), layouts["recirculation_config"])
    fill(returning, recirculation or RecirculationConfig())
    nearby = np.zeros((), layouts["object_config"])
    fill(nearby, thing or ObjectConfig())
    given = [np.ascontiguousarray(each, float) for each in (thrust, wind_w, noise, push_w)]
    names = ("tile0_0", "box0")
    has = [mujoco.mj_name2id(simulation.model, mujoco.mjtObj.mjOBJ_GEOM, name) >= 0 for name in names]  # pyright: ignore[reportAttributeAccessIssue] - compiled, without stubs
    arguments = (
        world(*has, robot, thing is not None), simulation.record, parameters, returning, nearby, *given,
    )  # fmt: skip
    turning = None if eddy is None else pointer(np.ascontiguousarray(eddy, float))
    _function("sp_evaluate_air")(*map(pointer, arguments), turning, pointer(found))
    return AirForces(
        found["generalized"].copy(), found["thrust_factor"].copy(),
        found["forces_w"].reshape(-1, 3).copy(), found["points_w"].reshape(-1, 3).copy(),
        found["object_force_w"].copy(), found["object_torque_w"].copy(),
    )  # fmt: skip


class Weather:
    """State of wind and pushes in an episode."""

    def __init__(self, disturbances: Disturbances, rng: np.random.Generator) -> None:
        """Draw the weather at the start of an episode; advances `rng` as draws in NumPy would."""
        layouts = engine_layouts()
        self._record, self._disturbances = np.zeros((), layouts["weather"]), np.zeros((), layouts["disturbances"])
        fill(self._disturbances, disturbances)
        generator = from_numpy(rng)
        _function("sp_draw_weather")(*map(pointer, (self._disturbances, generator, self._record)))
        take_back(rng, generator)

    def advance(self, time: float, dt: float, rng: np.random.Generator) -> None:
        """Advance by `dt` [s] to `time` [s]: w ← w e^{−V dt/L} + σ √(1 − e^{−2 V dt/L}) n, V = max(wind, 1 m/s)."""
        generator = from_numpy(rng)
        times = ctypes.c_double(time), ctypes.c_double(dt)
        advance = _function("sp_advance_weather")
        advance(pointer(self._disturbances), *times, pointer(generator), pointer(self._record))
        take_back(rng, generator)

    @property
    def mean_w(self) -> Vector3:
        """Mean wind [m/s]."""
        return self._record["mean_w"].copy()

    @property
    def gust_w(self) -> Vector3:
        """Turbulence [m/s]."""
        return self._record["gust_w"].copy()

    @property
    def push_w(self) -> Vector3:
        """Force of the present push [N]."""
        return self._record["push_w"].copy()


def advance_eddy(eddy: np.ndarray, config: RecirculationConfig, dt: float, rng: np.random.Generator) -> np.ndarray:
    """Sample the eddy's next state (6,), `dt` [s] later: x ← x e^{−dt/T} + √(1 − e^{−2 dt/T}) n."""
    parameters = np.zeros((), engine_layouts()["recirculation_config"])
    fill(parameters, config)
    after, generator = np.array(eddy, float), from_numpy(rng)
    advance = _function("sp_advance_eddy")
    advance(pointer(parameters), ctypes.c_double(dt), pointer(generator), pointer(after))
    take_back(rng, generator)
    return after


def thrust_noise(noise: RotorVector, sigma: float, dt: float, rng: np.random.Generator) -> RotorVector:
    """Draw the next sample of the modules' noise, first order, of standard deviation `sigma` [N], `dt` [s] later."""
    after, generator = np.array(noise, float), from_numpy(rng)
    _function("sp_advance_noise")(pointer(after), ctypes.c_double(sigma), ctypes.c_double(dt), pointer(generator))
    take_back(rng, generator)
    return after


def electrical_power(thrust: RotorVector, joint_torque: JointVector, joint_velocity: JointVector) -> float:
    """Compute the electrical power [W]: P = P_b + Σ c λ^1.5 + Σ max(τ q̇, 0) / η + Σ k τ².

    Args:
        thrust: Thrust of the modules in still air [N].
        joint_torque: Torque of the joint servos [Nm].
        joint_velocity: q̇ [rad/s].
    """
    given = [np.ascontiguousarray(each, float) for each in (thrust, joint_torque, joint_velocity)]
    return _function("sp_electrical_power", ctypes.c_double)(*map(pointer, given))


def voltage(energy_wh: float, power: float) -> float:
    """Compute the voltage of a pack [V] after `energy_wh` [Wh] at a load of `power` [W]: linear, minus the sag."""
    return float(_formula("sp_voltage", 2)(energy_wh, power))


def max_thrust(volts: float) -> float:
    """Compute the largest thrust of a module at a voltage [N]: 31.8 N at 22.2 V, 40.5 N at 25.2 V [JSK]."""
    return float(_formula("sp_battery_thrust", 1)(volts))
