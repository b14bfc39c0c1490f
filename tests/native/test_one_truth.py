"""Pins that a number, word or struct that Python and C share is defined once, in Python; C uses its name."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import spidar_gym
from spidar_gym.native.codegen.header import CORE
from spidar_gym.native.constants import ENUMERATIONS, NUMBERS, SIZES
from spidar_gym.native.engine_structs import ENGINE_NUMBERS, ENGINE_SIZES
from spidar_gym.onboard import runner_structs
from spidar_gym.onboard.export import ONBOARD
from spidar_gym.onboard.runner_structs import MAGIC, TOPICS, log_layouts
from spidar_gym.robot import GRAVITY, RobotSpec

PACKAGE = Path(spidar_gym.__file__).parent
ENGINE = CORE.parent / "engine"
SOURCES = {
    path.name: path for path in (*CORE.glob("*.[ch]"), *ENGINE.glob("*.[ch]"), *(ONBOARD / "runner").glob("*.[ch]*"))
}
CODE = {
    name: re.sub(r"/\*.*?\*/|\"(?:\\.|[^\"\\])*\"", " ", path.read_text(encoding="utf-8"), flags=re.S)
    for name, path in SOURCES.items()
}
"""C without comments and strings."""
OF_ENGINE = {path.name for path in ENGINE.glob("*.c")}
BESIDE_ENGINE = "\n".join(code for name, code in CODE.items() if not (ENGINE / name).exists())
EVERYDAY = {0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 8.0}
"""Common numbers of formulas and indices."""
UNITS, NOTHING = {60.0, 1000.0, 3600.0}, 1e-5
"""Unit conversions; smaller numbers than `NOTHING` only prevent divisions by zero."""
BY_CHANCE = {"air.c": {0.7, 1.2, 1.3}, "object.c": {0.4}}
"""Numbers in C that equal unrelated ones in Python."""
OF_TASKS = {"crawl_robot.c": {1e-3, 0.12}}
"""The only numbers of tasks that are typed in both C and Python."""
TABLE = {
    f"SP_{prefix}{name}".upper(): (place, name, getattr(place, name))
    for prefix, place, names in (*NUMBERS, *ENGINE_NUMBERS)
    for name in names
}


OF_CORE = {f"SP_{prefix}{name}".upper() for prefix, _, names in NUMBERS for name in names}


def numbers_of(code):
    """Return the values of the numeric literals of C."""
    words = re.findall(r"(?<![\w.])(?:\d+\.?\d*(?:[eE][-+]?\d+)?)(?![\w.])", code)
    return [float(word) for word in words]


def floats_of(code):
    """Return the values of the literals with a point or an exponent."""
    return [float(word) for word in re.findall(r"(?<![\w.])\d+(?:\.\d*(?:[eE][-+]?\d+)?|[eE][-+]?\d+)(?![\w.])", code)]


def uses(name):
    return [file for file, code in CODE.items() if re.search(rf"\b{name}\b", code)]


@pytest.mark.parametrize("name", [*TABLE, *(f"SP_{name}" for name in (*SIZES, *ENGINE_SIZES))])
def test_every_generated_name_is_used_and_never_defined_by_hand(name):
    assert uses(name), "unused, or its value is typed instead of its name"
    assert not re.search(rf"#define {name}\b", "\n".join(CODE.values()))
    short = {name.removeprefix("SP_"), *([TABLE[name][1].upper()] if name in OF_CORE else [])}
    assert not re.search(rf"#define (?:{'|'.join(short)})\b", BESIDE_ENGINE)  # the engine has short names for rewards


@pytest.mark.parametrize("name", [name for name, (_, _, value) in TABLE.items() if not {*np.ravel(value)} <= EVERYDAY])
def test_its_value_is_not_typed_again_in_the_files_that_use_it(name):
    values = {*np.ravel(TABLE[name][2]).tolist()} - EVERYDAY
    assert [file for file in uses(name) if values & {*numbers_of(CODE[file])}] == []


def test_the_engine_types_no_number_of_the_robot_of_the_world_or_of_a_task_again():
    folders = [PACKAGE / name for name in ("robot", "model", "sim", "control", "tasks", "envs")]
    typed = (
        {
            node.value
            for folder in folders
            for path in folder.rglob("*.py")
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(node, ast.Constant) and isinstance(node.value, float)
        }
        - EVERYDAY
        - UNITS
    )
    again = {name: {x for x in typed & {*floats_of(CODE[name])} if x >= NOTHING} for name in OF_ENGINE}
    assert {name: found for name, found in again.items() if found} == BY_CHANCE | OF_TASKS


def test_gravity_and_the_largest_thrust_are_typed_once():
    places = [
        path.name
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant)
        and node.value in (GRAVITY, RobotSpec.max_thrust)
        and type(node.value) is float
    ]
    assert places == ["spec.py", "spec.py"]


def test_c_describes_no_struct_and_no_word_that_python_describes():
    everything = "\n".join(CODE.values())
    assert not set(re.findall(r"\}\s*sp_(\w+);", everything)) & set(log_layouts())
    assert not re.search(r"\benum\b", BESIDE_ENGINE)
    words = [
        f"SP_{each.prefix}{word}".upper()
        for each in (*ENUMERATIONS.values(), *runner_structs.ENUMERATIONS)
        for word in each.words
    ]
    assert len(words) == len(set(words))
    assert not re.search(rf"#define ({'|'.join(words)})\b", everything)


def test_the_contract_types_no_topic_and_no_file_the_magic_of_a_log():
    strings = re.findall(r"\"((?:\\.|[^\"\\])*)\"", SOURCES["contract.c"].read_text(encoding="utf-8"))
    assert not set(strings) & {name for name, _ in TOPICS.values()}
    assert not [name for name, path in SOURCES.items() if MAGIC in path.read_text(encoding="utf-8")]


def assigned(tree):
    """Yield the names that a module assigns literals to, with the values."""
    for node in tree.body:
        if not isinstance(node, ast.Assign):
            continue
        for target in node.targets:
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            for name, value in zip(names, values, strict=False):
                if isinstance(name, ast.Name) and isinstance(value, ast.Constant):
                    yield name.id, value.value


def test_no_other_module_gives_such_a_name_the_same_value():
    homes = {
        (name, value): place.__name__
        for place, name, value in TABLE.values()
        if not isinstance(place, type) and np.ndim(value) == 0
    }
    found = []
    for path in PACKAGE.rglob("*.py"):
        module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts)
        for name, value in assigned(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(value, int | float) and homes.get((name.lstrip("_"), value), module) != module:
                found.append((module, name))
    assert found == []


def test_every_number_has_one_name():
    places = [(place, name) for place, name, _ in TABLE.values()]
    assert len(places) == len(set(places))
    assert not set(TABLE) & {f"SP_{name}" for name in SIZES}
