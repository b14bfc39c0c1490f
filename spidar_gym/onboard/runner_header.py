"""The generated header spidar_runner.h: messages, topics, structs, limits, and the digest of the interface."""

from spidar_gym.control.course import gates
from spidar_gym.control.locomotion.commands import (
    FIELD,
    FORCES,
    HEIGHTS,
    MOST_FRICTION,
    MOST_MASS,
    SIZES,
    SPEEDS,
    STEEPEST,
)
from spidar_gym.control.locomotion.orders import PHASES
from spidar_gym.native.codegen.header import (
    array,
    c_only,
    define,
    enumeration,
    header,
    initializer,
    interface_digest,
    interface_hash,
    struct,
    tables_last,
)
from spidar_gym.onboard import health
from spidar_gym.onboard.fields import fields_header
from spidar_gym.onboard.health import HEALTH_TOPICS
from spidar_gym.onboard.limits import Limits
from spidar_gym.onboard.runner_structs import (
    DIGEST,
    ENUMERATIONS,
    FASTEST_EXCITATION,
    FAULTS,
    MAGIC,
    MAX_EXCITATIONS,
    MAX_FORMS,
    MAX_HEADINGS,
    MAX_MOVES,
    MAX_WINDOWS,
    MOST_EXCITATION,
    MOST_ORDERS,
    MOST_PRESETS,
    N_NAMES,
    NAME,
    ORDER_TEXT,
    RATE_TOLERANCE,
    REASON,
    RUNNER,
    RUNNER_STRUCTS,
    TOPICS,
)
from spidar_gym.robot import GIMBAL_NAMES, JOINT_NAMES, RobotSpec
from spidar_gym.tasks.course import DECIDE


def _header_lines() -> list[str]:
    """Return the lines of spidar_runner.h without its digest."""
    sizes = {
        "MAX_FORMS": MAX_FORMS, "MAX_WINDOWS": MAX_WINDOWS, "MAX_MOVES": MAX_MOVES, "MAX_HEADINGS": MAX_HEADINGS,
        "MAX_EXCITATIONS": MAX_EXCITATIONS, "NAMES": N_NAMES,
        "ORDER_TEXT": ORDER_TEXT, "MOST_ORDERS": MOST_ORDERS, "REASON": REASON, "MAX_GATES": gates.MAX_GATES,
        "DECIDE": DECIDE, "DIGEST": DIGEST, "NAME": NAME, "MOST_PRESETS": MOST_PRESETS,
        "DESCRIBED_THRUST": RobotSpec.max_thrust, "SERVOS": health.N_SERVOS,
        "FIRST_HEALTH": len(TOPICS) - len(HEALTH_TOPICS),
        **{name: getattr(health, name) for name in health.NUMBERS},
    }  # fmt: skip
    bounds = {
        "FIELD": FIELD, "LEAST_SPEED": SPEEDS[0], "MOST_SPEED": SPEEDS[1], "LEAST_HEIGHT": HEIGHTS[0],
        "MOST_HEIGHT": HEIGHTS[1], "STEEPEST": STEEPEST, "LEAST_SIZE": SIZES[0], "MOST_SIZE": SIZES[1],
        "LEAST_FORCE": FORCES[0], "MOST_FORCE": FORCES[1], "MOST_MASS": MOST_MASS, "MOST_FRICTION": MOST_FRICTION,
    }  # fmt: skip
    lines = [define(name, value) for name, value in sizes.items()]
    lines += [define("RATE_TOLERANCE", RATE_TOLERANCE)]
    lines += [define(f"ORDER_{name}", value, "m, m/s, rad, N or kg") for name, value in bounds.items()]
    lines += [define(f"MAP_{name}", getattr(gates, name), "m") for name in ("ROOM", "REACH", "FARTHEST")]
    lines += [define("MOST_EXCITATION", tuple(MOST_EXCITATION.values()), "rad, N")]
    lines += [define("FASTEST_EXCITATION", FASTEST_EXCITATION, "Hz")]
    lines = tables_last(lines)
    lines += [f'#define SP_LOG_MAGIC "{MAGIC}"', ""]
    lines += [line for each in ENUMERATIONS for line in enumeration(each)]
    names, rates = zip(*TOPICS.values(), strict=True)
    least, most, _ = zip(*(gates.POSSIBLE[kind] for kind in gates.KINDS), strict=True)
    lines += [
        "/* Names of the joints and of the gimbals. */",
        *array("char *const", "SP_JOINT_NAMES", [f'"{name}"' for name in JOINT_NAMES]),
        *array("char *const", "SP_GIMBAL_NAMES", [f'"{name}"' for name in GIMBAL_NAMES]),
        "/* Name, and expected rate [Hz], 0 for any, of each of sp_topic. */",
        *array("char *const", "SP_TOPIC_NAMES", [f'"{name}"' for name in names]),
        *array("double", "SP_TOPIC_RATES", rates),
        "/* Text of each of sp_fault and sp_manager_phase. */",
        *array("char *const", "SP_FAULT_WORDS", [f'"{words}"' for words in FAULTS.values()]),
        *array("char *const", "SP_MANAGER_PHASE_WORDS", [f'"{phase}"' for phase in PHASES]),
        "/* Name of each of sp_gate_kind, and its range of valid sizes [m], [rad]. */",
        *array("char *const", "SP_GATE_WORDS", [f'"{kind}"' for kind in gates.KINDS]),
        *c_only([define("GATE_LEAST", least), define("GATE_MOST", most)]),
        "",
    ]
    lines += [line for each in RUNNER_STRUCTS for line in struct(each)]
    return [*lines, *c_only([f"static const sp_limits SP_LIMITS = {initializer(Limits())};"])]


def runner_hash() -> str:
    """Return the digest of a compiled runner's interface: core, messages, structs, parameters' fields and sources."""
    return interface_digest("\n".join([interface_hash(), fields_header(), *_header_lines()]).encode(), RUNNER)


def runner_header() -> str:
    """Return the text of spidar_runner.h."""
    lines = [f'#define SP_RUNNER_INTERFACE "{runner_hash()}"', *_header_lines()]
    return header("SPIDAR_RUNNER", "messages, topics and structs of the runner.", lines, ('"spidar_structs.h"',))
