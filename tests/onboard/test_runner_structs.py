"""Pins that C and NumPy use the same layouts for the structs of core and runner, and the same numbers for words."""

import subprocess

import numpy as np
import pytest
from support.needs import needs_compiler

from spidar_gym.native import constants
from spidar_gym.native.codegen.header import constants_header, structs_header
from spidar_gym.native.compiler import compiler
from spidar_gym.native.core_structs import CORE_STRUCTS, core_layouts
from spidar_gym.native.structs import WORDS, border_structs
from spidar_gym.onboard import runner_structs
from spidar_gym.onboard.runner_header import runner_header
from spidar_gym.onboard.runner_structs import RUNNER_STRUCTS, log_layouts

pytestmark = needs_compiler
STRUCTS = (*border_structs(), *CORE_STRUCTS, *RUNNER_STRUCTS)


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """Return a function that evaluates expressions in C, all in one program."""
    folder = tmp_path_factory.mktemp("layout")
    for name, text in (("constants", constants_header()), ("structs", structs_header()), ("runner", runner_header())):
        (folder / f"spidar_{name}.h").write_text(text)

    def say(expressions):
        lines = "".join(f'    printf("%lld\\n", (long long)({each}));\n' for each in expressions)
        includes = '#include <stddef.h>\n#include <stdio.h>\n#include "spidar_runner.h"\n'
        (folder / "say.c").write_text(f"{includes}int main(void)\n{{\n{lines}}}\n")
        subprocess.run([*compiler(), "-I.", "say.c", "-o", "say"], cwd=folder, check=True)
        out = subprocess.run([folder / "say"], capture_output=True, text=True, check=True).stdout
        return dict(zip(expressions, map(int, out.split()), strict=True))

    return say


def test_every_struct_and_member_lies_where_the_compiler_puts_it(printed):
    expected = {}
    for struct in STRUCTS:
        layout = log_layouts()[struct.name]
        expected[f"sizeof(sp_{struct.name})"] = layout.itemsize
        for name in layout.names:
            member, offset = layout.fields[name][:2]
            expected[f"offsetof(sp_{struct.name}, {name})"] = offset
            expected[f"sizeof(((sp_{struct.name} *)0)->{name})"] = member.itemsize
    assert printed(list(expected)) == expected


def test_every_struct_is_described_once():
    names = [struct.name for struct in STRUCTS]
    assert len(names) == len(set(names))
    assert set(log_layouts()) == set(names)
    assert set(core_layouts()) == {struct.name for struct in (*border_structs(), *CORE_STRUCTS)}


def test_members_are_of_the_kind_that_c_has(printed):
    """Offsets and sizes alone would not detect a double that NumPy describes as two integers."""
    checks = {}
    for struct in STRUCTS:
        layout = log_layouts()[struct.name]
        for name in layout.names:
            member = layout[name]
            base = member.base
            if base.kind == "V":
                continue
            first = f"((sp_{struct.name} *)0)->{name}" + "[0]" * len(member.shape)
            c_type = {"f8": 1, "f4": 2, "i4": 3, "u1": 4}[base.kind + str(base.itemsize)]
            cases = "double: 1, float: 2, int32_t: 3, unsigned: 3, char: 4"
            checks[f"_Generic({first}, {cases})"] = c_type
    assert printed(list(checks)) == checks


def test_words_have_the_same_numbers(printed):
    expected = {}
    for each in (*constants.ENUMERATIONS.values(), *runner_structs.ENUMERATIONS):
        expected |= {f"SP_{each.prefix}{word}".upper(): number for word, number in each.numbers.items()}
    for (struct, field), words in WORDS.items():
        expected |= {f"SP_{struct}_{field}_{word}".upper(): k for k, word in enumerate(words)}
    assert printed(list(expected)) == expected


def test_layouts_are_aligned():
    assert all(np.dtype(layout).isalignedstruct for layout in log_layouts().values())
