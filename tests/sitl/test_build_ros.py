"""Pins that the exported runner builds as the robot's distributions of ROS 1 would build it, with Debian's ROS 1."""

import os
import shutil
import subprocess

import pytest
from support.needs import marked, needs_compiler
from support.runner import said

from spidar_gym.onboard.build import PARTS
from spidar_gym.onboard.export import export_files, write_files
from spidar_gym.onboard.message_types import HEAD_IMU
from spidar_gym.sitl.build_ros import message_headers

ros = marked("ros")
pytestmark = needs_compiler
STANDARDS = ("c++11", "c++14", "gnu++14", "c++17", "gnu++17")
"""Standards of C++ of melodic (gcc 7), noetic (gcc 9) and ROS-O on Ubuntu 22.04 (gcc 11), and the least of roscpp."""
SYSTEM = {"PATH": "/usr/bin:/bin", "HOME": os.environ.get("HOME", "/")}
"""Environment without this test's virtual environment: its Python lacks the modules of ROS."""
SPINAL = {
    "package.xml": """<package format="2">
  <name>spinal</name><version>1.0.0</version><description>Messages.</description>
  <maintainer email="maintainer@example.com">spidar_gym</maintainer><license>MIT</license>
  <buildtool_depend>catkin</buildtool_depend><build_depend>message_generation</build_depend>
  <depend>std_msgs</depend><exec_depend>message_runtime</exec_depend>
</package>
""",
    "CMakeLists.txt": """cmake_minimum_required(VERSION 3.10)
project(spinal)
find_package(catkin REQUIRED COMPONENTS message_generation std_msgs)
add_message_files(DIRECTORY msg)
generate_messages(DEPENDENCIES std_msgs)
catkin_package(CATKIN_DEPENDS message_runtime std_msgs)
""",
}
"""Package of the lab's messages in a catkin workspace, as small as possible."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("ros") / "spidar_onboard"
    write_files(export_files(), path)
    return path


@pytest.fixture(scope="module")
def headers(folder):
    return message_headers(folder / "msg", folder.parent / "headers")


def done_by(*command, cwd=None):
    """Run a command outside the virtual environment; return its output."""
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, env=SYSTEM, cwd=cwd)
    assert done.returncode == 0, (done.stdout + done.stderr)[-3000:]
    return done.stdout


def check_links_ros(program, tmp_path):
    """Check that a program has the mode `ros1` and is linked with roscpp: it looks for a master."""
    (tmp_path / "mission").write_text("flight paper\n")
    master = {"ROS_MASTER_URI": "http://127.0.0.1:1", "ROS_IP": "127.0.0.1"}
    done = subprocess.run(
        [program, "ros1", tmp_path / "mission"], capture_output=True, text=True, check=False, env=SYSTEM | master
    )
    assert done.returncode == 2
    assert "no ROS master at http://127.0.0.1:1" in done.stderr


@ros
@pytest.mark.parametrize("standard", STANDARDS)
@pytest.mark.parametrize("compiler", ["g++", "clang++"])
def test_the_node_compiles_without_a_warning_with_the_standards_of_every_distribution(
    folder, headers, compiler, standard, request
):
    if standard not in (STANDARDS[0], STANDARDS[-1]) and not request.config.getoption("whole"):
        pytest.skip("between the least and the newest standard; with --whole")
    if compiler == "clang++" and not shutil.which(compiler):
        pytest.skip("clang++ missing: apt-get install clang")
    words = [f"-std={standard}", "-fsyntax-only", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-DSPIDAR_ROS1"]
    includes = [f"-I{folder / part}" for part in (*PARTS, "generated")]
    done_by(compiler, *words, *includes, f"-isystem{headers}", folder / "runner" / "ros1.cpp")


@ros
@pytest.mark.slow
def test_cmake_builds_and_tests_the_export_without_catkin(folder, tmp_path):
    assert "runner: with ros1" in done_by("cmake", "-S", folder, "-B", tmp_path, "-Wdev")
    done_by("cmake", "--build", tmp_path, "--parallel", "2")
    assert "100% tests passed" in done_by("ctest", "--test-dir", tmp_path)
    check_links_ros(tmp_path / "runner", tmp_path)


@ros
@pytest.mark.slow
def test_a_catkin_workspace_builds_the_export_with_the_messages_of_the_labs_present_software(folder, tmp_path):
    """The workspace has a package `spinal` whose inertial unit has other names than `msg/` of the export."""
    source = tmp_path / "src"
    shutil.copytree(folder, source / "spidar_onboard")
    shutil.copytree(folder / "msg", source / "spinal" / "msg")
    write_files({name: text.encode() for name, text in SPINAL.items()}, source / "spinal")
    (source / "spinal" / "msg" / "Imu.msg").write_text(HEAD_IMU)
    done_by("catkin_make", "-j2", cwd=tmp_path)
    assert "gyro_type gyro;" in (tmp_path / "devel" / "include" / "spinal" / "Imu.h").read_text()
    program = tmp_path / "devel" / "lib" / "spidar_onboard" / "runner"
    assert said(program, "about").stdout.startswith("interface ")
    assert not list(tmp_path.rglob("spinal_messages")), "headers of msg/ are not generated beside those of the lab"
    check_links_ros(program, tmp_path)
