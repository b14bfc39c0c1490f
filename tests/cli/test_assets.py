"""Pins `spidar assets`: stale files are named, and only these are written, completely or not at all."""

import shutil
from pathlib import Path

import pytest
from support.commands import files, refused
from support.needs import needs_compiler

from spidar_gym.cli import assets as cli
from spidar_gym.cli.main import main
from spidar_gym.native import library, recipe
from spidar_gym.native.codegen import committed
from spidar_gym.robot import RobotSpec, description
from spidar_gym.robot.description import assets_dir, generated_files, mjcf, urdf

NATIVE = ("spidar_structs.h", "spidar_policy.h", "osqp/auxil.c")
"""Some of the generated C."""


@pytest.fixture
def assets(tmp_path, monkeypatch) -> Path:
    """Return a copy of the assets beside a copy of the generated C; the command works on the copies."""
    folder = tmp_path / "checkout" / "assets"
    shutil.copytree(description.assets_dir(), folder)
    shutil.copytree(recipe.GENERATED, folder.parent / "generated")
    for module in (cli, description):
        monkeypatch.setattr(module, "assets_dir", lambda: folder)
    for module in (cli, committed):
        monkeypatch.setattr(module, "GENERATED", folder.parent / "generated")
    return folder


def native_files():
    """Return the number of generated C files."""
    return len([path for path in recipe.GENERATED.rglob("*") if path.is_file()])


def test_the_committed_assets_are_fresh(capfd):
    main(["assets", "--check"])
    assert f"{len(generated_files()) + native_files()} generated files" in capfd.readouterr().out


@pytest.mark.parametrize("name", [*(f"assets/{n}" for n in generated_files()), *(f"generated/{n}" for n in NATIVE)])
@pytest.mark.parametrize("missing", [False, True])
def test_a_stale_asset_is_named_by_the_check_which_writes_nothing(name, missing, assets, capfd):
    path = assets.parent / name
    path.unlink() if missing else path.write_text(path.read_text(encoding="utf-8") + " ", encoding="utf-8")
    before = files(assets.parent)
    line = refused(capfd, "assets", "--check")
    assert str(path) in line
    assert "spidar assets" in line
    assert files(assets.parent) == before


def test_assets_are_written_whole_and_only_where_they_are_stale(assets, capfd):
    fresh = files(assets.parent)
    (assets / "mjcf" / "spidar.xml").write_text("<mujoco/>", encoding="utf-8")
    main(["assets"])
    assert capfd.readouterr().out.startswith("1 of ")
    assert files(assets.parent) == fresh
    main(["assets"])
    assert capfd.readouterr().out.startswith("0 of ")
    assert files(assets.parent) == fresh


def test_an_asset_that_cannot_be_written_is_one_line_and_leaves_no_half_of_it(assets, capfd):
    (assets / "README.md").unlink()
    (assets / "README.md").mkdir()
    before = files(assets)
    assert "README.md" in refused(capfd, "assets")
    assert files(assets) == before


def test_c_that_is_not_generated_any_more_is_named_and_removed(assets, capfd):
    old = assets.parent / "generated" / "osqp" / "old_workspace.c"
    old.write_text("int old;\n")
    assert "old_workspace.c is not generated any more; valid: " in refused(capfd, "assets", "--check")
    main(["assets"])
    assert not old.exists()
    main(["assets", "--check"])


def test_sources_of_another_osqp_are_not_compared_and_one_line_states_it(assets, capfd, monkeypatch):
    monkeypatch.setattr(committed, "version", lambda name: "9.9.9")
    (assets.parent / "generated" / "osqp" / "auxil.c").write_text("")
    main(["assets", "--check"])
    last = capfd.readouterr().out.splitlines()[-1]
    assert last.startswith("not compared: OSQP's sources, which are those of osqp 1.")
    assert last.endswith("; osqp 9.9.9 is installed here")


@needs_compiler
def test_an_edited_c_file_is_noticed_and_compiled(tmp_path, capfd, monkeypatch):
    core, own = tmp_path / "core", tmp_path / recipe.LIBRARY
    shutil.copytree(recipe.SOURCES[0], core)
    shutil.copy(library.core_path(), own)
    monkeypatch.setenv("SPIDAR_CORE", str(own))
    monkeypatch.setattr(recipe, "LIBRARY_FLAGS", ("-std=c99", "-O0"))
    monkeypatch.setattr(recipe, "SOURCES", (core, *recipe.SOURCES[1:]))
    library.load_core()
    with (core / "border.c").open("a") as file:
        file.write("/* edited */\n")
    library.expected_digest.cache_clear()
    try:
        line = refused(capfd, "assets", "--check")
        assert str(own) in line
        assert line.endswith("valid: the file that `spidar assets` writes")
        main(["assets"])
        assert capfd.readouterr().out.endswith(f"compiled: {own}\n")
        # This process keeps the library that it has loaded; the next process loads the compiled one.
        assert library.expected_digest().encode() in own.read_bytes()
    finally:
        library.expected_digest.cache_clear()


def test_the_files_of_a_custom_robot_go_into_a_folder_and_nothing_else_is_written(capfd, tmp_path):
    (tmp_path / "own.toml").write_text("pitch_to_foot = 0.6138\n", encoding="utf-8")
    before = {path: path.read_bytes() for path in assets_dir().rglob("*.*ml")}
    main(["assets", "--robot", str(tmp_path / "own.toml"), "--out", str(tmp_path / "own")])
    assert "mjcf/spidar.xml, urdf/spidar.urdf in" in capfd.readouterr().out
    robot = RobotSpec(pitch_to_foot=0.6138)
    assert (tmp_path / "own" / "mjcf" / "spidar.xml").read_text(encoding="utf-8") == mjcf(robot)
    assert (tmp_path / "own" / "urdf" / "spidar.urdf").read_text(encoding="utf-8") == urdf(robot)
    assert {path: path.read_bytes() for path in assets_dir().rglob("*.*ml")} == before
    for words in (["--robot", "own.toml"], ["--out", "own"], ["--robot", "own.toml", "--out", "own", "--check"]):
        assert "--robot FILE and --out FOLDER together" in refused(capfd, "assets", *words)
