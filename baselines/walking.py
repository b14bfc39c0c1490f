"""`walking`: torso up, one foot in the air at a time, thrust carries what three feet do not.

After the lab's walk with the same robot (M. Zhao and others, RA-L 2023, cited by [Zhao2025]): contact forces are among
the QP's unknowns beside the rotors', with friction cones; a foot that is lifted has none. Changed: the feet's forces
are bounded by the pyramid of the crawl, joint setpoints and thrust are those of the crawl's stack, and the torso moves
on only while all four feet stand. A move begins and ends lying down, as a crawl does, so both are measured by one task.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from spidar_gym.benchmark import CRAWL, PresetPolicy
from spidar_gym.control.allocation.contact import FrictionPyramid
from spidar_gym.control.allocation.problem import Demand, Mode
from spidar_gym.control.crawl.controller import Crawler, CrawlerConfig
from spidar_gym.control.crawl.footsteps import GaitCommand, GaitConfig, Move
from spidar_gym.control.crawl.gait import LEAST_LIFT, SHORTEN, Gait
from spidar_gym.control.crawl.kinematics import INNER, feet_at, leg_angles
from spidar_gym.control.crawl.phases import Step
from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.errors import InvalidValueError
from spidar_gym.robot import N_LEGS
from spidar_gym.so3 import rotation_z
from spidar_gym.state import Residual

ORDER = (0, 2, 1, 3)
"""Legs, in the order in which they step: one, then the one across."""
STEP = ("raise", "swing", "lower")
"""Phases of one leg."""
RISE, REST = ("brace", "up"), ("down", "settle")
"""Before the first step, and after the last one."""


@dataclass(frozen=True)
class ThreeFeet(FrictionPyramid):
    """The friction pyramid of the feet that stand; the one in the air gives no force."""

    lifted: int = 0
    """Which is in the air."""

    def write(self, demand: Demand, A: np.ndarray, l: np.ndarray, u: np.ndarray) -> None:
        """As the pyramid's, with f_z = 0 for the lifted foot, so that f_x and f_y are 0 too."""
        super().write(demand, A, l, u)
        l[5 * self.lifted + 4] = u[5 * self.lifted + 4] = 0.0


class Walk(Gait):
    """The phase machine of the walk: the crawl's phases in another order, each leg by itself, the torso up."""

    def command(self, commands: Iterable[GaitCommand]) -> int:
        """Append commands; returns how many steps they take: a move is a walk, all else as in the crawl."""
        memory = self.memory
        steps, planned = list(memory.steps), memory.planned
        try:
            for command in commands:
                before = len(memory.steps)
                super().command((command,))
                if isinstance(command, Move):
                    walk = [replace(step, phases=(*STEP * N_LEGS, "forward")) for step in memory.steps[before:]]
                    walk[0] = replace(walk[0], phases=(*RISE, *walk[0].phases))
                    walk[-1] = replace(walk[-1], phases=(*walk[-1].phases, *REST))
                    memory.steps = memory.steps[:before] + walk
        except InvalidValueError:
            memory.steps, memory.planned = steps, planned  # all of them or none
            raise
        return len(memory.steps) - len(steps)

    @property
    def _stepping(self) -> bool:
        """Whether a foot is in the air, or about to be."""
        memory = self.memory
        return memory.phase in STEP and "forward" in memory.steps[0].phases

    @property
    def mode(self) -> str:
        """Allocation mode of the present phase."""
        return f"walk{self.memory.steps[0].legs[0]}" if self._stepping else super().mode

    @property
    def lifted(self) -> np.ndarray:
        """Legs whose joint torque counts: all, where feet carry."""
        return np.ones(N_LEGS, bool) if self._stepping else super().lifted

    def _aim(self, step: Step, residual: Residual) -> None:
        """Set the targets of the phase that begins."""
        memory = self.memory
        if memory.phase == "raise" and "forward" in step.phases:
            leg = ORDER[step.phases[: memory.index].count("raise")]
            step = replace(step, legs=(leg,))
            memory.steps = [step, *memory.steps[1:]]
            self._footstep(step, leg, residual)
        elif memory.phase == "forward":
            self._stand_anew(step, residual)
            return
        super()._aim(step, residual)
        if memory.phase == "brace" and "forward" in step.phases:
            # It rises where it lay: the way begins when the feet have stepped.
            memory.lift = self.config.lift_height * residual.lift_scale
            while memory.lift > LEAST_LIFT and self._reach(0.0, memory.lift) is None:
                memory.lift *= SHORTEN

    def _footstep(self, step: Step, leg: int, residual: Residual) -> None:
        """Where a leg goes: half a stride beyond its home, under the torso as it stands."""
        memory, config = self.memory, self.config
        way, height = self._way_from_here(step, residual), self._height()
        feet = way.arc(0.5).move(self.home_b) - (0.0, 0.0, height + config.press)
        angles = leg_angles(feet)
        landing = memory.plan if angles is None else angles
        rows = slice(4 * leg, 4 * leg + 4)
        memory.start, memory.landing = memory.plan.copy(), memory.plan.copy()
        memory.landing[rows] = landing[rows]
        memory.highest = memory.landing.copy()
        pitch = INNER[leg]
        memory.highest[pitch] = min(memory.plan[pitch], landing[pitch]) - config.raise_angle * residual.raise_scale

    def _height(self) -> float:
        """Filtered height over where the torso lay [m]."""
        memory = self.memory
        return float((memory.position_w - memory.floor_w) @ memory.floor_R[:, 2])

    def _way_from_here(self, step: Step, residual: Residual) -> Pose2:
        """Way to the step's target; it begins on the floor below the torso, on the plane on which it lay."""
        memory = self.memory
        turned = memory.floor_R.T @ memory.R_wb
        yaw = math.atan2(turned[1, 0], turned[0, 0])
        memory.floor_w = memory.position_w - self._height() * memory.floor_R[:, 2]
        memory.floor_R = memory.floor_R @ rotation_z(yaw)
        return self._way(step.target).arc(max(0.0, residual.stride_scale))

    def _stand_anew(self, step: Step, residual: Residual) -> None:
        """The feet stand elsewhere: the way begins below where the torso is."""
        memory = self.memory
        memory.way = self._way_from_here(step, residual)
        memory.feet_f = feet_at(memory.joints) + np.array([0.0, 0.0, self._height()])
        memory.share, memory.trim = 0.0, np.zeros(3)
        memory.expected, memory.yaw = np.zeros(3), 0.0


class Walker(Crawler):
    """The walk's controller: the crawl's, with four modes more."""

    gait_type = Walk

    def modes(self) -> dict[str, Mode]:
        """The crawl's modes, and `walk0` … `walk3`: the stance, in which one foot gives nothing."""
        modes = self.config.modes
        stance = modes["stance"]
        for leg in range(N_LEGS):
            rows = tuple(
                ThreeFeet(block.friction, block.min_normal, leg) if isinstance(block, FrictionPyramid) else block
                for block in stance.constraints
            )
            modes[f"walk{leg}"] = replace(stance, name=f"walk{leg}", constraints=rows)
        return modes


# A foot that begins to swing before it is up, or comes down before it is there, slides: the crawl's feet may, for all
# of them are up at once, and here the others carry.
CONFIG = CrawlerConfig(
    gait=GaitConfig(
        rolling=True, max_distance=0.31, raise_angle=0.12, lift_height=0.04, swing_at=1.0, lower_at=0.08,
        leg_touch_time=0.05, torso_touch_time=0.1, trim_gain=4.0, start_time=0.12, spool_time=0.0, settle_time=0.0,
    ),
    power=True, torque_limit=4.5, foot_friction=0.3, blend_time=0.3,
)  # fmt: skip
"""What it walks with."""


class Walking(PresetPolicy):
    """Walks torso up, one foot in the air at a time, forces of the other three and thrust by one QP; crawls only."""

    presets = {CRAWL: {"controller": CONFIG, "law": Walker}}  # noqa: RUF012 - nobody writes it
