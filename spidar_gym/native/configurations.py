"""Structs of a simulated robot's configuration."""

from functools import cache

from spidar_gym.native.structs import CStruct, struct_of
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.recirculation import RecirculationConfig
from spidar_gym.sim.sensors import SensorConfig


@cache
def configuration_structs() -> tuple[CStruct, ...]:
    """Return the structs of a simulated robot's configuration, nested structs first."""
    parts = (
        ActuatorConfig(), AeroConfig(), BodyConfig(), GroundConfig(), ObjectConfig(), RecirculationConfig(),
        SensorConfig(), PlantConfig(), Disturbances(),
    )  # fmt: skip
    return tuple(map(struct_of, parts))
