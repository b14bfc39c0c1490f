"""Pins the access to MuJoCo: an unknown layout is refused in one line, before anything is read or written."""

import copy
import ctypes
import weakref

import mujoco
import pytest

from spidar_gym.errors import SpidarError, StaleAssetError
from spidar_gym.native import library as spidar_library
from spidar_gym.native import mujoco as door
from spidar_gym.native.engine_binding import Engine
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.scene import scene

ONE_LINE = r"^MuJoCo [\w.]+ {}; valid: mujoco>=4\.0,<5 from PyPI$"


@pytest.fixture(autouse=True)
def forget():
    """Clear what is cached about MuJoCo once per process."""

    def clear():
        for known in (door.check, door.offsets, door.functions, door.world):
            known.cache_clear()

    clear()
    yield clear
    clear()


def build():
    return Engine("plant", PlantConfig(), 2, 1, alike=True)


def test_an_engine_keeps_mujocos_addresses_when_the_caches_are_cleared(forget):
    """Its record holds the address of the table of MuJoCo's functions, which must not be freed."""
    engine = build()
    known = weakref.ref(door.functions())
    forget()
    assert known() is not None
    engine.close()


def test_members_are_where_the_bindings_have_them():
    data, model = mujoco.MjData(scene(visual=False)), scene(visual=False)
    for struct, owner, names in (("mjData", data, door.DATA), ("mjModel", model, door.MODEL)):
        at = door.member_offsets(struct)
        for name in names:
            address = ctypes.c_uint64.from_address(owner._address + at[name]).value
            assert address == getattr(owner, name).ctypes.data, name


@pytest.mark.parametrize("struct", ["mjData", "mjModel", "mjContact", "mjOption"])
@pytest.mark.parametrize("change", ["one more at the front", "gone", "of an unknown type"])
def test_another_layout_is_refused(monkeypatch, struct, change):
    other = copy.deepcopy(door.structs.STRUCTS[struct])
    wanted = {"mjData": "ncon", "mjModel": "opt", "mjContact": "geom", "mjOption": "disableflags"}[struct]
    k = next(k for k, field in enumerate(other.fields) if field.name == wanted)
    fields = list(other.fields)
    if change == "gone":
        del fields[k]
    elif change == "of an unknown type":
        known = next(field for field in fields if type(field.type).__name__ == "ValueType")
        fields[0] = copy.deepcopy(known)
        object.__setattr__(fields[0].type, "name", "mjtUnheardOf")
    else:
        fields.insert(0, fields[k])
    object.__setattr__(other, "fields", tuple(fields))
    monkeypatch.setattr(door.structs, "STRUCTS", {**door.structs.STRUCTS, struct: other})
    with pytest.raises(SpidarError, match=ONE_LINE.format("is laid out in another way")):
        build()


@pytest.mark.parametrize("name", [*door.FUNCTIONS, "mjb_apply", "mjb_status"])
def test_a_missing_function_is_named(monkeypatch, name):
    class Other(ctypes.CDLL):
        def __getattr__(self, wanted):
            if wanted == name:
                raise AttributeError(wanted)
            return super().__getattr__(wanted)

    path = door.library()._name
    monkeypatch.setattr(door, "library", lambda: Other(path))
    with pytest.raises(SpidarError, match=ONE_LINE.format(f"has no {name}")):
        build()


def test_another_state_is_refused(monkeypatch):
    monkeypatch.setattr(door, "MUJOCO_STATE", door.MUJOCO_STATE + 1)
    with pytest.raises(SpidarError, match=ONE_LINE.format("is laid out in another way")):
        build()


def test_another_robot_is_refused(monkeypatch):
    """The C code assumes largest numbers of bodies and geoms, and an order of the actuators."""
    for name, value in (("MAX_BODIES", 3), ("MAX_MOVING", 3), ("MAX_GEOMS", 3), ("N_DOFS", 7)):
        with monkeypatch.context() as patch:
            patch.setattr(door, name, value)
            with pytest.raises(SpidarError, match=r"^the robot has \d+ bodies, [^\n]*; valid: [^\n]*$"):
                door.world(False)
    with monkeypatch.context() as patch:
        patch.setattr(door, "JOINT_NAMES", door.JOINT_NAMES[::-1])
        with pytest.raises(SpidarError, match=r"in this order$"):
            door.world(False)


def test_a_library_for_another_robot_is_refused(monkeypatch):
    monkeypatch.setattr(spidar_library, "expected_digest", lambda: "of another robot")
    with pytest.raises(StaleAssetError, match=r"^[^\n]*other C, structs or numbers[^\n]*spidar assets[^\n]*$"):
        build()
