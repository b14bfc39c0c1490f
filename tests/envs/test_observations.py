"""Pins observations other than the flat vector: goals and their rewards, and the privileged part for critics."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from support.copies import actions_for, copied, pickled
from support.episodes import same

from spidar_gym.envs.goals import CrawlGoal, HoverGoal
from spidar_gym.envs.observations import MOST, privileged_layout
from spidar_gym.envs.registry import COURSE, CRAWL, ENVIRONMENTS, HOVER, PATH
from spidar_gym.errors import InvalidValueError, NoGoalError, UnknownNameError
from spidar_gym.sim.randomize import TABLE
from spidar_gym.so3 import exp, matrix_to_quat, quat_to_matrix
from spidar_gym.tasks.hover import HoverTask

CONTROLS = ("core", "python")
GOALS = (HOVER, CRAWL)
ROUGH = {"sensors": True, "randomization": 1.0, "battery": True}
DIRECT = {HOVER: {"action_mode": "direct"}, CRAWL: {"action_mode": "direct"}, PATH: {"action_mode": "direct"}}
EITHER = [(name, "goal") for name in GOALS] + [(name, "asymmetric") for name in ENVIRONMENTS]


def make(name, observation, control="core", **options):
    return gymnasium.make(name, observation=observation, control=control, **options)


def many(name, observation, robots=3, mode="NextStep", **options):
    return gymnasium.make_vec(name, robots, observation=observation, autoreset_mode=mode, **options)


def fields_of(env):
    """Slice of each field of the privileged observation."""
    found, start = {}, 0
    for f in privileged_layout(env.unwrapped.true_fields):
        found[f.name] = slice(start, start + f.size)
        start += f.size
    return found


# ---- observations ----


@pytest.mark.parametrize(("name", "observation"), EITHER)
def test_gymnasiums_checker_finds_nothing_to_warn_of(name, observation):
    check_env(make(name, observation).unwrapped, skip_render_check=True)


@pytest.mark.train
@pytest.mark.parametrize(("name", "observation"), EITHER)
def test_the_checker_of_stable_baselines_finds_nothing_to_warn_of(name, observation):
    from stable_baselines3.common.env_checker import check_env as check

    check(make(name, observation).unwrapped, warn=True, skip_render_check=True)


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize(("name", "observation"), EITHER)
def test_the_flat_numbers_and_the_episode_are_those_of_an_environment_without_it(name, observation, control):
    options = {"max_episode_steps": 30, **ROUGH}
    env, plain = make(name, observation, control, **options), make(name, "vector", control, **options)
    left_out = env.unwrapped.goal_type.left_out if observation == "goal" else ()
    kept = np.concatenate([np.full(f.size, f.name not in left_out) for f in plain.unwrapped.layout])
    (seen, info), (flat, told) = env.reset(seed=4), plain.reset(seed=4)
    for action in actions_for(env, 12):
        assert np.array_equal(seen["observation"], flat[kept])
        assert same(info, told)
        assert seen in env.observation_space
        seen, reward, *ends, info = env.step(action)
        flat, plain_reward, *plain_ends, told = plain.step(action)
        assert ends == plain_ends
        assert observation == "goal" or reward == plain_reward


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize(("name", "observation"), [case for case in EITHER if case[0] != COURSE])
def test_a_vector_shows_each_robot_what_an_environment_of_its_own_shows(name, observation, mode):
    options = {"max_episode_steps": 8, **ROUGH}
    vector = many(name, observation, 3, mode, **options)
    envs = [make(name, observation, **options) for _ in range(3)]
    seen, _ = vector.reset(seed=5)
    ones = [env.reset(seed=5 + k)[0] for k, env in enumerate(envs)]
    over, ended = [False] * 3, 0
    for action in actions_for(envs[0], 20):
        for k, one in enumerate(ones):
            for part, rows in seen.items():
                assert np.array_equal(rows[k], one[part])
        seen, rewards, terminated, truncated, info = vector.step(np.stack([action] * 3))
        for k, env in enumerate(envs):
            if over[k] and mode == "NextStep":
                ones[k], over[k] = env.reset()[0], False
                assert (rewards[k], terminated[k], truncated[k]) == (0.0, False, False)
                continue
            ones[k], reward, *ends, _ = env.step(action)
            assert [rewards[k], terminated[k], truncated[k]] == [reward, *ends]
            over[k] = any(ends)
            ended += over[k]
            if over[k] and mode == "SameStep":
                assert info["_final_obs"][k]
                for part, rows in info["final_obs"].items():
                    assert np.array_equal(rows[k], ones[k][part])
                ones[k] = env.reset()[0]
    assert ended == 6


def test_python_controllers_give_the_same_observations_as_the_engine():
    for name, observation in EITHER:
        options = {"randomization": 1.0, "disturbances": {"wind": 2.0}}
        envs = [make(name, observation, control, **options) for control in CONTROLS]
        seen = [env.reset(seed=1)[0] for env in envs]
        for action in actions_for(envs[0], 4):
            for part in seen[0]:
                np.testing.assert_allclose(seen[0][part], seen[1][part], atol=2e-4)
            seen = [env.step(action)[0] for env in envs]


def test_returned_observations_are_copies():
    vector, env = many(HOVER, "asymmetric"), make(HOVER, "goal")
    for shown, step in (
        (vector.reset(seed=0)[0], lambda: vector.step(np.zeros((3, 6)))),
        (env.reset(seed=0)[0], lambda: env.step(np.zeros(6))),
    ):
        before = {part: rows.copy() for part, rows in shown.items()}
        step()
        assert all(np.array_equal(shown[part], rows) for part, rows in before.items())


# ---- goals ----


@pytest.mark.parametrize("reward", ["sparse", "dense"])
@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("name", GOALS)
def test_the_reward_of_a_step_is_that_of_its_goals_without_sensor_noise(name, control, reward):
    env = make(name, "goal", control, goal_reward=reward, sensors=True, **DIRECT[name])
    inner = env.unwrapped
    env.reset(seed=2)
    rng, over, rewards = np.random.default_rng(0), False, []
    while not over and len(rewards) < 60:
        seen, reward_, over, truncated, info = env.step(rng.uniform(-1.0, 1.0, 40).astype(np.float32))
        pair = seen["achieved_goal"], seen["desired_goal"]
        assert reward_ == env.get_wrapper_attr("compute_reward")(*pair, info)
        assert over == inner.compute_terminated(*pair, info)
        assert truncated == inner.compute_truncated(*pair, info)
        rewards.append(reward_)
        place = info["goal_error"][:2] if name == CRAWL else info["position_error"]
        np.testing.assert_allclose((pair[1] - pair[0])[: len(place)], place, atol=1e-5)
    assert set(rewards) <= {-1.0, 0.0} if reward == "sparse" else len({*rewards}) > 10


def test_a_crawl_ends_at_its_goal():
    env = make(CRAWL, "goal", distance=0.1, direction=0.0, turn=0.0)
    seen, _ = env.reset(seed=0)
    np.testing.assert_allclose(seen["desired_goal"] - seen["achieved_goal"], [0.1, 0.0, 0.0], atol=1e-6)
    rewards, info = [], {"finished": False}
    while not info["finished"]:
        _, reward, _, _, info = env.step(np.zeros(4))
        rewards.append(reward)
    assert rewards[0] == -1.0
    assert rewards[-1] == 0.0
    assert info["is_success"]


def test_rewards_of_goals_in_rows_are_those_one_by_one():
    rng = np.random.default_rng(0)
    for kind in (CrawlGoal, HoverGoal):
        size = sum(f.size for f in kind.fields)
        achieved, wanted = rng.normal(size=(2, 4, 5, size)).astype(np.float32)
        for reward in ("sparse", "dense"):
            goal = kind(reward)
            rows = goal.reward(achieved, wanted)
            assert rows.shape == (4, 5)
            assert rows[2, 3] == goal.reward(achieved[2, 3], wanted[2, 3])
            assert np.all(goal.reward(achieved, achieved) == 0.0)


def test_a_whole_turn_is_no_displacement_and_minus_a_quaternion_the_same_attitude():
    crawl = CrawlGoal("dense")
    assert crawl.reward([0.0, 0.0, 3.1], [0.0, 0.0, -3.1]) == pytest.approx(-0.5 * (2.0 * np.pi - 6.2))
    assert crawl.reward([3.0, 4.0, 0.0], [0.0, 0.0, 0.0]) == -5.0
    hover = HoverGoal("dense")
    a, b = (matrix_to_quat(exp(np.array(v))) for v in ([0.1, -0.4, 2.0], [0.5, 0.2, -1.0]))
    R = quat_to_matrix(a).T @ quat_to_matrix(b)
    angle = np.arccos(0.5 * (np.trace(R) - 1.0))
    goals = [np.concatenate((np.zeros(3), q, np.zeros(16))) for q in (a, b, -b)]
    assert hover.reward(goals[0], goals[1]) == pytest.approx(-0.5 * angle)
    assert hover.reward(goals[0], goals[2]) == pytest.approx(-0.5 * angle)


def test_the_observation_of_a_crawl_does_not_contain_its_goal():
    ways = [(0.3, 0.0), (0.3, 1.5), (0.3, -2.0)]
    seen = [make(CRAWL, "goal", distance=d, direction=way, turn=0.0).reset(seed=0)[0] for d, way in ways]
    for other in seen[1:]:
        assert np.array_equal(seen[0]["observation"], other["observation"])
        assert np.array_equal(seen[0]["achieved_goal"], other["achieved_goal"])
        assert not np.allclose(seen[0]["desired_goal"], other["desired_goal"])


# ---- privileged observations ----


def test_every_randomised_number_is_observed_relative_to_its_range():
    vector = many(HOVER, "asymmetric", 4, randomization=1.0)
    seen, _ = vector.reset(seed=0)
    env = make(HOVER, "asymmetric", randomization=1.0)
    _, info = env.reset(seed=2)
    for row in TABLE:
        told = seen["privileged"][2, fields_of(env)[row.field]]
        drawn, middle, half = info["randomization"][row.field], 0.5 * (row.low + row.high), 0.5 * (row.high - row.low)
        np.testing.assert_allclose(told, np.ravel((drawn - middle) / half), atol=1e-5)
        assert np.abs(told).max() <= 1.0 + 1e-5


def test_privileged_observations_have_the_true_state_despite_sensors():
    disturbances = {"wind": 3.0, "lost_rotor": 5, "fault_time": 0.1}
    env = make(HOVER, "asymmetric", sensors=True, battery=True, disturbances=disturbances)
    seen, info = env.reset(seed=6)
    at, state = fields_of(env), env.unwrapped.state
    assert not seen["privileged"][at["lost_thrust"]].any()
    for _ in range(6):
        seen, *_, info = env.step(np.zeros(6))
    told, state, plant = seen["privileged"], env.unwrapped.state, env.unwrapped.plant
    R = quat_to_matrix(state.quat_wb)
    expected = {
        "position": state.position_w / 10.0, "velocity": R.T @ state.velocity_w / 5.0, "up": R[2],
        "joint_position": state.joint_position / 2.0, "thrust": state.thrust / 42.0,
        "vectoring_cosine": np.cos(state.vectoring).ravel(), "position_error": info["position_error"],
        "air_force": info["air_force"] / 50.0, "wind": plant.record["weather"]["mean_w"] / 10.0,
        "lost_thrust": np.eye(8)[4], "lost_vectoring": np.zeros(8), "in_contact": [0.0],
        "charge": [1.0 - info["energy_wh"] / 154.0],
    }  # fmt: skip
    for name, value in expected.items():
        if name != "charge":
            np.testing.assert_allclose(told[at[name]], value, atol=1e-5, err_msg=name)
    assert np.linalg.norm(told[at["wind"]]) == pytest.approx(0.3)
    assert 0.99 < told[at["charge"]][0] < 1.0
    assert not np.allclose(env.unwrapped.seen.position_w, state.position_w, atol=1e-5)


def test_foot_contacts_and_a_stuck_module_are_privileged_observations():
    env = make(CRAWL, "asymmetric", disturbances={"lost_rotor": 2, "fault": "vectoring", "fault_time": 0.0})
    seen, info = env.reset(seed=0)
    seen, *_, info = env.step(np.zeros(4))
    at = fields_of(env)
    assert np.array_equal(seen["privileged"][at["foot_contact"]], info["foot_contact"])
    assert seen["privileged"][at["lost_vectoring"]].tolist() == np.eye(8)[1].tolist()
    assert seen["privileged"][at["in_contact"]] == [1.0]


def test_observations_of_a_diverged_robot_are_finite():
    for observation in ("goal", "asymmetric"):
        env = make(HOVER, observation)
        env.reset(seed=0)
        env.unwrapped.plant.data.qpos[:] = np.nan
        seen, _, terminated, _, info = env.step(np.zeros(6))
        assert (terminated, info["failure"]) == (True, "diverged")
        assert seen in env.observation_space
        assert max(np.abs(rows).max() for rows in seen.values()) <= max(MOST, 100.0)


# ---- copies, saved states, options of reset ----


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize(("name", "observation"), [(HOVER, "goal"), (CRAWL, "goal"), (HOVER, "asymmetric")])
def test_copies_pickles_and_saved_states_give_the_same_observations(name, observation, control):
    env = make(name, observation, control, **ROUGH)
    env.reset(seed=3)
    actions = actions_for(env, 8)
    for action in actions[:4]:
        env.step(action)
    other = make(name, observation, control, **ROUGH)
    other.reset(seed=9)
    shown, _ = other.unwrapped.restore_state(env.unwrapped.save_state())
    others = [copied(env), pickled(env), other]
    assert same(shown, env.unwrapped._shown()[0])
    for action in actions[4:]:
        expected = env.step(action)
        assert all(same(each.step(action), expected) for each in others)


def test_a_saved_state_can_be_restored_with_another_kind_of_observation():
    env, flat = make(HOVER, "asymmetric", **ROUGH), make(HOVER, "vector", **ROUGH)
    env.reset(seed=3)
    flat.reset(seed=1)
    env.step(np.zeros(6))
    flat.unwrapped.restore_state(env.unwrapped.save_state())
    assert np.array_equal(env.step(np.zeros(6))[0]["observation"], flat.step(np.zeros(6))[0])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize(("name", "observation"), [(CRAWL, "goal"), (HOVER, "asymmetric")])
def test_copies_and_saved_robots_of_a_vector_show_the_same(name, observation, mode):
    vector = many(name, observation, 3, mode, max_episode_steps=6, **ROUGH)
    vector.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (10, *vector.action_space.shape))
    steps = 5 if mode == "Disabled" else 10
    vector.step(actions[0])
    other = many(name, observation, 3, mode, max_episode_steps=6, **ROUGH)
    shown, _ = other.restore(vector.save())
    assert all(np.array_equal(shown[part], rows) for part, rows in vector._seen().items())
    others = [copied(vector), pickled(vector), other]
    for action in actions[1:steps]:
        expected = vector.step(action)
        assert all(same(each.step(action)[:4], expected[:4]) for each in others)
    for each in (vector, *others):
        each.close()


def test_options_of_reset_make_other_episodes_of_the_same_kind():
    env, vector = make(CRAWL, "goal", goal_reward="dense"), many(CRAWL, "goal", goal_reward="dense")
    options = {"distance": 0.4, "direction": 0.0, "turn": 0.0, "randomization": {"body.total_mass": (16.0, 16.0)}}
    seen, _ = env.reset(seed=0, options=options)
    assert seen in env.observation_space
    assert seen["desired_goal"][0] - seen["achieved_goal"][0] == pytest.approx(0.4, abs=1e-6)
    rows, _ = vector.reset(seed=0, options={**options, "distance": [0.2, 0.3, 0.4]})
    way = rows["desired_goal"][:, 0] - rows["achieved_goal"][:, 0]
    np.testing.assert_allclose(way, [0.2, 0.3, 0.4], atol=1e-6)
    assert np.array_equal(rows["desired_goal"][2], seen["desired_goal"])
    _, rewards, *_ = vector.step(np.zeros((3, 4)))
    assert rewards[0] > rewards[1] > rewards[2]
    assert rewards[2] == env.step(np.zeros(4))[1]


def test_a_masked_reset_leaves_the_other_robots_as_they_are_shown():
    vector = many(HOVER, "asymmetric", 3, "Disabled")
    vector.reset(seed=0)
    before, *_ = vector.step(np.zeros((3, 6)))
    after, _ = vector.reset(seed=7, options={"reset_mask": np.array([False, True, False])})
    for part in before:
        assert np.array_equal(after[part][[0, 2]], before[part][[0, 2]])
        assert not np.array_equal(after[part][1], before[part][1])


# ---- vectors ----


class Still(HoverTask):
    """The hover with another reward."""

    reward_terms = {"ticks": (1.0, "time")}

    def terms(self, flights):
        """A reward that grows with every tick."""
        return {"ticks": flights.ticks / 100.0}


def test_a_custom_task_works_with_asymmetric_observations():
    task = Still()
    vector = many(HOVER, "asymmetric", 2, "SameStep", task=task, max_episode_steps=4)
    plain = many(HOVER, "vector", 2, "SameStep", task=task, max_episode_steps=4)
    vector.reset(seed=0)
    plain.reset(seed=0)
    ended = 0
    for _ in range(9):
        seen, rewards, *ends, info = vector.step(np.zeros((2, 6)))
        flat, plain_rewards, *plain_ends, told = plain.step(np.zeros((2, 6)))
        assert np.array_equal(seen["observation"], flat)
        assert np.array_equal(rewards, plain_rewards)
        assert same(ends, plain_ends)
        assert np.array_equal(info["term"], told["term"])
        if ends[1].any():
            ended += 1
            assert np.array_equal(info["final_obs"]["observation"], told["final_obs"])
            assert np.array_equal(info["final_info"]["term"], told["final_info"]["term"])
    assert ended == 2


def test_episodes_end_and_begin_only_for_robots_that_moved():
    vector = many(HOVER, "goal", 3, "SameStep", max_episode_steps=3)
    vector.reset(seed=0)
    for _ in range(3):
        vector.advance(np.zeros((3, 6)))
    assert vector.buffers["begun"].all()
    for _ in range(2):
        vector.advance(np.zeros((3, 6)), np.array([1]))
    assert vector.robots["episode"]["ticks"].tolist() == [0, 2, 0]
    vector.advance(np.zeros((3, 6)), np.array([1]))
    assert vector.robots["episode"]["ticks"].tolist() == [0, 0, 0]
    assert vector.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


# ---- refusals ----


def test_invalid_observations_and_goals_are_refused_with_what_would_be_valid():
    with pytest.raises(UnknownNameError, match="unknown observation 'pixels'; valid: vector, scaled, goal, asymmetric"):
        make(HOVER, "pixels")
    for name in (PATH, COURSE):
        with pytest.raises(InvalidValueError, match="expected vector or asymmetric: its goal"):
            make(name, "goal")
    with pytest.raises(UnknownNameError, match="unknown goal_reward 'shaped'; valid: sparse, dense"):
        make(CRAWL, "goal", goal_reward="shaped")
    with pytest.raises(InvalidValueError, match="observation='goal', which has a goal"):
        make(CRAWL, "vector", goal_reward="dense")
    with pytest.raises(InvalidValueError, match="with a custom reward"):
        many(HOVER, "goal", task=Still())
    for env in (make(HOVER, "vector").unwrapped, many(HOVER, "asymmetric")):
        for name in ("compute_reward", "compute_terminated", "compute_truncated"):
            assert not hasattr(env, name)
            with pytest.raises(NoGoalError, match=f"there is no {name} without a goal; valid: observation='goal'"):
                getattr(env, name)


def test_invalid_goals_are_refused_in_one_line():
    env = make(CRAWL, "goal").unwrapped
    with pytest.raises(InvalidValueError, match=r"achieved_goal = \(4,\) is not valid; expected an array of shape"):
        env.compute_reward(np.zeros(4), np.zeros(3), {})
    with pytest.raises(InvalidValueError, match="the shape of achieved_goal"):
        env.compute_reward(np.zeros((2, 3)), np.zeros(3), {})
    with pytest.raises(InvalidValueError, match="numbers of shape"):
        env.compute_reward("here", "there", {})
    with pytest.raises(InvalidValueError, match="info of a step"):
        env.compute_terminated(np.zeros(3), np.zeros(3), {})
    rows, told = np.zeros((2, 3)), [{"failure": ""}, {"failure": "tilt"}]
    assert env.compute_terminated(rows, rows, told).tolist() == [False, True]
    assert env.compute_terminated(rows, rows, {"failure_code": np.array([1, -1])}).tolist() == [True, False]
    assert env.compute_truncated(rows, rows, {}).tolist() == [False, False]
