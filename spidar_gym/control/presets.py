"""Presets: allocation, gains, compensations and gait of each named controller, in flight and on the ground."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

from spidar_gym.control.crawl.controller import CrawlerConfig
from spidar_gym.control.crawl.footsteps import GaitConfig
from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.flight.compensation import CompensationConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.errors import require_name
from spidar_gym.robot import ROBOT, RobotSpec

# Result of `spidar tune flight` after 200 generations: the last line of baselines/searches/flight.json.
TUNED = ControllerConfig(
    centroidal=CentroidalConfig(
        position_gains=((39.63, 0.03036, 7.01), (39.63, 0.03036, 7.01), (38.5, 5.118, 7.421)),
        attitude_gains=((39.84, 0.3556, 6.985), (39.84, 0.3556, 6.985), (40.01, 13.45, 6.543)),
    ),
    compensation=CompensationConfig(
        momentum_gain=1.393,
        momentum_filter=0.004649,
        servo_bandwidth=42.34,
        vectoring_lead=0.04827,
        observer_gain=0.6004,
        observer_time=0.1989,
        observer_lag=0.2988,
        joint_ramp=0.4,
        reference_gain=1.0,
    ),
)
"""The best flight controller of the described robot without a lead compensator; badly damped joints throw it over."""
# Result of a search of 30 generations on an earlier version of the simulator.
TUNED_V1 = ControllerConfig(
    centroidal=CentroidalConfig(
        position_gains=((14.12, 0.0474, 4.193), (14.12, 0.0474, 4.193), (7.76, 6.023, 7.479)),
        attitude_gains=((24.37, 0.645, 6.978), (24.37, 0.645, 6.978), (19.5, 5.914, 7.322)),
    ),
    compensation=CompensationConfig(
        momentum_gain=1.276,
        momentum_filter=0.02851,
        servo_bandwidth=52.48,
        vectoring_lead=0.05232,
        observer_gain=0.8372,
        observer_time=0.3603,
        observer_lag=0.1621,
        joint_ramp=0.4,
        reference_gain=1.0,
    ),
)
"""The first version of `tuned`, with which policies of format 1 and 2 were trained."""
# Result of `spidar tune retuned`, run until no step improved it: the last line of baselines/searches/retuned.json.
RETUNED = replace(
    TUNED,
    centroidal=CentroidalConfig(
        position_gains=((52.51, 0.03036, 7.437), (52.51, 0.03036, 7.437), (46.77, 8.542, 7.936)),
        attitude_gains=((60.51, 1.584, 7.003), (60.51, 1.584, 7.003), (60.97, 13.45, 6.948)),
    ),
    compensation=replace(
        TUNED.compensation,
        momentum_gain=1.432,
        observer_gain=0.3974,
        observer_time=0.1235,
        observer_lag=0.2988,
        torque_observer_gain=0.4347,
        torque_observer_time=0.09562,
        torque_observer_lag=0.4657,
        lead_gain=0.8348,
        lead_time=0.03258,
    ),
)
"""The best flight controller of the described robot: `tuned` with a lead compensator and a separate torque observer. A
robot with badly damped joints falls with it."""
# Result of `spidar tune steady --scenarios 6 --generations 60`: the last line of baselines/searches/steady.json.
STEADY = replace(
    TUNED,
    motion="observed",
    centroidal=CentroidalConfig(
        position_gains=((35.97, 0.0546, 6.33), (35.97, 0.0546, 6.33), (44.21, 7.125, 7.244)),
        attitude_gains=((37.9, 1.46, 7.552), (37.9, 1.46, 7.552), (52.8, 6.615, 8.479)),
    ),
    compensation=replace(
        TUNED.compensation,
        vectoring_lead=0.05,
        observer_gain=0.4707,
        observer_time=0.2,
        observer_lag=0.25,
    ),
)
"""The recommended flight controller: the best one with margins for robots whose legs bend and hardly damp."""
# Chosen by hand: two thirds of the bandwidth of `paper` in attitude and position, so that it excites the legs less.
FIRST_FLIGHT = ControllerConfig(
    joint_speed=0.1,
    centroidal=CentroidalConfig(
        position_gains=((1.8, 0.054, 2.5), (1.8, 0.054, 2.5), (2.0, 0.5, 2.5)),
        attitude_gains=((6.5, 0.3, 3.6), (6.5, 0.3, 3.6), (5.0, 0.2, 3.4)),
    ),
    compensation=CompensationConfig(joint_ramp=0.4),
)
"""The flight controller for the first flights of a robot: little bandwidth, large margins, slow joints."""
PRESETS: dict[str, ControllerConfig] = {
    "paper": ControllerConfig(),
    "as_flown": ControllerConfig(allocation="as_flown"),
    # The lab's public estimator omits the joints' share of the CoG's velocity; that the robot flew with it is inferred.
    "as_flown_quasi": ControllerConfig(allocation="as_flown", motion="quasi_static"),
    "tuned": TUNED,
    "retuned": RETUNED,
    "steady": STEADY,
    "first_flight": FIRST_FLIGHT,
}
"""Controllers by name."""
FORMER_PRESETS: dict[str, ControllerConfig] = {"tuned_v1": TUNED_V1}
"""Controllers that are accepted by name and not listed: rows, artifacts and searches refer to them."""


ConfigT = TypeVar("ConfigT", ControllerConfig, CrawlerConfig)


def _named(name: str, listed: Mapping[str, ConfigT], former: Mapping[str, ConfigT]) -> ConfigT:
    """A preset by its name (`UnknownNameError` lists the present ones)."""
    if name in former:
        return former[name]
    require_name("preset", name, listed)
    return listed[name]


def for_robot(config: ConfigT, robot: RobotSpec) -> ConfigT:
    """Adapt a configuration to a robot: fields that equal the nominal robot's values are set to those of `robot`.

    A crawler also gets the legs of `robot`. Gains, margins and the gait's angles and heights stay, because they are
    choices and not properties of a robot.
    """
    own: dict[str, Any] = {
        name: getattr(robot, name.replace("joint_torque_limit", "max_joint_torque"))
        for name in ("joint_speed", "joint_torque_limit")
        if getattr(config, name) == getattr(ROBOT, name.replace("joint_torque_limit", "max_joint_torque"))
    }
    if isinstance(config, CrawlerConfig):
        for name, share in (("foot_friction", 0.6), ("peg_friction", 0.5)):
            if getattr(config, name) == share * getattr(ROBOT, name):
                own[name] = share * getattr(robot, name)
        return replace(config, **own, gait=replace(config.gait, robot=robot))
    if config.interference.torso_radius == ROBOT.torso_radius:
        own["interference"] = replace(config.interference, torso_radius=robot.torso_radius)
    return replace(config, **own)


def controller_config(preset: str, robot: RobotSpec = ROBOT) -> ControllerConfig:
    """Return the flight configuration of a preset for a robot (`UnknownNameError` lists the valid presets)."""
    config = _named(preset, PRESETS, FORMER_PRESETS)
    return config if robot == ROBOT else for_robot(config, robot)


SCHEDULES: dict[str, dict[str, Any]] = {
    # The paper's schedule: one phase after the other.
    "sequential": {},
    # Legs swing while they rise, the torso moves forward while it is lifted, the lift is low, no rest between cycles.
    "overlapped": {
        "swing_at": 0.5, "lower_at": 0.12, "forward_at": 0.2, "down_at": 0.97, "start_time": 0.3, "spool_time": 0.0,
        "settle_time": 0.0,
        "lift_height": 0.04, "leg_touch_time": 0.15, "torso_touch_time": 0.1, "trim_gain": 4.0,
    },
}  # fmt: skip
"""Fields of `GaitConfig` that each schedule changes."""
# More margin for the servos, and thrust feedback of the legs' errors: the paper's future work.
ROBUST = CrawlerConfig(
    gait=GaitConfig(rolling=True, start_time=0.8, spool_time=0.8),
    torque_limit=4.5, blend_time=0.8, foot_friction=0.25, leg_stiffness=40.0, leg_damping=2.0,
)  # fmt: skip
"""Crawler with margins for robots, floors and feet that differ from the nominal ones."""
# The margins of ROBUST with the overlapped schedule, except that the torso is lowered only after it has arrived.
ROBUST_OVERLAPPED_V1 = replace(ROBUST, gait=GaitConfig(rolling=True, **{**SCHEDULES["overlapped"], "down_at": 1.0}))
"""The first version of `robust_overlapped`, tuned by hand."""
# Result of `spidar tune crawl` after 26 generations: the last line of baselines/searches/crawl.json. The rest times
# before a crawl are the initial values of the search.
ROBUST_OVERLAPPED = CrawlerConfig(
    gait=GaitConfig(
        rolling=True, start_time=0.12, spool_time=0.0, settle_time=0.0,
        swing_at=0.4706, lower_at=0.335, forward_at=0.2377, down_at=1.0,
        lift_height=0.02464, raise_angle=0.09647, leg_touch_time=0.1252, torso_touch_time=0.1,
        trim_gain=4.965, max_distance=0.3106, inner=-0.4832, outer=1.287,
    ),
    power=True, torque_limit=5.969, blend_time=0.2698, foot_friction=0.4729, min_normal=15.55, feed_forward=0.7914,
    leg_stiffness=20.31, leg_damping=2.0,
)  # fmt: skip
"""The best crawler before `robust_retuned`: it minimises electrical power and shortens phases that are safe."""
# Result of `spidar tune recrawl`, started from ROBUST_OVERLAPPED (the last line of baselines/searches/recrawl.json),
# with two manual changes: feet and torso are lifted higher, and the torque limit is below the search's 6.83 Nm. With
# the feet as low as in the search's result, 3 of 40 other crawls over tiles failed; with its torque limit, 2 of 100
# failed. With the changes none of them fails.
ROBUST_RETUNED = replace(
    ROBUST_OVERLAPPED,
    gait=replace(
        ROBUST_OVERLAPPED.gait,
        swing_at=0.4295, lower_at=0.259, lift_height=0.027, raise_angle=0.11, leg_touch_time=0.09122,
        trim_gain=3.904, inner=-0.4732,
    ),
    power=False, torque_limit=6.5, foot_friction=0.3239, min_normal=24.06, blend_time=0.258, leg_stiffness=30.0,
)  # fmt: skip
"""A crawler for the described robot: it minimises ‖f‖², assumes less friction, and uses more of the servos' torque."""
# As `robust_retuned`, with the lower lifts of `robust_overlapped`, which take less time, and one correction. As that
# moves the torso without a step, the torso may be lowered 20 mm short of its goal. `spidar tune steady_crawl` starts
# here; its result after 20 generations, baselines/searches/steady_crawl.json, drags the feet of other robots.
STEADY_CRAWL = replace(
    ROBUST_RETUNED,
    gait=replace(
        ROBUST_RETUNED.gait, corrections=1, arrival=0.02, stall_time=0.15, lift_height=0.02464, raise_angle=0.09647
    ),
)
"""The recommended crawler: it corrects the torso's place at the end, and succeeds with slow and fast joints."""
CRAWL_PRESETS: dict[str, CrawlerConfig] = {
    # The paper's phases and cost; the lab's planned friction is not published, so 0.6 of the true friction is used.
    "published": CrawlerConfig(),
    "overlapped": CrawlerConfig(gait=GaitConfig(rolling=True, **SCHEDULES["overlapped"])),
    "robust": ROBUST,
    "robust_overlapped": ROBUST_OVERLAPPED,
    "robust_retuned": ROBUST_RETUNED,
    "steady_crawl": STEADY_CRAWL,
}
"""Crawlers by name."""
FORMER_CRAWL_PRESETS: dict[str, CrawlerConfig] = {"robust_overlapped_v1": ROBUST_OVERLAPPED_V1}
"""Crawlers that are accepted by name and not listed, as `FORMER_PRESETS`."""


def crawler_config(preset: str, schedule: str | None = None, robot: RobotSpec = ROBOT) -> CrawlerConfig:
    """Return the crawler configuration of a preset for a robot (`UnknownNameError` lists the valid presets).

    Args:
        preset: Name of the preset.
        schedule: Name of a schedule that replaces the preset's, or None.
        robot: The robot.

    Raises:
        InvalidValueError: For a robot whose legs cannot reach the preset's footholds.
    """
    config = _named(preset, CRAWL_PRESETS, FORMER_CRAWL_PRESETS)
    if robot != ROBOT:
        config = for_robot(config, robot)
    if schedule is None:
        return config
    require_name("schedule", schedule, SCHEDULES)
    plain = GaitConfig(rolling=config.gait.rolling, robot=robot)
    return replace(config, gait=replace(plain, **SCHEDULES[schedule]))
