"""Factory of controllers: the only module that distinguishes Python controllers from the compiled core."""

from collections.abc import Callable

from spidar_gym.control.allocation.allocator import Allocator
from spidar_gym.control.crawl.controller import Crawler, CrawlerConfig
from spidar_gym.control.crawl.gait import Gait
from spidar_gym.control.flight.controller import ControllerConfig, FlightController
from spidar_gym.control.interface import CrawlControl, FlightControl
from spidar_gym.control.locomotion.manager import Manager
from spidar_gym.control.locomotion.orders import ManagerConfig, Orders
from spidar_gym.envs.fleet import Fleet
from spidar_gym.errors import InvalidValueError, require_name
from spidar_gym.model.dynamics import Model
from spidar_gym.native.core_crawler import CoreCrawler
from spidar_gym.native.core_flight import CoreFlightController
from spidar_gym.native.core_manager import CoreManager
from spidar_gym.native.library import Core
from spidar_gym.robot import ROBOT, RobotSpec
from spidar_gym.state import Reference

CONTROLS = ("python", "core")
"""Implementations of the controller: the Python controller, or the compiled core."""


def make_flight_controller(
    config: ControllerConfig,
    control: str,
    allocator: type[Allocator] | None = None,
    law: type | None = None,
    fleet: Fleet | None = None,
    preview: Callable[[float], Reference] | None = None,
    robot: RobotSpec = ROBOT,
) -> FlightControl:
    """Make a flight controller.

    Args:
        config: Allocation, gains, compensations.
        control: One of `CONTROLS`.
        allocator: A subclass of `Allocator` in place of the QP; the compiled core has its own.
        law: A subclass of `FlightController` in place of the paper's; the compiled core has its own.
        fleet: Robots in the engine; with the core, the returned controller is a view of the first robot's.
        preview: Function that a custom law can call: seconds ahead → reference.
        robot: Robot of the controller's model.

    Raises:
        UnknownNameError: For a control that does not exist; it lists the valid ones.
        InvalidValueError: For an allocator or a law of another class, or one with the compiled core.
        MissingDependencyError: When the core is not compiled.
    """
    if choose_control(control, allocator, law) == "python":
        controller: FlightController = (law or FlightController)(config, Model(robot), allocator=allocator or Allocator)
        controller.preview = preview
        return controller
    if fleet is None:
        return CoreFlightController(config, Model(robot))
    return CoreFlightController(
        config, Model(robot), record=fleet.robots["flight"][0:1].reshape(()), room=fleet.engine.rooms[0]
    )


def choose_control(control: str | None, allocator: type[Allocator] | None = None, law: type | None = None) -> str:
    """Return the implementation of a flight controller: the given one, by default the core unless there is custom code.

    Raises:
        UnknownNameError: For a control that does not exist; it lists the valid ones.
        InvalidValueError: For an allocator or a law of another class, or one with the compiled core.
    """
    return _choose(control, allocator=(allocator, Allocator), law=(law, FlightController))


def choose_crawl_control(control: str | None, law: type | None = None) -> str:
    """Return the implementation of a crawler, as `choose_control` does."""
    return _choose(control, law=(law, Crawler))


def _choose(control: str | None, **own: tuple[object, type]) -> str:
    """Check that custom classes are subclasses of their bases, and choose the implementation."""
    given = {name: pair for name, pair in own.items() if pair[0] is not None}
    if control is None:
        control = "python" if given else "core"
    require_name("control", control, CONTROLS)
    for name, (value, base) in given.items():
        if not (isinstance(value, type) and issubclass(value, base)):
            raise InvalidValueError(name, value, f"a subclass of {base.__name__}")
        if control == "core":
            raise InvalidValueError(name, value, "None: the core has its own")
    return control


def make_crawler(
    config: CrawlerConfig, control: str, law: type | None = None, fleet: Fleet | None = None
) -> CrawlControl:
    """Make a crawler; arguments and errors as for `make_flight_controller`."""
    if choose_crawl_control(control, law) == "python":
        return (law or Crawler)(config)
    if fleet is None:
        return CoreCrawler(config)
    return CoreCrawler(config, record=fleet.robots["crawl"][0:1].reshape(()), room=fleet.engine.rooms[0])


def gait_type(law: type | None) -> type[Gait]:
    """Return the class of the phase machine of a custom crawler, or of the paper's."""
    return (law or Crawler).gait_type


def make_manager(config: ManagerConfig, control: str, fleet: Fleet | None = None) -> Manager | CoreManager:
    """Make a manager of flight and crawl; with the core and a fleet it is a view of the first robot's.

    Args:
        config: Both controllers and the transitions between them.
        control: One of `CONTROLS`.
        fleet: Robots in the engine.
    """
    require_name("control", control, CONTROLS)
    if control == "python":
        return Manager(config)
    if fleet is None:
        return CoreManager(config)
    return CoreManager(config, record=fleet.robots["manager"][0:1].reshape(()), room=fleet.engine.rooms[0])


def is_compiled(control: str) -> bool:
    """Return whether the compiled core controls the robot."""
    return control == "core"


def forget(controller: FlightControl | CrawlControl | Orders) -> None:
    """Clear the values that a view of an engine's controller has cached, after a tick."""
    if isinstance(controller, Core):
        controller.forget()
