"""Who controls: the one place that knows readable and compiled controllers apart."""

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
"""Who controls: the readable controller, or the compiled core of the robot."""


def make_flight_controller(
    config: ControllerConfig,
    control: str,
    allocator: type[Allocator] | None = None,
    law: type | None = None,
    fleet: Fleet | None = None,
    preview: Callable[[float], Reference] | None = None,
    robot: RobotSpec = ROBOT,
) -> FlightControl:
    """A flight controller.

    Args:
        config: Allocation, gains, compensations.
        control: One of `CONTROLS`.
        allocator: A subclass of `Allocator` in place of the QP; the compiled core has its own.
        law: A subclass of `FlightController` in place of the paper's; the compiled core has its own.
        fleet: Robots in the engine, of which the first one's controller is looked at.
        preview: What a law is told of what comes: seconds ahead → reference.
        robot: Whose model it has.

    Raises:
        UnknownNameError: For a control that does not exist; it lists the valid ones.
        InvalidValueError: For an allocator or a law that is none, or one for the compiled core.
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
    """Who controls a flight: what was chosen, or by default the core unless it has to ask code of one's own.

    Raises:
        UnknownNameError: For a control that does not exist; it lists the valid ones.
        InvalidValueError: For an allocator or a law that is none, or one for the compiled core.
    """
    return _choose(control, allocator=(allocator, Allocator), law=(law, FlightController))


def choose_crawl_control(control: str | None, law: type | None = None) -> str:
    """Who controls a crawl, likewise."""
    return _choose(control, law=(law, Crawler))


def _choose(control: str | None, **own: tuple[object, type]) -> str:
    """Refuse what is no subclass of what it has to be."""
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
    """A crawler, or the first one's in the engine; arguments and errors as of `make_flight_controller`."""
    if choose_crawl_control(control, law) == "python":
        return (law or Crawler)(config)
    if fleet is None:
        return CoreCrawler(config)
    return CoreCrawler(config, record=fleet.robots["crawl"][0:1].reshape(()), room=fleet.engine.rooms[0])


def gait_type(law: type | None) -> type[Gait]:
    """The phase machine of a crawler of one's own, or the paper's."""
    return (law or Crawler).gait_type


def make_manager(config: ManagerConfig, control: str, fleet: Fleet | None = None) -> Manager | CoreManager:
    """A manager of both gaits, or the first one's in the engine; `control` is one of `CONTROLS`."""
    require_name("control", control, CONTROLS)
    if control == "python":
        return Manager(config)
    if fleet is None:
        return CoreManager(config)
    return CoreManager(config, record=fleet.robots["manager"][0:1].reshape(()), room=fleet.engine.rooms[0])


def is_compiled(control: str) -> bool:
    """Whether the core of the robot controls."""
    return control == "core"


def forget(controller: FlightControl | CrawlControl | Orders) -> None:
    """Let a controller that looks at one in the engine read anew what is asked of it: a tick has passed."""
    if isinstance(controller, Core):
        controller.forget()
