"""What can be chosen about the simulated robot: one configuration of five parts, all of them nominal by default."""

from dataclasses import dataclass, field, fields

from spidar_gym.errors import InvalidValueError, is_finite, require_flag, require_instance, require_least
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.sim.actuators import ActuatorConfig
from spidar_gym.sim.air import AeroConfig
from spidar_gym.sim.body import BodyConfig
from spidar_gym.sim.ground import GroundConfig
from spidar_gym.sim.sensors import SensorConfig


@dataclass(frozen=True)
class PlantConfig:
    """What can be chosen about the simulated robot."""

    substeps: int = 10
    """Physics steps a control period: 10 × 2.5 ms = 25 ms, 40 Hz."""
    joint_speed: float = ROBOT.joint_speed
    """The joint servos' setpoints move no faster than this [rad/s]: the one joint speed limit there is."""
    idle_thrust: float = 0.0
    """Least commanded thrust of a module [N]; `ROBOT.idle_thrust` for armed motors."""
    sense: bool = False
    """Whether `Plant.measure` gives what the real sensors say."""
    body: BodyConfig = field(default_factory=BodyConfig)
    """Masses and friction."""
    actuators: ActuatorConfig = field(default_factory=ActuatorConfig)
    """Rotors and servos."""
    aero: AeroConfig = field(default_factory=AeroConfig)
    """The air."""
    sensors: SensorConfig = field(default_factory=SensorConfig)
    """Noise of the sensors."""
    ground: GroundConfig = field(default_factory=GroundConfig)
    """The floor."""
    robot: RobotSpec = ROBOT
    """Which robot it is; the numbers above are how far it is from that; `PlantConfig.of` begins with none."""

    @classmethod
    def of(cls, robot: RobotSpec) -> "PlantConfig":
        """A robot as described."""
        return cls(
            joint_speed=robot.joint_speed, body=BodyConfig.of(robot), actuators=ActuatorConfig.of(robot), robot=robot
        )

    def __post_init__(self) -> None:
        """Refuse what cannot be simulated."""
        require_least(1, substeps=self.substeps)
        require_flag(sense=self.sense)
        for f in fields(self):
            if isinstance(f.default_factory, type):
                require_instance(f.default_factory, **{f.name: getattr(self, f.name)})
        if not (is_finite(self.joint_speed) and self.joint_speed > 0.0):
            raise InvalidValueError("joint_speed", self.joint_speed, "a number above 0 [rad/s]")
        if not (is_finite(self.idle_thrust) and 0.0 <= self.idle_thrust <= self.robot.max_thrust):
            raise InvalidValueError("idle_thrust", self.idle_thrust, f"a number within 0 … {self.robot.max_thrust:g} N")
