"""Pins the session: users' inputs take effect in flight, and without inputs it equals the environment."""

import subprocess
import sys

import numpy as np
import pytest
from support.commands import ROOT

from spidar_gym.control.flight.controller import CONTROL_RATE
from spidar_gym.envs.crawl_env import CrawlEnv
from spidar_gym.envs.hover_env import HoverEnv
from spidar_gym.envs.path_env import PathEnv
from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, GRASP, HOVER, PATH
from spidar_gym.errors import InvalidValueError, UnknownArgumentError, UnknownNameError
from spidar_gym.policies.source import PolicyError
from spidar_gym.robot import FORMS, N_LEGS
from spidar_gym.sim.disturbances import Disturbances
from spidar_gym.viz.live import session as live
from spidar_gym.viz.live.helm import SPEED
from spidar_gym.viz.live.session import BY_HAND, ENDLESS, PATHS_END, REST, Session


@pytest.fixture
def begun():
    """Create sessions, and close them afterwards."""
    made = []

    def begin(*args, **options):
        made.append(Session(*args, **options))
        return made[-1]

    yield begin
    for session in made:
        session.close()


def played(session, ticks):
    """Run some ticks and return their frames."""
    frames = []
    for _ in range(ticks):
        session.tick()
        frames.append(session.frame)
    return frames


def com_error(session):
    return float(np.linalg.norm(session.info["position_error"]))


@pytest.mark.parametrize(("env_id", "kind", "length"), [(HOVER, HoverEnv, ENDLESS), (PATH, PathEnv, PATHS_END)])
def test_a_flight_without_inputs_is_the_environments(begun, env_id, kind, length):
    session = begun(env_id, {"forms": "independent", "joint_speed": 0.6}, seed=4)
    env = kind(forms="independent", joint_speed=0.6, horizon_s=length)
    env.reset(seed=4)
    for frame in played(session, 120):
        env.step(np.zeros(6))
        assert frame.qpos == pytest.approx(env.plant.data.qpos, abs=1e-9)
    assert (env.plant.data.qpos[7:23] != env.plant.data.qpos[7]).any()
    env.close()


def test_a_crawl_without_inputs_is_the_environments(begun):
    session, env = begun(CRAWL, seed=2), CrawlEnv()
    env.reset(seed=2)
    for frame in played(session, 60):
        env.step(np.zeros(env.action_space.shape))
        assert frame.qpos.tolist() == env.plant.data.qpos.tolist()
    env.close()


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_frame_has_what_the_page_shows(begun, env_id):
    session = begun(env_id)
    frame = played(session, 60)[-1]
    assert frame.qpos.shape == ((46,) if env_id == GRASP else (39,))
    assert frame.thrust.shape == (8,)
    assert frame.contacts.shape[1] == 6
    assert frame.time == pytest.approx(60 / CONTROL_RATE)
    assert frame.phase
    assert frame.over == ""
    assert (frame.reference_w is not None) == session.flies
    assert (session.goal is None) == session.flies
    assert (session.way is not None) == (env_id == PATH)
    assert session.ground.boxed == (env_id == COURSE)
    if not session.flies:
        weight = frame.contacts[:, 5].sum() + frame.thrust.sum()
        assert (len(frame.contacts) >= 3) == (env_id != GRASP)  # it begins in the air
        assert 50.0 < weight < 500.0


# Forms and reference.


def test_a_form_is_taken_in_flight_without_a_reset(begun):
    session = begun(options={"joint_speed": 1.0})
    played(session, 20)
    session.take_form(0.5, 1.0)
    frames = played(session, 80)
    assert session.env.ticks == 100
    assert session.env.state.joint_position == pytest.approx(np.tile([0.0, 0.5, 0.0, 1.0], N_LEGS), abs=0.03)
    assert {frame.phase for frame in frames} == {"legs move", "hovers"}
    steps = np.abs(np.diff([frame.qpos[7:23] for frame in frames], axis=0))
    assert steps.max() < 2.0 / CONTROL_RATE  # no leg jumps
    assert com_error(session) < 0.05


def test_another_form_goes_before_one_that_is_not_reached_yet(begun):
    session = begun(options={"joint_speed": 1.0})
    for outer in (1.5, 0.2, 1.0, 0.6):
        session.take_form(0.0, outer)
        played(session, 8)
    played(session, 60)
    assert session.env.state.joint_position[3] == pytest.approx(0.6, abs=0.03)
    plans = []
    session.take_form(0.0, 1.0)
    for _ in range(40):
        session.tick()
        plans.append(session.env.progress.plan()[3])
    assert np.abs(np.diff(plans)).max() <= 1.0 / CONTROL_RATE + 1e-9  # the plan that rewards use does not jump either


@pytest.mark.parametrize("name", FORMS)
def test_the_papers_forms_have_names(begun, name):
    session = begun(options={"joint_speed": 2.0})
    session.take_named_form(name)
    played(session, 60)
    assert session.env.state.joint_position == pytest.approx(FORMS[name], abs=0.03)
    session.reset()
    # The next episode begins in the chosen form.
    assert session.env.state.joint_position == pytest.approx(FORMS[name], abs=1e-3)


def test_a_form_without_a_name_is_taken_again_in_the_next_episode(begun):
    session = begun(options={"joint_speed": 1.0})
    session.take_form(0.3, 0.5)
    session.reset()
    played(session, 50)
    assert session.env.state.joint_position[3] == pytest.approx(0.5, abs=0.03)


def test_a_sequence_of_forms_can_begin_and_be_ended_in_flight(begun):
    session = begun(options={"joint_speed": 1.0})
    played(session, 10)
    session.take_forms("independent")
    targets = {frame.qpos[8] for frame in played(session, 200)}
    assert len(targets) > 50
    assert session.env.ticks == 210
    assert len({tuple(goal.joint_target) for goal in session.env.progress.goals}) > 5
    session.take_forms(BY_HAND)
    played(session, 120)
    assert session.env.state.joint_position == pytest.approx(FORMS["form1"], abs=0.03)


def test_the_reference_is_flown_and_the_robot_follows_it(begun):
    session = begun(options={"preset": "tuned", "perturbation": 0.0})
    home = played(session, 1)[0].reference_w
    for _ in range(4):
        session.nudge(forward=0.1, up=0.05, turn=0.1)
    frames = played(session, 160)
    reference = np.array([frame.reference_w for frame in frames])
    assert reference[-1] == pytest.approx(home + [0.4, 0.0, 0.2], abs=1e-3)
    assert np.linalg.norm(np.diff(reference, axis=0), axis=1).max() <= SPEED / CONTROL_RATE + 1e-9
    assert com_error(session) < 0.01
    yaw = 2.0 * np.arctan2(frames[-1].qpos[6], frames[-1].qpos[3])
    assert yaw == pytest.approx(0.4, abs=0.02)
    session.home()
    assert played(session, 240)[-1].reference_w == pytest.approx(home, abs=1e-9)
    assert com_error(session) < 0.01


def test_a_path_is_flown_beside_itself(begun):
    session = begun(PATH, {"path": "lemniscate", "speed": 0.3, "preset": "tuned", "heading": "kept"})
    other = begun(PATH, {"path": "lemniscate", "speed": 0.3, "preset": "tuned", "heading": "kept"})
    session.nudge(up=0.3)
    beside, along = played(session, 200)[-1], played(other, 200)[-1]
    assert beside.reference_w - along.reference_w == pytest.approx([0.0, 0.0, 0.3])
    ahead = session.env.reference_ahead(0.5).position_w - other.env.reference_ahead(0.5).position_w
    assert ahead == pytest.approx([0.0, 0.0, 0.3])
    assert com_error(session) < 0.05
    assert np.linalg.norm(session.way - along.reference_w, axis=1).min() < 0.02


# Weather, pushes and faults.


def test_wind_begins_in_flight_blows_where_it_is_told_and_is_there_in_the_next_episode(begun):
    session = begun()
    played(session, 10)
    session.disturb(np.pi / 2, wind=4.0)
    frame = played(session, 40)[-1]
    assert frame.wind_w[1] > 2.0 > abs(frame.wind_w[0])
    assert session.info["position_error"][1] < -0.005
    session.reset()
    assert played(session, 5)[-1].wind_w[1] > 2.0
    session.disturb(wind=0.0)
    assert not played(session, 1)[0].wind_w.any()


def test_a_rotor_is_lost_in_flight_and_comes_back(begun):
    session = begun()
    played(session, 10)
    session.disturb(lost_rotor=4)
    assert played(session, 60)[-1].thrust[3] < 0.1
    session.disturb(lost_rotor=0)
    assert played(session, 60)[-1].thrust[3] > 15.0
    assert session.over == ""


def test_a_shove_moves_it_and_ends(begun):
    session = begun()
    played(session, 80)
    before = com_error(session)
    session.shove(60.0, 0.0)
    played(session, 10)
    assert com_error(session) > before + 0.003
    played(session, 200)
    assert com_error(session) < 0.005


def test_what_was_asked_for_at_the_beginning_happens_when_it_was_to_happen(begun):
    session = begun(disturbances=Disturbances(lost_rotor=2, fault_time=1.0))
    frames = played(session, 120)
    assert frames[38].thrust[1] > 10.0
    assert frames[-1].thrust[1] < 0.1


# Controller and policy.


def test_another_preset_flies_from_the_beginning_of_an_episode_with_everything_else_as_it_was(begun):
    session = begun(seed=3)
    session.take_named_form("form2")
    session.disturb(0.0, wind=3.0)
    played(session, 40)
    session.choose(preset="tuned")
    assert (session.preset, session.env.ticks) == ("tuned", 0)
    frame = played(session, 40)[-1]
    assert frame.wind_w[0] > 1.5
    assert session.env.state.joint_position == pytest.approx(FORMS["form2"], abs=0.03)


def test_a_policy_flies_on_the_controller_that_it_chooses(begun, monkeypatch):
    monkeypatch.chdir(ROOT)
    session = begun(options={"preset": "tuned"})
    session.choose(policy="baselines.indi:Indi")
    assert session.preset_is_the_policys
    played(session, 40)
    assert session.over == ""
    session.choose(policy="")
    assert (session.preset, session.preset_is_the_policys) == ("tuned", False)


def test_a_refused_choice_leaves_the_robot_in_flight_as_it_was(begun, monkeypatch):
    monkeypatch.chdir(ROOT)
    session = begun()
    played(session, 20)
    for wrong, error, words in (
        ({"policy": "baselines.walking:Walking"}, PolicyError, f"not for {HOVER}"),
        ({"policy": "missing.knows:Her"}, PolicyError, "No module named 'missing'"),
        ({"preset": "published"}, UnknownNameError, "preset 'published'; valid: paper"),
    ):
        with pytest.raises(error, match=words):
            session.choose(**wrong)
    assert session.env.ticks == 20
    played(session, 20)
    assert session.env.ticks == 40


def test_a_policy_that_fails_ends_its_episode_and_the_next_one_begins(begun, monkeypatch):
    class Late:
        def reset(self, seed):
            self.left = 10

        def act(self, observation):
            self.left -= 1
            return np.zeros(6) if self.left else np.full(6, np.nan)

    monkeypatch.setattr(live, "load_policy", lambda spec, trust: Late())
    session = begun(policy="some:Late", seed=5)
    played(session, 9)
    with pytest.raises(PolicyError, match="gave NaN"):
        session.tick()
    assert session.over == "the policy failed"
    session.tick()
    assert (session.over, session.seed) == ("", 6)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_the_preset_that_is_shown_is_the_one_that_flies(begun, env_id):
    session = begun(env_id)
    assert session.preset in session.presets
    other = begun(env_id, {"preset": session.preset})
    assert played(session, 30)[-1].qpos.tolist() == played(other, 30)[-1].qpos.tolist()


# Episodes.


def test_a_fallen_robot_stays_visible_for_a_while_and_then_the_next_episode_begins(begun):
    session = begun(seed=7)
    session.env.plant.data.qvel[2] = -8.0
    fallen = next(k for k in range(200) if session.tick() or session.over)
    assert session.over in ("contact", "position")
    rest = round(REST * CONTROL_RATE)
    frames = played(session, rest - 1)
    assert {frame.over for frame in frames} == {session.over}
    assert len({tuple(frame.qpos) for frame in frames}) == 1
    assert session.seed == 7
    played(session, 2)
    assert (session.over, session.seed, session.env.ticks) == ("", 8, 1)
    assert session.passed == fallen + rest + 2


def test_an_episode_can_be_played_again(begun):
    session = begun(options={"forms": "mixed"}, seed=9)
    first = played(session, 30)[-1].qpos
    session.reset()
    other = played(session, 30)[-1].qpos
    session.reset(9)
    again = played(session, 30)[-1].qpos
    assert first.tolist() == again.tolist()
    assert first.tolist() != other.tolist()


def test_a_crawl_goes_where_it_is_sent(begun):
    session = begun(CRAWL)
    played(session, 5)
    session.crawl_to(0.5, np.pi / 2, 0.3)
    assert session.goal == pytest.approx((0.0, 0.5, 0.3), abs=0.02)
    assert session.env.ticks == 0
    session.choose(preset="robust")
    assert session.goal == pytest.approx((0.0, 0.5, 0.3), abs=0.02)


def test_a_crawl_that_has_arrived_is_over(begun):
    session = begun(
        CRAWL, {"joint_speed": 1.0, "distance": 0.0, "direction": 0.0, "turn": 0.1, "schedule": "overlapped"}
    )
    for _ in range(2000):
        session.tick()
        if session.over:
            break
    assert session.over == "arrived"


# What is refused.


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda session: session.take_form(3.0, 0.0), "inner = 3.0 .* within -0.174533 … 0.872665"),
        (lambda session: session.take_form(0.0, -1.0), "outer = -1.0 .* within 0 … 1.5708"),
        (lambda session: session.take_named_form("form4"), "form 'form4'; valid: form1"),
        (lambda session: session.take_forms("wild"), "form sequence 'wild'; valid: by hand, paper"),
        (lambda session: session.disturb(wind=-1.0), "wind = -1.0"),
        (lambda session: session.disturb(lost_rotor=9), "lost_rotor = 9"),
        (lambda session: session.shove(1e9, 0.0), "newtons = 1000000000.0"),
        (lambda session: session.crawl_to(0.1, 0.0, 0.0), f"goal = '{HOVER}' .* a crawl"),
    ],
)
def test_what_cannot_be_is_refused_and_the_flight_goes_on(begun, wrong, words):
    session, other = begun(), begun()
    played(session, 5)
    with pytest.raises((InvalidValueError, UnknownNameError), match=words):
        wrong(session)
    played(other, 5)
    assert played(session, 20)[-1].qpos.tolist() == played(other, 20)[-1].qpos.tolist()


@pytest.mark.parametrize("what", ["take_form", "take_named_form", "take_forms", "nudge", "home"])
def test_a_crawl_refuses_inputs_of_a_flight(begun, what):
    session = begun(CRAWL)
    given = {"take_form": (0.0, 0.0), "take_named_form": ("form1",), "take_forms": ("paper",)}.get(what, ())
    with pytest.raises(InvalidValueError, match="expected a flight"):
        getattr(session, what)(*given)


def test_an_argument_that_the_environment_has_not_is_refused_with_those_that_it_has():
    with pytest.raises(UnknownArgumentError, match="argument 'distance'; valid: forms, joint_speed"):
        Session(HOVER, {"distance": 1.0})
    with pytest.raises(UnknownNameError, match="environment"):
        Session("Hover")


def test_sessions_need_no_browser_no_viser_and_no_opengl():
    code = (
        "import sys; from spidar_gym.viz.live.session import Session; s = Session(); s.tick(); s.frame; "
        "print([m for m in ('viser', 'trimesh', 'OpenGL', 'matplotlib') if m in sys.modules])"
    )
    env = {"MUJOCO_GL": "disable", "PATH": "", "PYTHONPATH": str(ROOT)}
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=False)
    assert result.stdout.strip() == "[]", result.stderr
