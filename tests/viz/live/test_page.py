"""Pins the page: every input changes the session and shows its state; with viser too, where it is installed."""

import contextlib
import io
import math
from types import SimpleNamespace

import numpy as np
import pytest
from support import pages
from support.commands import ROOT
from support.pages import CLIENT, find, hit, needs_viser, use

from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, HOVER, PATH
from spidar_gym.robot import FORMS
from spidar_gym.tasks.hover import SEQUENCES
from spidar_gym.viz.live.clock import Clock
from spidar_gym.viz.live.page import CLICK_STEP, KEY_STEP, KEYS, MOVES, OFTEN, SELDOM, Page
from spidar_gym.viz.live.scenery import FIELD_OF_VIEW, camera
from spidar_gym.viz.live.session import BY_HAND, Session
from spidar_gym.viz.live.traces import plots

POLICIES = {"qp": "baselines.qp:QP", "walking": "baselines.walking:Walking"}


@pytest.fixture(params=["stand-in", pytest.param("viser", marks=needs_viser)])
def opened(request, monkeypatch):
    """Open pages, and close them afterwards."""
    monkeypatch.chdir(ROOT)
    CLIENT.told.clear()
    made = []

    def open_page(env_id=HOVER, options=None, **more):
        if request.param == "stand-in":
            server, trimesh = pages.Server(), pages.trimesh()
            server.clients = {0: CLIENT}
        else:
            import trimesh
            import viser

            with contextlib.redirect_stdout(io.StringIO()):
                server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
            monkeypatch.setattr(server, "get_clients", lambda: {0: CLIENT})
        session = Session(env_id, options, **more)
        made.append((server, session))
        return Page(server, trimesh, session, Clock(lambda: 0.0), POLICIES), server, session

    yield open_page
    for server, session in made:
        session.close()
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def ticked(page, ticks=1):
    """Run ticks as the loop does."""
    for _ in range(ticks):
        page.settle()
        page.session.tick()


def test_a_form_is_chosen_by_a_button_and_the_sliders_follow(opened):
    page, server, session = opened(options={"joint_speed": 2.0})
    use(server, "form", "③")
    assert session.form is FORMS["form1"]  # inputs are applied between ticks, not at once
    ticked(page, 80)
    assert session.env.state.joint_position == pytest.approx(FORMS["form3"], abs=0.03)
    assert (find(server, "inner pitch [°]").value, find(server, "outer pitch [°]").value) == (45, 90)
    assert session.env.ticks == 80


def test_a_slider_bends_the_legs_and_ends_the_sequence(opened):
    page, server, session = opened(options={"forms": "independent", "joint_speed": 1.0})
    assert find(server, "sequence").value == "independent"
    use(server, "outer pitch [°]", 30.0)
    ticked(page, 60)
    assert session.env.state.joint_position[3] == pytest.approx(math.radians(30.0), abs=0.03)
    assert find(server, "sequence").value == BY_HAND
    use(server, "sequence", "narrow")
    ticked(page)
    assert session.forms == "narrow"


def test_the_sequences_are_those_of_the_task(opened):
    _, server, _ = opened()
    assert tuple(find(server, "sequence").options) == (BY_HAND, *SEQUENCES)


@pytest.mark.parametrize("what", MOVES)
def test_buttons_fly_the_reference(opened, what):
    page, server, session = opened()
    if what == "home":
        session.nudge(up=0.2)
    use(server, "", what)
    ticked(page, 120)
    helm, way = session.env.helm, MOVES[what]
    wanted = CLICK_STEP * np.array([way.get("forward", 0.0), way.get("left", 0.0), way.get("up", 0.0)])
    assert helm.place == pytest.approx(wanted, abs=1e-3)
    assert helm.yaw == pytest.approx(CLICK_STEP * way.get("turn", 0.0), abs=1e-3)


@pytest.mark.parametrize("key", KEYS)
def test_keys_fly_the_reference(opened, key):
    page, server, session = opened()
    if key == "H":
        session.nudge(up=0.2)
    hit(server, key)
    ticked(page, 120)
    helm, way = session.env.helm, MOVES[KEYS[key]]
    wanted = KEY_STEP * np.array([way.get("forward", 0.0), way.get("left", 0.0), way.get("up", 0.0)])
    assert helm.place == pytest.approx(wanted, abs=1e-3)
    assert helm.yaw == pytest.approx(KEY_STEP * way.get("turn", 0.0), abs=1e-3)


def test_wind_pushes_and_faults_are_set_by_the_inputs(opened):
    page, server, session = opened()
    use(server, "wind to [°]", 90.0)
    use(server, "wind [m/s]", 3.0)
    ticked(page, 2)
    assert session.env.plant.record["weather"]["mean_w"] == pytest.approx([0.0, 3.0, 0.0])
    use(server, "lost rotor", "5")
    use(server, "rotor loses", "vectoring")
    ticked(page)
    assert (session.disturbances.lost_rotor, session.disturbances.fault) == (5, "vectoring")
    use(server, "lost rotor", "none")
    use(server, "push [N]", 40.0)
    use(server, "pushes", "once")
    ticked(page)
    assert session.env.plant.record["weather"]["push_w"] == pytest.approx([0.0, 40.0, 0.0], abs=1e-9)
    assert (session.disturbances.lost_rotor, session.disturbances.push) == (0, 0.0)
    use(server, "pushes", "at times")
    ticked(page)
    assert session.disturbances.push == 40.0
    use(server, "pushes", "never")
    ticked(page)
    assert session.disturbances.push == 0.0


def test_presets_and_policies_are_switched_and_a_policy_with_its_own_preset_disables_the_switch(opened):
    page, server, session = opened()
    use(server, "preset", "tuned")
    ticked(page, 5)
    assert session.preset == "tuned"
    use(server, "policy", "qp")
    ticked(page, 5)
    assert session.policy == POLICIES["qp"]
    assert find(server, "preset").disabled
    use(server, "policy", "none")
    ticked(page, 5)
    assert (session.policy, find(server, "preset").value, find(server, "preset").disabled) == ("", "tuned", False)


def test_what_is_refused_is_shown_and_the_inputs_return_to_the_present_values(opened):
    page, server, session = opened()
    use(server, "policy", "walking")
    ticked(page, 3)
    assert "not for spidar_gym/Hover-v0" in CLIENT.told[0]
    assert find(server, "policy").value == "none"
    assert session.env.ticks == 3


def test_time_pauses_changes_speed_and_episodes_restart(opened):
    page, server, session = opened(seed=4)
    use(server, "episode", "pause")
    use(server, "speed", 0.5)
    page.settle()
    assert page.clock.is_paused
    assert page.clock.speed == 0.5
    hit(server, "P")
    page.settle()
    assert not page.clock.is_paused
    ticked(page, 10)
    use(server, "episode", "again")
    ticked(page, 1)
    assert (session.seed, session.env.ticks) == (4, 1)
    use(server, "episode", "next")
    ticked(page, 1)
    assert session.seed == 5


def test_a_crawl_is_sent_somewhere(opened):
    page, server, session = opened(CRAWL)
    use(server, "distance [m]", 0.4)
    use(server, "direction [°]", 90.0)
    use(server, "turn [°]", 20.0)
    use(server, "crawl there", True)
    ticked(page)
    assert session.goal == pytest.approx((0.0, 0.4, math.radians(20.0)), abs=0.02)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_moment_of_every_environment_is_shown(opened, env_id):
    page, _, session = opened(env_id)
    for k in range(4):
        ticked(page, 10)
        page.show(k * SELDOM)
    assert "real time" in page._words.content
    assert "of its weight" in page._words.content
    assert [len(handle.data) for handle, *_ in page._curves] == [1 + len(plot.names) for plot in plots(env_id)]
    scenery = page.scenery
    assert np.asarray(scenery._com.position) == pytest.approx(scenery._puppet.com, abs=1e-6)
    positions = {part.name: handle.batched_positions for part, handle in scenery._robot}
    assert positions["torso"][0] == pytest.approx(session.frame.qpos[:3], abs=1e-5)
    assert np.asarray(scenery._world.position)[:2] == pytest.approx(-scenery._puppet.com[:2], abs=1e-6)
    assert scenery._reference.visible == session.flies
    assert scenery._goal.visible == (not session.flies)
    if session.flies:
        assert np.asarray(scenery._reference.position) == pytest.approx(session.frame.reference_w, abs=1e-6)


def test_the_floor_is_laid_anew_in_every_episode(opened):
    page, _, session = opened(COURSE)
    seen = []
    for seed in (0, 1):
        session.reset(seed)
        page.show(float(seed))
        seen.append(page.scenery._puppet.blocks()[0])
    assert seen[0].shape != seen[1].shape or not np.allclose(seen[0], seen[1])
    page, _, session = opened(PATH)
    page.show(0.0)
    assert len(page.scenery._static) == 2  # floor and path


def test_words_say_that_the_machine_is_late_and_why_an_episode_is_over(opened):
    page, _, session = opened()
    wall = [0.0]
    page.clock = clock = Clock(lambda: wall[0])
    for _ in range(20):
        wall[0] += 1.0
        clock.due()
    assert "**late: 0." in page.words()
    assert f"{clock.given_up} periods skipped" in page.words()
    clock.pause(True)
    assert "paused" in page.words()
    session.env.plant.data.qvel[2] = -8.0
    ticked(page, 60)
    assert page.words().startswith(f"**over: {session.over}**")


def test_words_are_not_written_at_every_tick(opened):
    page, _, _ = opened()
    written = []
    for k in range(40):
        ticked(page)
        page.show(k / 40.0)
        written.append(page._words.content)
    assert len(set(written)) <= round(1.0 / OFTEN) + 1


@pytest.mark.parametrize("what", ["thrust", "jets", "contact forces", "reference", "shadow"])
def test_what_is_shown_can_be_hidden(opened, what):
    page, server, _ = opened()
    scenery = page.scenery
    seen = {
        "thrust": lambda: scenery._thrust.visible,
        "jets": lambda: scenery._jets[0].visible,
        "contact forces": lambda: scenery._contacts.visible,
        "reference": lambda: scenery._reference.visible,
        "shadow": lambda: scenery._sun.cast_shadow,
    }
    for shown in (False, True):
        use(server, what, shown)
        page.settle()
        assert seen[what]() == shown
        assert all(look() for name, look in seen.items() if name != what)


def test_the_robot_leaves_the_middle_where_it_is_not_to_stay_there(opened):
    page, server, session = opened()
    use(server, "robot in the middle", False)
    for _ in range(5):
        session.nudge(forward=0.1)
    ticked(page, 100)
    page.show(0.0)
    assert np.asarray(page.scenery._world.position) == pytest.approx(np.zeros(3))
    assert page.scenery._com.position[0] > 0.2


def test_nothing_is_drawn_without_a_client(opened, monkeypatch):
    page, server, _ = opened()
    monkeypatch.setattr(server, "get_clients", dict)
    monkeypatch.setattr(page.scenery, "show", lambda _: pytest.fail("drawn without a client"))
    ticked(page)
    page.show(0.0)


@pytest.mark.parametrize(("aspect", "sees"), [(0.46, 0.3), (0.8, 0.5), (1.6, 0.5)])
def test_the_camera_sees_all_of_the_robot_and_on_a_telephone_above_the_panel(aspect, sees):
    position, look_at = camera(aspect)
    ahead = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    slope = math.tan(0.5 * FIELD_OF_VIEW)
    for angle in np.linspace(0.0, math.tau, 16):
        tip = np.array([1.25 * math.cos(angle), 1.25 * math.sin(angle), 0.95]) - position  # a foot in form ①
        x, y = tip @ right / (tip @ ahead) / (slope * aspect), tip @ up / (tip @ ahead) / slope
        assert abs(x) < 1.0
        assert (1.0 - y) / 2.0 < (0.42 if sees < 0.5 else 0.8)
        assert y < 1.0


def test_a_browser_that_takes_the_servers_first_camera_late_is_given_its_own_again(opened):
    page, _, _ = opened()
    calls, view = [], SimpleNamespace(aspect=0.46, position=np.zeros(3), look_at=np.zeros(3))
    view.on_update = calls.append
    page.scenery._look(SimpleNamespace(camera=view))
    own, (first, _) = view.position, camera(1.0)
    assert np.linalg.norm(own) > np.linalg.norm(first) + 1.0
    view.position = first
    calls[0](view)
    assert view.position is not first
    assert view.position == pytest.approx(own)
    view.position = elsewhere = np.array([1.0, 2.0, 3.0])
    calls[0](view)
    assert view.position is elsewhere  # moved by the user, so it stays
    view.aspect = 1.6
    calls[0](view)
    assert view.position == pytest.approx(first)
