"""What each door of the action is worth before anybody learns: simple rules through it, against the base in pairs.

python -m train.headroom tuned
"""

import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import tyro
from tqdm import tqdm

from spidar_gym.benchmark.policy import PresetPolicy
from spidar_gym.benchmark.row import cores
from spidar_gym.benchmark.tables import aligned
from spidar_gym.benchmark.track import find_track
from spidar_gym.control.core import core_path
from spidar_gym.control.crawl_observation import crawl_layout
from spidar_gym.control.observation import layout
from spidar_gym.control.presets import CRAWL_PRESETS, PRESETS
from spidar_gym.envs import actions
from spidar_gym.errors import require_least, require_name
from spidar_gym.terminal import speak_plainly
from train.referee import FLIGHT, GROUND, Base, Referee, Verdict

Seen = Mapping[str, np.ndarray]
"""Pieces of an observation by name."""
FLIGHTS = ("flight-forms", "flight-fast3", "flight-fast5", "flight-randomised")
WALKS = ("ground-randomised",)


@dataclass(frozen=True)
class Args:
    """What each door of the action is worth before anybody learns."""

    base: tyro.conf.Positional[str]
    """Controller: paper, as_flown, tuned; published, overlapped, robust, robust_overlapped."""
    scenarios: int = 6
    """Validation scenarios of each track."""
    control: str = "core" if core_path().is_file() else "python"
    """python, or core: the compiled controller, several times faster; core where `spidar export --build` made it."""
    workers: int = cores()
    """Processes that fly."""

    def __post_init__(self) -> None:
        """Refuse what cannot be measured."""
        require_name("preset", self.base, (*PRESETS, *CRAWL_PRESETS))
        require_least(1, scenarios=self.scenarios, workers=self.workers)


def one(entry: int, value: float, size: int, seen: Seen) -> np.ndarray:
    """The same number in one entry, always."""
    action = np.zeros(size)
    action[entry] = value
    return action


def ahead(seconds: float, seen: Seen) -> np.ndarray:
    """Joint targets ahead of the plan, or behind it where negative."""
    return np.append(seconds * seen["joint_command_velocity"] / actions.JOINT_AUTHORITY, 0.0)


def early(seconds: float, seen: Seen) -> np.ndarray:
    """Joint targets that begin to move towards the next form before it is the target."""
    if seen["time_to_next_form"][0] >= seconds:
        return np.zeros(actions.JOINTS.size + 1)
    return np.append((seen["next_form"] - seen["joint_position"]) / actions.JOINT_AUTHORITY, 0.0)


def fed_forward(share: float, seen: Seen) -> np.ndarray:
    """A share of the torque that changes the legs' angular momentum."""
    return np.concatenate((np.zeros(3), share * seen["leg_momentum_rate"] / actions.WRENCH_AUTHORITY[3:]))


def pulled(force: float, seen: Seen) -> np.ndarray:
    """Every leg pulled along the torso's vertical."""
    action = np.zeros(actions.CRAWL_MODES["residual_gait_force"].size)
    action[actions.GAIT.size + 2 :: 3] = force / actions.LEG_AUTHORITY
    return action


def timed(scale: float) -> tuple[str, Callable[[Seen], np.ndarray]]:
    """The whole plan faster or slower."""
    size = actions.JOINTS.size
    return "residual_joint", partial(one, size, (scale - 1.0) / actions.SPEED_AUTHORITY, size + 1)


def shaped(entry: int, scale: float) -> tuple[str, Callable[[Seen], np.ndarray]]:
    """One number of the gait, scaled."""
    authority = actions.SPEED_AUTHORITY if entry == 0 else actions.GAIT_AUTHORITY
    return "residual_gait", partial(one, entry, (scale - 1.0) / authority, actions.GAIT.size)


IN_FLIGHT: dict[str, tuple[str, Callable[[Seen], np.ndarray]]] = {
    **{f"joint speed × {scale:g}": timed(scale) for scale in (1.1, 0.9, 0.8)},
    **{
        f"joint targets {abs(s) * 1e3:.0f} ms {'ahead' if s > 0 else 'behind'}": ("residual_joint", partial(ahead, s))
        for s in (0.02, -0.02, -0.05)
    },
    "next form 0.2 s early": ("residual_joint", partial(early, 0.2)),
    **{
        f"torque of {share:g} ḣ of the legs": ("residual_wrench", partial(fed_forward, share))
        for share in (-0.25, 0.25, 0.5)
    },
}
"""Rule → its action mode, and the action by what is seen."""
ON_THE_GROUND: dict[str, tuple[str, Callable[[Seen], np.ndarray]]] = {
    **{
        f"{name} × {scale:g}": shaped(entry, scale)
        for entry, name in enumerate(("phase rate", "raise", "stride", "lift height"))
        for scale in (1.1, 0.9)
    },
    **{f"legs pulled by {force:+g} N": ("residual_gait_force", partial(pulled, force)) for force in (2.0, -2.0)},
}
"""… and on the ground."""


class Rule(PresetPolicy):
    """A rule on top of a controller."""

    def __init__(self, preset: str, mode: str, action: Callable[[Seen], np.ndarray]) -> None:
        """Take the controller, the action mode and the action by what is seen."""
        self._arguments, self._action = {"preset": preset, "action_mode": mode}, action
        flies = preset in PRESETS
        modes = actions.ACTION_MODES if flies else actions.CRAWL_MODES
        fields = (layout if flies else crawl_layout)(modes[mode].size)
        ends = np.cumsum([field.size for field in fields])
        self._pieces = {f.name: slice(end - f.size, end) for f, end in zip(fields, ends.tolist(), strict=True)}

    def arguments(self, env_id: str) -> Mapping[str, Any]:
        """The same for every environment."""
        return self._arguments

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The rule's action, within its bounds."""
        return np.clip(self._action({name: observation[at] for name, at in self._pieces.items()}), -1.0, 1.0)


def measure(args: Args, on_scenario: Callable[[], object] = lambda: None) -> dict[str, Verdict]:
    """Rule → how it does against the base alone, on the validation scenarios of the base's tracks."""
    flies = args.base in PRESETS
    tracks, rules = (FLIGHTS, IN_FLIGHT) if flies else (WALKS, ON_THE_GROUND)
    with ProcessPoolExecutor(args.workers) as pool:
        base = Base({"preset": args.base})
        referee = Referee(
            tracks, base, args.scenarios, control=args.control, on_scenario=on_scenario, each=pool.map
        )  # fmt: skip
        return {name: referee.judge(Rule(args.base, *rule), on_scenario) for name, rule in rules.items()}


def headroom_table(base: str, verdicts: Mapping[str, Verdict]) -> str:
    """A line a rule: change of each metric on each track [%], and of success where it changed."""
    tracks = list(next(iter(verdicts.values())).cells)
    lines = [[f"on {base}", *tracks, "success"]]
    for name, verdict in verdicts.items():
        cells = [" / ".join(f"{100.0 * value:+.1f}" for value in verdict.cells[track].values()) for track in tracks]
        lines.append([name, *cells, f"{verdict.success:+.0%}" if verdict.success else ""])
    metrics = FLIGHT if find_track(tracks[0]).flies else GROUND
    return "\n".join(
        [
            f"change of {', '.join(metrics)} on the validation scenarios [%]:",
            "",
            aligned(lines),
        ]
    )


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.headroom")
    tracks, rules = (FLIGHTS, IN_FLIGHT) if args.base in PRESETS else (WALKS, ON_THE_GROUND)
    total = (1 + len(rules)) * len(tracks) * args.scenarios
    with tqdm(total=total, unit="scenario", desc=f"headroom of {args.base}", file=sys.__stderr__) as bar:
        verdicts = measure(args, bar.update)
    print(headroom_table(args.base, verdicts))


if __name__ == "__main__":
    speak_plainly("train.headroom", main)
