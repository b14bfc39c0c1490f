"""Pins the environments' pages: their tables agree with the spaces, the infos and the arguments."""

import inspect
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.docs import CHAPTERS, page, pages
from spidar_gym.envs.env import SpidarEnv
from spidar_gym.envs.registry import ENVIRONMENTS, import_id
from spidar_gym.envs.suite import SUITE
from spidar_gym.errors import UnknownNameError
from spidar_gym.sim.config import PlantConfig
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.sim.rows import OPTIONAL_ROWS, TABLE

DOCS = Path(__file__).resolve().parents[2] / "docs"
NAMES = list(ENVIRONMENTS)
HEADINGS = [
    "Description", "Action Space", "Observation Space", "Rewards", "Info", "Starting State", "Episode End",
    "Arguments", "Version History",
]  # fmt: skip


def section(name: str, heading: str) -> str:
    (text,) = re.findall(rf"^## {heading}\n(.*?)(?=^## |\Z)", page(name), re.DOTALL | re.MULTILINE)
    return text


def table(name: str, heading: str, below: str = "") -> list[list[str]]:
    """Rows of the table of a section, or of its subsection `below`; cells are stripped, the head is omitted."""
    first, *parts = re.split(r"^### ", section(name, heading), flags=re.MULTILINE)
    text = next(part for part in parts if part.startswith(f"{below}\n")) if below else first
    lines = [line for line in text.splitlines() if line.startswith("|")]
    # A bar within backticks is part of its cell.
    return [[cell.strip() for cell in re.split(r"\|(?=(?:[^`]*`[^`]*`)*[^`]*$)", line)[1:-1]] for line in lines[2:]]


def entries(cell: str) -> range:
    """`3–5` or `7` as a range."""
    first, _, last = cell.partition("–")
    return range(int(first), int(last or first) + 1)


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_gymnasiums_headings_in_order(name):
    assert re.findall(r"^## (.*)$", page(name), re.MULTILINE) == HEADINGS
    assert page(name).startswith(f"# {name}\n")


@pytest.mark.parametrize("name", NAMES)
def test_the_action_table_counts_every_entry_of_every_space_once(name):
    sizes, covered, mode = {}, {}, ""
    for label, size, cell, authority in table(name, "Action Space"):
        if label:
            mode = label.strip("`")
            sizes[mode], covered[mode] = int(size), []
        covered[mode] += entries(cell.split()[0])
        assert authority
    assert list(sizes) == list(CHAPTERS[name].modes)
    for mode, size in sizes.items():
        assert gymnasium.make(name, action_mode=mode).action_space.shape == (size,)
        assert covered[mode] == list(range(size))


@pytest.mark.parametrize("name", NAMES)
def test_the_tables_of_other_observations_count_every_entry_of_their_spaces_once(name):
    seen = {"Asymmetric": ("asymmetric", "privileged"), "Goal": ("goal", "desired_goal")}
    if CHAPTERS[name].env.goal_type is None:
        del seen["Goal"]
        assert f"`goal` is refused: {CHAPTERS[name].env.no_goal}." in section(name, "Observation Space")
    for below, (observation, part) in seen.items():
        space = gymnasium.make(name, observation=observation).observation_space[part]
        rows = table(name, "Observation Space", below)
        covered = [entry for cell, *_ in rows for entry in entries(cell)]
        assert covered == list(range(space.shape[0]))
        assert all(float(scale) > 0.0 and meaning for _, _, scale, _, meaning in rows)
        if observation == "goal":
            bounds = [float(bound) for cell, _, bound, *_ in rows for _ in entries(cell)]
            np.testing.assert_allclose(space.high, bounds)


@pytest.mark.parametrize("name", NAMES)
def test_the_observation_table_counts_every_entry_of_the_default_space_once_with_its_bound(name):
    space, scaled = (gymnasium.make(name, observation=kind).observation_space for kind in ("vector", "scaled"))
    rows, covered = table(name, "Observation Space"), []
    for cell, _, bound, scale, _, meaning in rows:
        where = entries(cell)
        covered += where
        np.testing.assert_allclose(space.high[list(where)], float(bound), rtol=1e-6)
        np.testing.assert_allclose(scaled.high[list(where)], float(bound) / float(scale), rtol=1e-6)
        assert meaning
    assert covered == list(range(space.shape[0]))
    assert [row[1].strip("`") for row in rows] == [field.name for field in gymnasium.make(name).unwrapped.layout]
    assert f"({space.shape[0]},)" in section(name, "Observation Space")


@pytest.mark.parametrize("name", NAMES)
def test_every_info_key_is_documented_with_its_shape_and_every_documented_one_exists(name):
    info = gymnasium.make(name).reset(seed=0)[1]
    documented = {}
    for keys, shape, _, meaning in table(name, "Info"):
        assert meaning
        for key in re.findall(r"`([^`]+)`", keys):
            names = [f"reward_{term}" for term in CHAPTERS[name].task.reward_terms] if key == "reward_<term>" else [key]
            documented |= dict.fromkeys(names, shape)
    assert set(documented) == set(info)
    for key, shape in documented.items():
        if shape.startswith("("):
            assert str(np.shape(info[key])) == shape.removesuffix(" bool"), key
            assert np.asarray(info[key]).dtype == (bool if shape.endswith("bool") else float), key
        else:
            assert type(info[key]).__name__ == shape, key


@pytest.mark.parametrize("name", NAMES)
def test_the_reward_table_has_every_term_and_its_weights_add_up_to_one(name):
    for below, reward in (("", "narrow"), ("Sloped", "sloped")):
        rows = table(name, "Rewards", below)
        assert [row[0].strip("`") for row in rows] == list(gymnasium.make(name, reward=reward).unwrapped.reward_terms)
        assert abs(sum(float(row[1]) for row in rows) - 1.0) < 1e-12


@pytest.mark.parametrize("name", NAMES)
def test_every_argument_of_gym_make_is_documented_with_its_default(name):
    rows = {row[0].strip("`"): row[1].strip("`") for row in table(name, "Arguments")}
    chapter = CHAPTERS[name]
    own = {**inspect.signature(SpidarEnv.__init__).parameters, **inspect.signature(chapter.env).parameters}
    own = {key: p for key, p in own.items() if key not in ("mode", "fields", "joint_speed")}
    task = chapter.task
    expected = {key: repr(value.default) for key, value in inspect.signature(task).parameters.items()}
    expected |= {key: repr(p.default) for key, p in own.items() if p.kind is p.KEYWORD_ONLY}
    assert rows == expected


@pytest.mark.parametrize("name", NAMES)
def test_every_disturbance_is_documented_with_its_default_and_what_it_means(name):
    rows = table(name, "Arguments", "Disturbances")
    assert {row[0].strip("`"): row[1].strip("`") for row in rows} == {
        field.name: repr(field.default) for field in fields(Disturbances)
    }
    assert all(meaning for *_, meaning in rows)


@pytest.mark.parametrize("name", NAMES)
def test_everything_that_is_randomised_is_documented_with_its_range_unit_and_source(name):
    rows = table(name, "Arguments", "Randomisation")
    rows += table(name, "Arguments", "Optional randomisation")
    is_level = name.endswith(("Course-v0", "Grasp-v0"))
    optional = [row for row in OPTIONAL_ROWS if not (is_level and row.field.startswith("ground."))]
    expected = (*TABLE, *optional)
    assert [row[0].strip("`") for row in rows] == [row.field for row in expected]
    ranges = {row.field: (row.low, row.high) for row in optional}
    drawn = gymnasium.make(name, randomization={"strength": 1.0, **ranges}).reset(seed=0)[1]["randomization"]
    for (field, operation, distribution, unit, source), row in zip(rows, expected, strict=True):
        part, attribute = field.strip("`").split(".")
        assert hasattr(getattr(PlantConfig(), part), attribute)
        low, high, count = re.fullmatch(r"U\(([-\d.]+), ([-\d.]+)\)(?: × (\d+))?", distribution).groups()
        np.testing.assert_allclose([float(low), float(high)], [row.low, row.high], rtol=1e-3)
        assert drawn[field.strip("`")].size == int(count or 1)
        assert operation in ("set", "scale", "add")
        assert unit
        assert source


@pytest.mark.parametrize("name", NAMES)
def test_every_option_of_reset_is_documented(name):
    text = section(name, "Arguments")
    with pytest.raises(UnknownNameError) as refusal:
        gymnasium.make(name).reset(options={"nothing": 1})
    options = str(refusal.value).partition("valid: ")[2].split(", ")
    assert options
    (call,) = re.findall(r"`reset\(options=(.*?)\)`", text)
    (others,) = re.findall(r"Each of (.*?) is an option", text)
    assert list(dict.fromkeys(re.findall(r"'(\w+)':", call) + re.findall(r"`(\w+)`", others))) == options


@pytest.mark.parametrize("name", NAMES)
def test_every_word_of_failure_and_the_horizon_are_documented(name):
    text = section(name, "Episode End")
    assert re.findall(r"^- `(\w+)`", text, re.MULTILINE) == list(CHAPTERS[name].task.failures)
    assert f"after {gymnasium.spec(name).max_episode_steps} steps" in text


def test_every_page_of_an_environment_has_its_picture():
    own = {path: text for path, text in pages().items() if path.startswith("environments/")}
    assert len(own) == len(ENVIRONMENTS)
    for path, text in own.items():
        (picture,) = re.findall(r"^!\[.*\]\((.*)\)$", text, re.MULTILINE)
        assert ((DOCS / path).parent / picture).is_file()


@pytest.mark.parametrize("name", SUITE)
def test_the_page_of_a_task_of_the_suite_is_that_of_its_spaces_and_makes_the_same_environment(name):
    text, task = page(SUITE[name].id), SUITE[name]
    assert pages()[f"suite/{name}.md"] == text
    env = gymnasium.make(task.id)
    sizes = {int(size) for size in re.findall(r"`Box\(.*?\((\d+),\), float32\)`", text)}
    assert sizes == {env.action_space.shape[0], env.observation_space.shape[0]}
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL).group(1)
    same = eval(code, {"gymnasium": gymnasium})
    assert same.unwrapped.horizon == env.unwrapped.horizon
    for one in (same, env):
        one.reset(seed=4)
    action = np.full(env.action_space.shape, 0.1, np.float32)
    for _ in range(3):
        ours, theirs = env.step(action), same.step(action)
        assert ours[0].tobytes() == theirs[0].tobytes()
        assert ours[1] == theirs[1]
    for term in env.unwrapped.reward_terms:
        assert f"| `{term}` |" in text


def test_an_unknown_environment_has_no_page():
    with pytest.raises(UnknownNameError, match="spidar_gym/Hover-v0"):
        page("spidar_gym/Walk-v0")


@pytest.mark.parametrize("name", NAMES)
def test_the_id_for_other_processes_works_without_an_import_of_the_package(name):
    assert f'gymnasium.make("{import_id(name)}")' in section(name, "Description")
    code = (
        f"import gymnasium, sys; env = gymnasium.make({import_id(name)!r}); env.reset(); print(env.unwrapped.spec.name)"
    )
    made = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert made.stdout.strip() == name.partition("/")[2].removesuffix("-v0")
