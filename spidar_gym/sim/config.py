"""Configuration of the simulated robot and its world in seven parts, all nominal by default."""

from dataclasses import dataclass, field, fields

from spidar_gym.errors import InvalidValueError, is_finite, require_flag, require_instance, require_least
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.object import ObjectConfig
from spidar_gym.sim.recirculation import RecirculationConfig
from spidar_gym.sim.sensors import SensorConfig

NEEDS_RNG = "a generator, where there is noise, wind, pushes, recirculation, jitter or loss"
"""Valid value of a generator that is missing."""


@dataclass(frozen=True)
class PlantConfig:
    """Configuration of the simulated robot."""

    substeps: int = 10
    """Physics steps per control period: 10 × 2.5 ms = 25 ms, 40 Hz."""
    joint_speed: float = ROBOT.joint_speed
    """Largest speed of the joint servos' setpoints, the only limit of joint speeds [rad/s]."""
    idle_thrust: float = 0.0
    """Least commanded thrust of a module [N]; `ROBOT.idle_thrust` for armed motors."""
    sense: bool = False
    """Whether sensors are simulated, for `Plant.measure`."""
    body: BodyConfig = field(default_factory=BodyConfig)
    """Masses, inertias and friction."""
    actuators: ActuatorConfig = field(default_factory=ActuatorConfig)
    """Rotors and servos."""
    aero: AeroConfig = field(default_factory=AeroConfig)
    """The air."""
    recirculation: RecirculationConfig = field(default_factory=RecirculationConfig)
    """Eddies of the air that returns to the robot."""
    sensors: SensorConfig = field(default_factory=SensorConfig)
    """Noise of the sensors."""
    ground: GroundConfig = field(default_factory=GroundConfig)
    """The floor."""
    object: ObjectConfig = field(default_factory=ObjectConfig)
    """A free object; by default there is none."""
    robot: RobotSpec = ROBOT
    """The described robot; the parts above may deviate from it, and `PlantConfig.of` returns none that do."""

    @property
    def draws(self) -> bool:
        """Whether the robot samples random numbers: noise, recirculation, jitter and loss of commands."""
        return self.sense or self.actuators.has_draws or self.recirculation.acts

    @classmethod
    def of(cls, robot: RobotSpec) -> "PlantConfig":
        """Return the configuration of a described robot."""
        return cls(
            joint_speed=robot.joint_speed, body=BodyConfig.of(robot), actuators=ActuatorConfig.of(robot), robot=robot
        )

    def __post_init__(self) -> None:
        """Validate the configuration."""
        require_least(1, substeps=self.substeps)
        require_flag(sense=self.sense)
        for f in fields(self):
            if isinstance(f.default_factory, type):
                require_instance(f.default_factory, **{f.name: getattr(self, f.name)})
        if not (is_finite(self.joint_speed) and self.joint_speed > 0.0):
            raise InvalidValueError("joint_speed", self.joint_speed, "a number above 0 [rad/s]")
        if not (is_finite(self.idle_thrust) and 0.0 <= self.idle_thrust <= self.robot.max_thrust):
            raise InvalidValueError("idle_thrust", self.idle_thrust, f"a number within 0 … {self.robot.max_thrust:g} N")
