"""MuJoCo for the engine: addresses of its functions and arrays, indices of the robot's parts, a thread pool."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import copy
import ctypes
import weakref
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.introspect import structs

from spidar_gym import turn
from spidar_gym.errors import SpidarError
from spidar_gym.native.engine_structs import (
    MAX_BODIES,
    MAX_GEOMS,
    MAX_MOVING,
    MAX_WARNING_BYTES,
    MUJOCO_STATE,
    N_BALLS,
    N_DOFS,
    OBJECT_STATE,
    engine_layouts,
)
from spidar_gym.robot import (
    GIMBAL_NAMES,
    GRAVITY,
    JOINT_NAMES,
    N_LEGS,
    N_LINKS,
    N_ROTORS,
    PEG_SITES,
    ROBOT,
    ROTOR_SITES,
    RobotSpec,
)
from spidar_gym.sim.air import LINK_STATIONS
from spidar_gym.sim.ground import BOXES, TILES
from spidar_gym.sim.object import GEOM_TYPES, unit_patches
from spidar_gym.sim.scene import quieten, scene
from spidar_gym.sim.sensors import ENCODER_STEPS

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
"""Parts of an mjData that belong to a robot's state."""
FUNCTIONS = (
    "mj_step", "mj_forward", "mj_setConst", "mj_resetData", "mj_getState", "mj_setState", "mj_contactForce",
    "mju_eig3",
)  # fmt: skip
"""MuJoCo's functions in the order of `sp_mujoco`, before the numbers."""
DATA = (
    "qpos", "qvel", "act", "ctrl", "actuator_force", "qfrc_applied", "qfrc_actuator", "qfrc_bias", "xpos", "xmat",
    "cvel", "cdof", "subtree_com", "geom_xpos", "geom_xmat",
)  # fmt: skip
"""Arrays of the mjData in the order of `sp_sim`, between time and contacts."""
MODEL = ("actuator_gear", "actuator_ctrlrange", "actuator_actrange", "actuator_dynprm", "actuator_biasprm",
         "actuator_forcerange", "dof_frictionloss", "dof_damping", "body_mass", "body_inertia", "body_ipos",
         "body_iquat", "geom_friction", "geom_pos", "geom_quat", "geom_size", "geom_rbound", "geom_aabb",
         "geom_sameframe", "body_geomnum", "geom_type")  # fmt: skip
"""Arrays of the mjModel in the order of `sp_sim`, before its flags."""
DERIVED = ("actuator_acc0", "body_invweight0", "body_subtreemass", "bvh_aabb", "cam_poscom0", "dof_M0",
           "dof_invweight0", "dof_length")  # fmt: skip
"""Arrays of the mjModel that MuJoCo derives from these."""
SHAPES = ("geom_size", "geom_rbound", "geom_aabb", "body_geomnum")
"""Arrays of the mjModel that boxes change besides their poses; unused ones are no part of the world's body."""
FREE = (*(name for name in MODEL if name != "actuator_forcerange"), *DERIVED, "body_sameframe")
"""Arrays of the mjModel that differ between robots; torque limits are written whenever a robot is loaded."""
BOXED = tuple(name for name in FREE if name not in ("geom_type", "body_sameframe"))
"""Arrays that differ between robots without an object."""
OWN = tuple(name for name in BOXED if name not in SHAPES)
"""Arrays that differ between robots on a floor without boxes."""
FLAT = tuple(name for name in OWN if name not in ("bvh_aabb", "geom_pos", "geom_quat", "geom_sameframe"))
"""Arrays that differ between robots on a floor plane that is the same for all."""
_VALID = "mujoco>=4.0,<5 from PyPI"
_SIZES = {"int": 4, "mjtNum": 8, "size_t": 8, "uintptr_t": 8, "mjtSize": 8, "uint64_t": 8, "mjtBool": 1, "float": 4}


def library() -> ctypes.CDLL:
    """Return MuJoCo's library, the one that its Python bindings have loaded."""
    folder = Path(mujoco.__file__).parent
    found = sorted([*folder.glob("libmujoco.so*"), *folder.glob("libmujoco*.dylib"), *folder.glob("mujoco.dll")])
    if not found:
        raise SpidarError(f"no library of MuJoCo {mujoco.__version__} beside its Python module; valid: {_VALID}")
    return ctypes.CDLL(str(found[0]))


def _function(own: ctypes.CDLL, name: str) -> Any:  # noqa: ANN401 - of ctypes
    """Return a function of MuJoCo (`SpidarError` where it is missing)."""
    try:
        return getattr(own, name)
    except AttributeError:
        raise SpidarError(f"MuJoCo {mujoco.__version__} has no {name}; valid: {_VALID}") from None


@cache
def functions() -> np.ndarray:
    """Return `sp_mujoco`: addresses of MuJoCo's functions, numbers of its enumerations."""
    own, numbers = library(), (int(STATE), int(mujoco.mjtDisableBit.mjDSBL_CONTACT))
    addresses = [ctypes.cast(_function(own, name), ctypes.c_void_p).value for name in FUNCTIONS]
    return np.array([*addresses, *numbers], np.uint64)


def _extent(kind: Any) -> tuple[int, int]:  # noqa: ANN401 - a type of MuJoCo's introspection
    """Return size and alignment of a member in bytes, by C's rules."""
    name = type(kind).__name__
    if name == "PointerType":
        return 8, 8
    if name == "ArrayType":
        size, align = _extent(kind.inner_type)
        return size * int(np.prod(kind.extents)), align
    if name == "AnonymousStructDecl" or kind.name in structs.STRUCTS:
        fields = kind.fields if name == "AnonymousStructDecl" else structs.STRUCTS[kind.name].fields
        return _place(fields)[1:]
    return _SIZES[kind.name], _SIZES[kind.name]


def _place(fields: Any) -> tuple[dict[str, int], int, int]:  # noqa: ANN401 - of MuJoCo's introspection
    """Return the offset of each member, and size and alignment of the struct in bytes."""
    at, widest, offsets = 0, 1, {}
    for field in fields:
        size, align = _extent(field.type)
        at = -(-at // align) * align
        offsets[field.name] = at
        at, widest = at + size, max(widest, align)
    return offsets, -(-at // widest) * widest, widest


def member_offsets(struct: str) -> dict[str, int]:
    """Return the byte offset of each member of a struct of MuJoCo."""
    return _place(structs.STRUCTS[struct].fields)[0]


@cache
def offsets() -> dict[str, int]:
    """Return byte offsets of members of MuJoCo's structs whose addresses the Python bindings do not provide."""
    data, model, option = (member_offsets(struct) for struct in ("mjData", "mjModel", "mjOption"))
    contact, size, _ = _place(structs.STRUCTS["mjContact"].fields)
    warnings = next(field.type for field in structs.STRUCTS["mjData"].fields if field.name == "warning")
    return {
        "time": data["time"], "ncon": data["ncon"], "contact": data["contact"], "frame": contact["frame"],
        "warning": data["warning"], "disableflags": model["opt"] + option["disableflags"], "geom": contact["geom"],
        "stride": size, "warning_bytes": _extent(warnings)[0],
    }  # fmt: skip


def _number(address: int, kind: Any = ctypes.c_int32) -> int | float:  # noqa: ANN401 - of ctypes
    """Read the number at an address."""
    return kind.from_address(address).value


@cache
def check() -> None:
    """Check the offsets against the Python bindings (`SpidarError` where MuJoCo has another layout)."""
    otherwise = SpidarError(f"MuJoCo {mujoco.__version__} is laid out in another way; valid: {_VALID}")
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1])
    ball = spec.worldbody.add_body(pos=[0, 0, 0.05])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], mass=1)
    model = spec.compile()
    data = mujoco.MjData(model)
    try:
        at = offsets()
    except (KeyError, StopIteration):  # a missing member or type
        raise otherwise from None
    data.time = 12.5
    mujoco.mj_forward(model, data)
    contact = int(_number(data._address + at["contact"], ctypes.c_uint64)) + at["geom"]
    model.opt.disableflags = 1234567
    data.warning.number[-1] = 7654321  # the last member of the last element
    if (
        _number(data._address + at["time"], ctypes.c_double) != 12.5
        or _number(data._address + at["ncon"]) != data.ncon != 1
        or data.contact.geom.ctypes.data != contact
        or [_number(contact), _number(contact + 4)] != data.contact.geom[0].tolist()
        or _number(model._address + at["disableflags"]) != 1234567
        or not at["warning_bytes"] <= MAX_WARNING_BYTES
        or _number(data._address + at["warning"] + at["warning_bytes"] - 4) != 7654321
        or mujoco.mj_stateSize(scene(visual=False), STATE) != MUJOCO_STATE
        or mujoco.mj_stateSize(scene(visual=False, free=True), STATE) != MUJOCO_STATE + OBJECT_STATE
    ):
        raise otherwise


class Simulation:
    """An mjModel and an mjData with the addresses of their arrays, into which a thread loads a robot."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Copy a model of `scene(visual=False, …)`."""
        check()
        self.model = copy.copy(model)
        self.data = mujoco.MjData(self.model)
        quieten(self.data)
        at, model_at, data_at = offsets(), self.model._address, self.data._address
        self._functions = functions()  # kept alive for its address in the record
        self.record = np.array(
            [
                self._functions.ctypes.data, model_at, data_at, data_at + at["time"],
                *(getattr(self.data, name).ctypes.data for name in DATA),
                data_at + at["ncon"], data_at + at["contact"], data_at + at["warning"],
                *(getattr(self.model, name).ctypes.data for name in MODEL),
                model_at + at["disableflags"], at["stride"], at["geom"], at["frame"],
                at["warning_bytes"],
            ],
            np.uint64,
        )  # fmt: skip
        """`sp_sim`."""

    def pieces(self, names: tuple[str, ...]) -> np.ndarray:
        """Return `sp_piece` of arrays of the model: address, bytes, offset in a robot's copy; shape (k, 3)."""
        arrays = [getattr(self.model, name) for name in names]
        ends = np.cumsum([-(-array.nbytes // 8) * 8 for array in arrays])
        return np.array(
            [(a.ctypes.data, a.nbytes, end - -(-a.nbytes // 8) * 8) for a, end in zip(arrays, ends, strict=True)],
            np.int64,
        )


@lru_cache(maxsize=64)
def world(uneven: bool, boxed: bool = False, robot: RobotSpec = ROBOT, free: bool = False) -> np.ndarray:
    """Return `sp_world`, read only: a robot over a floor with tiles, with boxes, or plain, without or with an object.

    Raises:
        SpidarError: For a robot with too many parts, or with actuators in another order.
    """
    model = scene(visual=False, uneven=uneven, boxed=boxed, robot=robot, free=free)
    body, geom = (lambda name: model.body(name).id), (lambda name: model.geom(name).id)
    record = np.zeros((), engine_layouts()["world"])
    servos = [model.actuator(name).id for name in (*ROTOR_SITES, *JOINT_NAMES, *GIMBAL_NAMES)]
    moving = np.flatnonzero(model.geom_contype == 0)
    bodies, dofs = model.nbody - free, model.nv - 6 * free
    fits = bodies <= MAX_BODIES and len(moving) <= MAX_MOVING and model.ngeom <= MAX_GEOMS and dofs == N_DOFS
    if not fits or servos != list(range(len(servos))) or model.actuator_actadr.tolist() != servos:
        raise SpidarError(
            f"the robot has {bodies} bodies, {len(moving)} geoms, {dofs} degrees of freedom; valid: up to "
            f"{MAX_BODIES}, {MAX_MOVING}, just {N_DOFS}; thrusts, joints, vectoring angles in this order"
        )
    names = [f"foot{leg}" for leg in range(1, N_LEGS + 1)] + list(PEG_SITES)
    balls, modules = [geom(name) for name in names], [body(f"gimbal{i}_pitch_module") for i in range(1, N_ROTORS + 1)]
    cylinders = (model.geom_conaffinity > 0) & (model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER)
    ducts = [g for g in range(model.ngeom) if cylinders[g] and model.geom_bodyid[g] in modules]
    joints = [model.joint(name) for name in (*JOINT_NAMES, *GIMBAL_NAMES)]
    parts = ("junction{}", "link{}", "gimbal{}_roll_module", "gimbal{}_pitch_module")
    kinds, touches, feet = np.full(MAX_GEOMS, -1), np.zeros(MAX_GEOMS), np.zeros(MAX_GEOMS)
    kinds[balls], kinds[ducts] = np.arange(N_BALLS), N_BALLS
    touches[: model.ngeom], feet[balls[:N_LEGS]] = model.geom_conaffinity > 0, 1
    if free:
        touches[geom("object")] = 0
    data = mujoco.MjData(model)
    start = np.zeros(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, start, STATE)
    values = {
        "bodies": bodies, "torso": body("torso"), "floor": geom("floor"), "geoms": model.ngeom,
        "moving": len(moving), "module_body": modules, "link_body": [body(f"link{i}") for i in range(1, N_LINKS + 1)],
        "part_body": [body(part.format(i)) for i in range(1, N_LINKS + 1) for part in parts],
        "body_parent": model.body_parentid[:bodies], "body_dofadr": model.body_dofadr[:bodies],
        "body_dofnum": model.body_dofnum[:bodies],
        "joint_qpos": [joint.qposadr[0] for joint in joints], "joint_dof": [joint.dofadr[0] for joint in joints],
        "ball": balls, "ball_body": model.geom_bodyid[balls], "duct": ducts, "geom": moving, "geom_kind": kinds,
        "geom_touches": touches, "geom_is_foot": feet,
        "tile": [geom(f"tile{i}_{j}") if uneven else -1 for i in range(TILES) for j in range(TILES)],
        "box": [geom(f"box{k}") if boxed else -1 for k in range(BOXES)],
        "object": body("object") if free else -1, "object_geom": geom("object") if free else -1,
        "object_type": GEOM_TYPES, "patch": unit_patches(),
        "mass": model.body_mass[:bodies], "inertia": model.body_inertia[:bodies], "com": model.body_ipos[:bodies],
        "torso_axes": model.body_iquat[body("torso")],
        "geom_reach": model.geom_rbound[moving],
        "ball_radius": [robot.foot_radius] * N_LEGS + [robot.peg_radius] * len(PEG_SITES),
        "duct_radius": model.geom_size[ducts, 0], "duct_half": model.geom_size[ducts, 1],
        "weight": robot.weight, "max_joint_torque": robot.max_joint_torque,
        "propeller_radius": robot.propeller_radius, "duct_offset_y": robot.duct_offset_y, "duct_z": robot.duct_z[0],
        "torso_radius": robot.torso_radius, "torso_height": robot.torso_height,
        "link_scale": [
            robot.pitch_to_foot / ROBOT.pitch_to_foot if i % 2 else robot.pitch_to_yaw / ROBOT.pitch_to_yaw
            for i in range(N_LINKS)
        ],
        "battery_share": robot.max_thrust / ROBOT.max_thrust,
        "vectoring_kd": -model.actuator_biasprm[servos[-1], 2],
        "link_station": [x for x, _ in LINK_STATIONS], "link_width": [width for _, width in LINK_STATIONS],
        "imu_position_b": robot.flight_controller, "gravity": GRAVITY, "encoder_step": ENCODER_STEPS, "start": start,
    }  # fmt: skip
    for name, value in values.items():
        if np.ndim(value):
            record[name][: len(value)] = value
        else:
            record[name] = value
    record.setflags(write=False)
    return record


def _delete(own: ctypes.CDLL, batch: int, process: int) -> None:
    """Stop a pool's threads, except in a forked process, which has none."""
    if turn.process == process:
        own.mjb_deleteBatch(ctypes.c_void_p(batch))


class Pool:
    """MuJoCo's thread pool for jobs on robots; an error of MuJoCo in one job does not affect the others."""

    def __init__(self, robots: int, threads: int) -> None:
        """Start the threads."""
        own = library()
        for name in ("mjb_makeBatch", "mjb_apply", "mjb_status", "mjb_error", "mjb_deleteBatch"):
            _function(own, name)
        own.mjb_makeBatch.restype = ctypes.c_void_p
        # The pool simulates an empty world; the engine has its own simulations.
        self._model = mujoco.MjSpec().compile()
        self._data = mujoco.MjData(self._model)
        settings, words = (ctypes.c_int * 2)(threads, 0), ctypes.create_string_buffer(256)
        made = own.mjb_makeBatch(ctypes.c_void_p(self._model._address), robots, settings, words, len(words))
        if not made:
            raise SpidarError(
                f"MuJoCo makes no pool of threads: {words.value.decode()}; valid: fewer robots or threads"
            )
        self.address = int(made)
        self.apply = int(ctypes.cast(own.mjb_apply, ctypes.c_void_p).value or 0)
        own.mjb_status.restype, own.mjb_error.restype = ctypes.POINTER(ctypes.c_int), ctypes.c_char_p
        self._status = np.ctypeslib.as_array(own.mjb_status(ctypes.c_void_p(made)), (robots,))
        self._library = own
        # Free the pool of an environment that was not closed; not at the end of the process.
        self.process = turn.process
        """Process in which the threads run."""
        self._release = weakref.finalize(self, _delete, own, made, self.process)
        self._release.atexit = False

    @property
    def failed(self) -> np.ndarray:
        """Indices of the robots in whose last job MuJoCo failed."""
        return np.flatnonzero(self._status)

    def words(self, robot: int) -> str:
        """Return MuJoCo's error message for a robot."""
        return self._library.mjb_error(ctypes.c_void_p(self.address), robot).decode()

    def close(self) -> None:
        """Stop the threads; a second call has no effect."""
        self._release()
        self.address = 0
