"""A flight with the runner, shared by the tests of logs."""

import shutil

import pytest


@pytest.fixture(scope="session")
def flown(tmp_path_factory):
    from support.logs import fly

    if not (shutil.which("cc") or shutil.which("gcc")):
        pytest.skip("no C compiler")
    with pytest.MonkeyPatch.context() as monkeypatch:
        return fly(tmp_path_factory.mktemp("flown"), monkeypatch)
