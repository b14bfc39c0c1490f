"""Pins interrupted work: finished pieces are kept, changed files are computed again, none is taken for another."""

import json
import os
from dataclasses import dataclass

import pytest

from spidar_gym.benchmark import resume
from spidar_gym.benchmark.resume import finish
from spidar_gym.errors import InvalidValueError

DONE = []


@dataclass(frozen=True)
class Item:
    """A piece of work."""

    number: int
    stop: bool = False


def square(item):
    """A result that contains the id of its process."""
    if item.stop:
        raise KeyboardInterrupt
    DONE.append(item.number)
    return {"square": item.number**2, "third": item.number / 3.0, "by": os.getpid()}


def cube(item):
    return item.number**3


@pytest.fixture(autouse=True)
def fresh():
    DONE.clear()


ITEMS = [Item(number) for number in range(6)]


def test_what_is_finished_is_not_done_again_and_every_piece_is_counted(tmp_path):
    counted = []
    with pytest.raises(KeyboardInterrupt):
        finish(square, [*ITEMS[:3], Item(9, stop=True), *ITEMS[3:]], folder=tmp_path / "kept")
    assert DONE == [0, 1, 2]
    found = finish(square, ITEMS, folder=tmp_path / "kept", on_done=lambda k, result: counted.append((k, result)))
    assert DONE == [0, 1, 2, 3, 4, 5]
    assert found == finish(square, ITEMS) == [square(item) for item in ITEMS]
    assert counted == list(enumerate(found))
    assert len([*(tmp_path / "kept").iterdir()]) == len(ITEMS)


def test_processes_give_what_one_gives_in_the_order_of_the_items(tmp_path):
    alone = [finish(cube, ITEMS), finish(cube, ITEMS, workers=3), finish(cube, ITEMS, workers=2, folder=tmp_path)]
    assert alone == [[0, 1, 8, 27, 64, 125]] * 3


def test_pieces_belong_to_their_work_their_item_and_their_code(tmp_path, monkeypatch):
    finish(square, ITEMS[:1], folder=tmp_path)
    assert finish(cube, ITEMS[:2], folder=tmp_path) == [0, 1]
    finish(square, ITEMS[:2], folder=tmp_path)
    assert DONE == [0, 1]
    monkeypatch.setattr(resume, "code_digest", lambda: "another")
    finish(square, ITEMS[:1], folder=tmp_path)
    assert DONE == [0, 1, 0]


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "", lambda text: text[:-9], lambda text: "null", lambda text: "[" * 10**5,
        lambda text: text.replace("1.3333", "1.3334"), lambda text: json.dumps({"result": {"square": 16}}),
        lambda text: json.dumps({"metrics": {"square": 16}, "timing": {}, "sha256": json.loads(text)["sha256"]}),
    ],
)  # fmt: skip
def test_a_piece_that_is_not_as_it_was_written_is_done_again(damage, tmp_path):
    before = finish(square, [Item(4)], folder=tmp_path)
    (file,) = tmp_path.iterdir()
    text = file.read_text()
    file.write_text(damage(text))
    assert finish(square, [Item(4)], folder=tmp_path) == before
    assert DONE == [4, 4]
    assert file.read_text() == text


def test_a_piece_of_another_item_is_not_taken_under_its_name(tmp_path):
    finish(square, ITEMS[:2], folder=tmp_path)
    first, second = sorted(tmp_path.iterdir())
    second.write_bytes(first.read_bytes())
    finish(square, ITEMS[:2], folder=tmp_path)
    assert sorted(DONE) == [0, 0, 1] or sorted(DONE) == [0, 1, 1]


def test_a_piece_that_cannot_be_the_result_of_its_item_is_done_again(tmp_path):
    def check(item, result):
        if result["square"] != item.number**2 + 1:
            raise InvalidValueError("square", result["square"], "one more")

    finish(square, ITEMS[:2], folder=tmp_path)
    finish(square, ITEMS[:2], folder=tmp_path, check=check)
    assert DONE == [0, 1, 0, 1]


def test_a_caller_names_the_files_of_its_pieces(tmp_path):
    finish(cube, ITEMS[:2], folder=tmp_path, name=lambda item: f"cubes/{item.number}")
    assert [path.name for path in sorted((tmp_path / "cubes").iterdir())] == ["0.json", "1.json"]
