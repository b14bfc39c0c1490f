"""The robot's numbers for the onboard core: kinematic tree, limits, names, hashes; presets beside them."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import hashlib
from dataclasses import replace

import numpy as np
import pinocchio as pin

from spidar_gym.control.estimator import EstimatorConfig
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.control.structs import hex_float, initializer, interface_hash
from spidar_gym.deploy.solvers import ONBOARD_ITERATIONS
from spidar_gym.description import mjcf_path
from spidar_gym.robot import GIMBAL_NAMES, GRAVITY, JOINT_NAMES, N_JOINTS, N_ROTORS, ROBOT


def _numbers(values: object) -> str:
    return ", ".join(hex_float(x) for x in np.asarray(values, float).reshape(-1).tolist())


def model_header() -> str:
    """spidar_model.h."""
    model = pin.buildModelFromMJCF(str(mjcf_path()))
    names = list(model.names)
    ids = [model.getJointId(name) for name in (*JOINT_NAMES, *GIMBAL_NAMES)]
    # The torso is Pinocchio's root joint; every other body follows its parent.
    order = sorted(set(range(1, model.njoints)))
    place = {joint: k for k, joint in enumerate(order)}
    rows = []
    for joint in order:
        inertia, placement = model.inertias[joint], model.jointPlacements[joint]
        root = place[joint] == 0
        axis = np.zeros(3) if root else _axis(model, joint)
        index = 0 if root else ids.index(joint)
        rotation = np.eye(3) if root else placement.rotation
        position = np.zeros(3) if root else placement.translation
        parent = 0 if root else place[model.parents[joint]]
        rows.append(
            f"    {{{parent}, {index}, {{{_numbers(rotation)}}}, {{{_numbers(position)}}}, {{{_numbers(axis)}}},\n"
            f"     {hex_float(inertia.mass)}, {{{_numbers(inertia.lever)}}}, {{{_numbers(inertia.inertia)}}}}}, "
            f"/* {names[joint]} */"
        )
    joints = [place[i] for i in ids[:N_JOINTS]]
    links = [place[model.getJointId(f"joint{i}_pitch")] for i in range(1, N_ROTORS + 1)]
    rotors = [place[model.getJointId(f"gimbal{i}_pitch")] for i in range(1, N_ROTORS + 1)]
    constants = {
        "GRAVITY": GRAVITY, "TOTAL_MASS": ROBOT.total_mass, "WEIGHT": ROBOT.weight,
        "HOVER_THRUST": ROBOT.hover_thrust, "MAX_THRUST": ROBOT.max_thrust,
        "MAX_JOINT_TORQUE": ROBOT.max_joint_torque, "JOINT_LIMIT": ROBOT.joint_limit, "JOINT_KP": ROBOT.joint_kp,
        "MAX_VECTORING_SPEED": ROBOT.max_vectoring_speed, "YAW_AXIS_XY": ROBOT.yaw_axis_xy,
        "YAW_AXIS_RADIUS": ROBOT.yaw_axis_radius, "YAW_AXIS_Z": ROBOT.yaw_axis_z,
        "YAW_TO_PITCH": ROBOT.yaw_to_pitch, "PITCH_TO_YAW": ROBOT.pitch_to_yaw,
        "PITCH_TO_FOOT": ROBOT.pitch_to_foot, "FOOT_RADIUS": ROBOT.foot_radius, "PEG_DEPTH": ROBOT.peg_depth,
    }  # fmt: skip
    digest = hashlib.sha256(mjcf_path().read_bytes()).hexdigest()
    lines = [
        "/* Generated from the robot's description: kinematic tree, limits, names. */",
        "#ifndef SPIDAR_MODEL_H",
        "#define SPIDAR_MODEL_H",
        "",
        "#include <stdint.h>",
        "",
        f'#define SP_MODEL_SHA256 "{digest}"',
        f'#define SP_INTERFACE "{interface_hash()}"',
        *(f"#define SP_{name} {hex_float(value)} /* {value!r} */" for name, value in constants.items()),
        "",
        f"static const double SP_FLIGHT_CONTROLLER[3] = {{{_numbers(ROBOT.flight_controller)}}};",
        "",
        f"#define SP_BODIES {len(order)}",
        "/* A body and the joint that carries it: 0 … 15 are joints, from 16 on vectoring angles. */",
        "typedef struct {",
        "    int32_t parent, joint;",
        "    double rotation[9], position[3], axis[3]; /* of the joint in its parent */",
        "    double mass, com[3], inertia[9];          /* in the body's own axes; inertia about its CoG */",
        "} sp_body;",
        "static const sp_body SP_TREE[SP_BODIES] = {",
        *rows,
        "};",
        f"static const int32_t SP_JOINT_BODY[16] = {{{', '.join(map(str, joints))}}};",
        f"static const int32_t SP_LINK_BODY[8] = {{{', '.join(map(str, links))}}};",
        f"static const int32_t SP_ROTOR_BODY[8] = {{{', '.join(map(str, rotors))}}};",
        "static const char *const SP_JOINT_NAMES[16] = {",
        *(f'    "{name}",' for name in JOINT_NAMES),
        "};",
        "static const char *const SP_GIMBAL_NAMES[16] = {",
        *(f'    "{name}",' for name in GIMBAL_NAMES),
        "};",
        "",
        "#endif",
        "",
    ]
    return "\n".join(lines)


def _axis(model: object, joint: int) -> np.ndarray:
    """Axis of a revolute joint in its own frame."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    J = pin.computeJointJacobian(model, data, pin.neutral(model), joint)
    return np.round(J[3:, model.idx_vs[joint]], 12) + 0.0


def presets_header() -> str:
    """spidar_presets.h: the presets, with the iteration cap that a tick on the robot has time for."""
    lines = ["/* Generated: the presets, the very numbers of the simulator. */", "#ifndef SPIDAR_PRESETS_H",
             "#define SPIDAR_PRESETS_H", "", '#include "spidar_structs.h"', ""]  # fmt: skip
    for kind, presets in (("controller", PRESETS), ("crawler", CRAWL_PRESETS)):
        for name, config in presets.items():
            capped = replace(config, allocator=replace(config.allocator, max_iter=ONBOARD_ITERATIONS))
            lines += [f"static const sp_{kind}_config SP_PRESET_{name.upper()} = {initializer(capped)};", ""]
        table = " ".join(f"X({name}, SP_PRESET_{name.upper()})" for name in presets)
        lines += [f"#define SP_{kind.upper()}_PRESETS(X) {table}",
                  f'#define SP_{kind.upper()}_NAMES "{", ".join(presets)}"', ""]  # fmt: skip
    lines += [f"static const sp_estimator_config SP_ESTIMATOR = {initializer(EstimatorConfig())};", "", "#endif", ""]
    return "\n".join(lines)
