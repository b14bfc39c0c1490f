"""Pins `spidar assets`: a stale file is named, and files are written whole and only where they are stale."""

import shutil
from pathlib import Path

import pytest
from support.commands import ROOT, files, refused

from spidar_gym.cli import main as cli
from spidar_gym.cli.main import main
from spidar_gym.envs.docs import pages
from spidar_gym.envs.registry import ENVIRONMENTS
from spidar_gym.robot import description
from spidar_gym.robot.description import generated_files


@pytest.fixture
def assets(tmp_path, monkeypatch) -> Path:
    """A copy of the assets that the command line works on, beside one of the guide's generated pages."""
    folder = tmp_path / "checkout" / "assets"
    shutil.copytree(description.assets_dir(), folder)
    shutil.copytree(ROOT / "docs" / "environments", folder.parent / "docs" / "environments")
    shutil.copy(ROOT / "docs" / "conf.py", folder.parent / "docs")
    for module in (cli, description):
        monkeypatch.setattr(module, "assets_dir", lambda: folder)
    return folder


def test_the_committed_assets_are_fresh(capfd):
    main(["assets", "--check"])
    assert f"{len(generated_files()) + len(pages())} generated files" in capfd.readouterr().out


@pytest.mark.parametrize("name", [*(f"assets/{n}" for n in generated_files()), *(f"docs/{n}" for n in pages())])
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
    for name in pages():
        (assets.parent / "docs" / name).unlink()
    main(["assets"])
    assert capfd.readouterr().out.startswith(f"{1 + len(ENVIRONMENTS)} of ")
    assert files(assets.parent) == fresh
    main(["assets"])
    assert capfd.readouterr().out.startswith("0 of ")
    assert files(assets.parent) == fresh


def test_an_installed_package_has_no_guide_to_write(assets, capfd):
    shutil.rmtree(assets.parent / "docs")
    main(["assets", "--check"])
    assert capfd.readouterr().out.startswith(f"{len(generated_files())} generated files")
    main(["assets"])
    assert not (assets.parent / "docs").exists()


def test_an_asset_that_cannot_be_written_is_one_line_and_leaves_no_half_of_it(assets, capfd):
    (assets / "README.md").unlink()
    (assets / "README.md").mkdir()
    before = files(assets)
    assert "README.md" in refused(capfd, "assets")
    assert files(assets) == before
