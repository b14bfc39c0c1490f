"""The benchmark: tracks, scenarios, policies, evaluation, rows, leaderboard."""

from spidar_gym.benchmark.evaluate import Score, evaluate
from spidar_gym.benchmark.scenario import Scenario, load_scenarios
from spidar_gym.benchmark.track import TRACKS, Track
from spidar_gym.envs.registry import COURSE, CRAWL, GRASP, HOVER
from spidar_gym.policies.policy import Policy
from spidar_gym.policies.presets import PresetPolicy
from spidar_gym.policies.source import PolicyError

__all__ = [
    "COURSE", "CRAWL", "GRASP", "HOVER", "TRACKS", "Policy", "PolicyError", "PresetPolicy", "Scenario", "Score",
    "Track", "evaluate", "load_scenarios",
]  # fmt: skip
