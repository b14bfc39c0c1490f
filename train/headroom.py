"""Measure the potential of each channel of the action before training: paired comparison of simple rules with the base.

python -m train.headroom tuned
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import tyro

from spidar_gym.console import progress, run_cli
from spidar_gym.control.crawl.observation import crawl_layout
from spidar_gym.control.flight.observation import layout
from spidar_gym.control.presets import CRAWL_PRESETS, FORMER_CRAWL_PRESETS, FORMER_PRESETS, PRESETS
from spidar_gym.envs import actions
from spidar_gym.errors import require_least, require_name
from spidar_gym.processes import Pool, cpu_count
from spidar_gym.text import format_table
from train.lib import envs
from train.lib.config import CONTROL
from train.lib.evaluate import Base, PairedEvaluator, Verdict

Seen = Mapping[str, np.ndarray]
"""Pieces of an observation by name."""
Rules = Mapping[str, tuple[str, Callable[[Seen], np.ndarray]]]
"""Rule → its action mode, and its action as a function of the observation."""


@dataclass(frozen=True)
class Args:
    """Compare simple rules in each channel of the action with the base controller."""

    base: tyro.conf.Positional[str]
    """Controller: paper, as_flown, as_flown_quasi, tuned; published, overlapped, robust, robust_overlapped."""
    scenarios: int = 6
    """Number of validation scenarios of each track."""
    control: str = CONTROL
    """Controller implementation: python, or core, which is compiled and several times faster."""
    workers: int = cpu_count()
    """Number of processes that run scenarios."""

    def __post_init__(self) -> None:
        if self.base not in (*FORMER_PRESETS, *FORMER_CRAWL_PRESETS):
            require_name("preset", self.base, (*PRESETS, *CRAWL_PRESETS))
        require_least(1, scenarios=self.scenarios, workers=self.workers)


def constant(entry: int, value: float, size: int, seen: Seen) -> np.ndarray:
    """Return an action with a constant value in one entry and zeros elsewhere."""
    action = np.zeros(size)
    action[entry] = value
    return action


def ahead(seconds: float, seen: Seen) -> np.ndarray:
    """Shift the joint targets ahead of the plan, or behind it if `seconds` is negative."""
    return np.append(seconds * seen["joint_command_velocity"] / actions.JOINT_AUTHORITY, 0.0)


def form_early(seconds: float, seen: Seen) -> np.ndarray:
    """Move the joint targets towards the next form before it becomes the target."""
    if seen["time_to_next_form"][0] >= seconds:
        return np.zeros(actions.JOINTS.size + 1)
    return np.append((seen["next_form"] - seen["joint_position"]) / actions.JOINT_AUTHORITY, 0.0)


def leg_torque(fraction: float, seen: Seen) -> np.ndarray:
    """Add a fraction of the torque that changes the legs' angular momentum."""
    return np.concatenate((np.zeros(3), fraction * seen["leg_momentum_rate"] / actions.WRENCH_AUTHORITY[3:]))


def legs_pulled(force: float, seen: Seen) -> np.ndarray:
    """Pull every leg along the torso's vertical axis with a force [N]."""
    action = np.zeros(actions.CRAWL_MODES["residual_gait_force"].size)
    action[actions.GAIT.size + 2 :: 3] = force / actions.LEG_AUTHORITY
    return action


def joint_speed(scale: float) -> tuple[str, Callable[[Seen], np.ndarray]]:
    """Scale the speed of the joint plan."""
    size = actions.JOINTS.size
    return "residual_joint", partial(constant, size, (scale - 1.0) / actions.SPEED_AUTHORITY, size + 1)


def gait_parameter(entry: int, scale: float) -> tuple[str, Callable[[Seen], np.ndarray]]:
    """Scale one parameter of the gait."""
    authority = actions.SPEED_AUTHORITY if entry == 0 else actions.GAIT_AUTHORITY
    return "residual_gait", partial(constant, entry, (scale - 1.0) / authority, actions.GAIT.size)


IN_FLIGHT: Rules = {
    **{f"joint speed × {scale:g}": joint_speed(scale) for scale in (1.1, 0.9, 0.8)},
    **{
        f"joint targets {abs(s) * 1e3:.0f} ms {'ahead' if s > 0 else 'behind'}": (
            "residual_joint",
            partial(ahead, s),
        )
        for s in (0.02, -0.02, -0.05)
    },
    "next form 0.2 s early": ("residual_joint", partial(form_early, 0.2)),
    **{
        f"torque of {fraction:g} ḣ of the legs": ("residual_wrench", partial(leg_torque, fraction))
        for fraction in (-0.25, 0.25, 0.5)
    },
}
"""Rules for flight."""
ON_THE_GROUND: Rules = {
    **{
        f"{name} × {scale:g}": gait_parameter(entry, scale)
        for entry, name in enumerate(("phase rate", "raise", "stride", "lift height"))
        for scale in (1.1, 0.9)
    },
    **{f"legs pulled by {force:+g} N": ("residual_gait_force", partial(legs_pulled, force)) for force in (2.0, -2.0)},
}
"""Rules for crawling."""


class Rule(Base):
    """Policy of a rule whose action is added to a controller."""

    def __init__(self, preset: str, mode: str, action: Callable[[Seen], np.ndarray]) -> None:
        """Store the controller, the action mode and the action as a function of the observation."""
        super().__init__({"preset": preset, "action_mode": mode})
        self._action = action
        flies = preset in (*PRESETS, *FORMER_PRESETS)
        modes = actions.ACTION_MODES if flies else actions.CRAWL_MODES
        fields = (layout if flies else crawl_layout)(modes[mode].size)
        self._names, self._ends = [field.name for field in fields], np.cumsum([field.size for field in fields[:-1]])

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Compute the rule's action, clipped to ± 1."""
        pieces = np.split(observation, self._ends)
        return np.clip(self._action(dict(zip(self._names, pieces, strict=True))), -1.0, 1.0)


def measured_on(base: str) -> tuple[tuple[str, ...], Rules]:
    """Return the tracks and rules for a controller."""
    return (envs.FLIGHTS, IN_FLIGHT) if base in (*PRESETS, *FORMER_PRESETS) else (("ground-randomised",), ON_THE_GROUND)


def measure(args: Args, on_scenario: Callable[[], object] = lambda: None) -> dict[str, Verdict]:
    """Compare each rule with the base alone on validation scenarios: rule → verdict."""
    tracks, rules = measured_on(args.base)
    with Pool(args.workers) as pool:
        alone = Base({"preset": args.base})
        evaluator = PairedEvaluator(
            tracks, alone, args.scenarios, control=args.control, on_scenario=on_scenario, each=pool.map
        )  # fmt: skip
        return {name: evaluator.evaluate(Rule(args.base, *rule), on_scenario) for name, rule in rules.items()}


def headroom_table(base: str, verdicts: Mapping[str, Verdict]) -> str:
    """Format a line for each rule: change of each metric on each track [%], and of the success rate if it changed."""
    first = next(iter(verdicts.values())).cells
    lines = [[f"on {base}", *first, "success"]]
    for name, verdict in verdicts.items():
        cells = [" / ".join(f"{100.0 * value:+.1f}" for value in cell.values()) for cell in verdict.cells.values()]
        lines.append([name, *cells, f"{verdict.success:+.0%}" if verdict.success else ""])
    metrics = ", ".join(next(iter(first.values())))
    return f"change of {metrics} on the validation scenarios [%]:\n\n{format_table(lines)}"


def main() -> None:
    """Entry point."""
    args = tyro.cli(Args, description=__doc__, prog="python -m train.headroom")
    tracks, rules = measured_on(args.base)
    total = (1 + len(rules)) * len(tracks) * args.scenarios
    with progress(total=total, unit="scenario", desc=f"headroom of {args.base}") as bar:
        verdicts = measure(args, bar.update)
    print(headroom_table(args.base, verdicts))


if __name__ == "__main__":
    run_cli("train.headroom", main)
