"""Pins that the runner's digest covers its structs and sources, and that a runner with others is refused in a line."""

import dataclasses
import shutil
import subprocess

import pytest
from support.needs import needs_compiler
from support.runner import compile_, export, said

from spidar_gym.onboard import runner_header
from spidar_gym.onboard.runner_header import runner_hash
from spidar_gym.onboard.runner_structs import RUNNER, RUNNER_STRUCTS
from spidar_gym.sitl.link_socket import SocketLink

pytestmark = needs_compiler
MISSION = "flight tuned\n"


def lengthened(*names):
    """Return the runner's structs, some with an additional member."""
    return [
        dataclasses.replace(each, rows=(*each.rows, ("more", "f8", (), ""))) if each.name in names else each
        for each in RUNNER_STRUCTS
    ]


@pytest.mark.parametrize("struct", RUNNER_STRUCTS, ids=lambda struct: struct.name)
def test_a_member_more_in_a_struct_of_the_runner_is_another_interface(monkeypatch, struct):
    before = runner_hash()
    monkeypatch.setattr(runner_header, "RUNNER_STRUCTS", lengthened(struct.name))
    assert runner_hash() != before


def test_another_source_of_the_runner_or_another_word_is_another_interface(monkeypatch, tmp_path):
    found = {runner_hash()}
    monkeypatch.setattr(runner_header, "TOPICS", {**runner_header.TOPICS, "joints": ("joint_states", 51.0)})
    found.add(runner_hash())
    shutil.copytree(RUNNER, tmp_path / "runner")
    monkeypatch.setattr(runner_header, "RUNNER", tmp_path / "runner")
    found.add(runner_hash())
    for name in ("loop.c", "runner.h", "ros1.cpp"):
        with (tmp_path / "runner" / name).open("a") as file:
            file.write("\n")
        found.add(runner_hash())
    assert len(found) == 5, "two texts of topics, and three changed sources"


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """Compile a runner whose greeting and answer have an additional member."""
    folder = tmp_path_factory.mktemp("other") / "onboard"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner_header, "RUNNER_STRUCTS", lengthened("sim_hello", "loop_output"))
        export(folder)
    return compile_(folder, folder.parent / "runner", "-O0")


def test_a_runner_of_other_structs_is_refused_in_a_line(other, tmp_path):
    (tmp_path / "mission").write_text(MISSION)
    link = SocketLink()
    command = [str(other), "sim", link.place, str(tmp_path / "mission")]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    link.accept()
    try:
        _, words = program.communicate(timeout=20)
    finally:
        link.close()
        program.kill()
    line = "runner: the simulator has another interface; valid: one of this export\n"
    assert (program.returncode, words) == (2, line)


def test_a_runner_of_other_structs_refuses_the_log_of_this_one(other, hover, tmp_path):
    done = said(other, "replay", hover.path, tmp_path / "out")
    line = "runner: the log is of another interface; valid: one of this export\n"
    assert (done.returncode, done.stderr) == (2, line)
