"""Pins interrupted work: what is finished is not done again, what was touched is, nothing is taken for another."""

import dataclasses
import json
import os
from dataclasses import dataclass

import pytest

from spidar_gym.benchmark.statistics import compare
from spidar_gym.paper import crawl_study, unfinished
from spidar_gym.paper import flight_studies as studies
from spidar_gym.paper.trial import Outcome
from spidar_gym.paper.unfinished import finish, forget

DONE = []


@dataclass(frozen=True)
class Item:
    """A piece of work."""

    number: int
    stop: bool = False


def square(item):
    """A result that only the process itself can tell from another one's."""
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
    found = finish(square, ITEMS, folder=tmp_path / "kept", on_done=lambda: counted.append(1))
    assert DONE == [0, 1, 2, 3, 4, 5]
    assert found == finish(square, ITEMS) == [square(item) for item in ITEMS]
    assert len(counted) == len(ITEMS)
    forget(tmp_path / "kept")
    assert [*tmp_path.iterdir()] == []


def test_processes_give_what_one_gives_in_the_order_of_the_items(tmp_path):
    alone = [finish(cube, ITEMS), finish(cube, ITEMS, workers=3), finish(cube, ITEMS, workers=2, folder=tmp_path)]
    assert alone == [[0, 1, 8, 27, 64, 125]] * 3


def test_pieces_belong_to_their_work_their_item_and_their_code(tmp_path, monkeypatch):
    finish(square, ITEMS[:1], folder=tmp_path)
    assert finish(cube, ITEMS[:2], folder=tmp_path) == [0, 1]
    finish(square, ITEMS[:2], folder=tmp_path)
    assert DONE == [0, 1]
    monkeypatch.setattr(unfinished, "_code", lambda: "another")
    finish(square, ITEMS[:1], folder=tmp_path)
    assert DONE == [0, 1, 0]


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: "", lambda text: text[:-9], lambda text: "null", lambda text: "[" * 10**5,
        lambda text: text.replace("1.3333", "1.3334"), lambda text: json.dumps({"result": {"square": 16}}),
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


def test_a_study_of_speeds_goes_on_where_it_was(tmp_path, monkeypatch):
    flown, stops = [], [KeyboardInterrupt()]

    def fly(config, trial):
        if len(flown) == 5 and stops:
            raise stops.pop()
        flown.append(trial)
        return Outcome(0.01 + trial.seed % 3 * 1e-3, 0.02, 0, 1.0, 0, "")

    monkeypatch.setattr("spidar_gym.paper.trial.fly", fly)
    monkeypatch.setattr(studies, "compare", lambda a, b, rng: compare(a, b, rng, draws=20))
    with pytest.raises(KeyboardInterrupt):
        studies.speed_study(speeds=(0.2, 1.0), count=1, folder=tmp_path)
    rows = studies.speed_study(speeds=(0.2, 1.0), count=1, folder=tmp_path)
    assert len(flown) == len(rows) == 8


def test_a_study_of_crawls_goes_on_where_it_was(tmp_path, monkeypatch):
    crawled = []

    def run_case(case, seed):
        crawled.append((case.name, seed))
        return {"case": case.name, "seed": seed}

    monkeypatch.setattr(crawl_study, "run_case", run_case)
    cases = crawl_study.CASES[:2]
    crawl_study.run_cases(cases, [0], folder=tmp_path)
    rows = crawl_study.run_cases(cases, [0, 1], folder=tmp_path)
    assert crawled == [(case.name, seed) for seed in (0, 1) for case in cases]
    assert [(row["case"], row["seed"]) for row in rows] == [(case.name, seed) for case in cases for seed in (0, 1)]
    crawl_study.run_cases([dataclasses.replace(cases[0], preset="robust")], [0], folder=tmp_path)
    assert len(crawled) == 5
