"""Pins `spidar view`: a window without --web, a page with it, and one line for every refusal."""

import itertools
import sys

import pytest
from support import pages
from support.commands import LEARNED, ROOT, refused

from spidar_gym.cli import view as command
from spidar_gym.cli.main import main
from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, HOVER
from spidar_gym.policies.load import load_policy
from spidar_gym.policies.policy import policy_arguments
from spidar_gym.robot import FORMS
from spidar_gym.viz.live import serve


@pytest.fixture
def page(monkeypatch):
    """Return a function that serves a page for three seconds of a simulated wall clock."""
    wall, seen = [0.0], []
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(serve.time, "perf_counter", lambda: wall[0])
    monkeypatch.setattr(serve.time, "sleep", lambda seconds: wall.__setitem__(0, wall[0] + seconds))
    made = pages.modules()
    for module in (serve, command):
        monkeypatch.setattr(module, "require_viser", lambda: made)
    monkeypatch.setattr(serve.Gate, "start", pages.start)

    def keep(shown, stop):
        serve.keep_time(shown, lambda: wall[0] > 3.0)
        shown.goal = shown.session.goal  # the robot is released with the page
        seen.append((shown, shown.session))

    monkeypatch.setattr(command, "keep_time", keep)

    def open_page(*words):
        main(["view", "--web", "--port", "0", *words])
        return seen[-1][0], seen[-1][1]

    return open_page


def test_the_page_applies_the_given_options(page, capfd):
    shown, session = page("--form", "form2", "--preset", "tuned", "--wind", "3", "--seed", "5", "--sensors")
    out = capfd.readouterr().out
    assert out == "http://127.0.0.1:0 shows spidar_gym/Hover-v0; Ctrl-C ends it\n"
    assert session.passed == pytest.approx(120, abs=2)
    assert (session.seed, session.preset, session.disturbances.wind) == (5, "tuned", 3.0)
    assert session.env.plant.config.sense
    assert session.env.plant.state().joint_position == pytest.approx(FORMS["form2"], abs=0.03)
    assert shown._policies["none"] == ""


def test_a_given_policy_flies_and_is_in_the_list_once(page):
    shown, session = page("--policy", LEARNED)
    assert session.policy == LEARNED
    assert list(shown._policies.values()).count(LEARNED) == 1
    assert shown._policy.value == "supervised_paper"


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_the_list_has_the_committed_policies_that_are_for_the_environment(env_id, monkeypatch):
    monkeypatch.chdir(ROOT)
    found = dict(command.policies(env_id, command.WebOptions()))
    for spec in found.values():
        assert policy_arguments(load_policy(spec), env_id) is not None
    few = {HOVER: {"qp", "indi", "memory"}, CRAWL: {"qp", "walking", "gait"}, COURSE: {"course_rule", "course_planner"}}
    assert few.get(env_id, set()) <= set(found)
    assert ("walking" in found) == (env_id == CRAWL)


def test_degrees_are_degrees(page):
    shown, _ = page(CRAWL, "--direction", "90", "--distance", "0.5", "--turn", "0")
    assert shown.goal == pytest.approx((0.0, 0.5, 0.0), abs=0.02)


def test_an_address_open_to_the_network_prints_a_warning(page, capfd):
    page("--host", "0.0.0.0")
    assert "this address and its token are all that is needed to control the robot" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--seed", "3"], "seed = 3 is not valid; expected --web with it"),
        ([CRAWL], f"env_id = '{CRAWL}' is not valid; expected --web with it"),
        (["--wind", "3"], "wind = 3.0 is not valid; expected --web with it"),
        (["--preset", "tuned"], "preset = 'tuned' is not valid; expected --web with it"),
        (["--form", "form9"], "unknown form 'form9'; valid: form1, form2, form3"),
        (["--web", "Hover"], "unknown environment 'Hover'; valid: spidar_gym/Hover-v0"),
        (["--web", "--distance", "1"], "unexpected keyword argument 'distance'; valid: forms"),
        (["--web", "--port", "70000"], "port = 70000 is not valid"),
        (["--web", "--seed", "-1"], "seed = -1 is not valid"),
        (["--web", "--policy", "baselines.walking:Walking"], "expected one for spidar_gym/Hover-v0"),
        (["--web", "--policy", "baselines.qp:QP", "--preset", "tuned"], "preset = 'tuned' is not valid"),
        (["--web", "--policy", "model.zip"], "a zip of Stable-Baselines3 can run code"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_cannot_be_shown_is_refused_in_one_line(words, line, monkeypatch, capfd):
    monkeypatch.chdir(ROOT)
    for module in (serve, command):
        monkeypatch.setattr(module, "require_viser", pages.modules)
    monkeypatch.setattr(serve.Gate, "start", pages.start)
    assert line in refused(capfd, "view", *words)


def test_without_viser_the_refusal_names_what_to_install(monkeypatch, capfd):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert "install it with: pip install 'spidar-gym[web]'" in refused(capfd, "view", "--web")


def test_the_window_needs_a_display_and_names_the_page(monkeypatch, capfd):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert "`spidar view --web`" in refused(capfd, "view")


def test_ctrl_c_ends_the_page_and_its_robot(monkeypatch, page, capfd):
    calls = itertools.count()

    def interrupt(shown, stop):
        next(calls)
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "keep_time", interrupt)
    with pytest.raises(SystemExit) as stop:
        main(["view", "--web", "--port", "0"])
    assert stop.value.code == 130
    assert next(calls) == 1
