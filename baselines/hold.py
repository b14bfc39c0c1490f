"""`hold`: one constant command, hover thrust with the angles that the robot starts with, and no feedback."""

import numpy as np

from spidar_gym.benchmark import HOVER
from spidar_gym.control.flight.observation import layout
from spidar_gym.robot import N_ROTORS, ROBOT


class Hold:
    """A constant hover command without feedback: rotors and joints as in the first moment; flights only."""

    kind = "classical"

    def arguments(self, env_id: str) -> dict | None:
        """No controller at all; on the ground no constant command crawls."""
        return {"action_mode": "direct"} if env_id == HOVER else None

    def begin(self, action_size: int) -> None:
        """Learn where the angles stand in the observation."""
        fields = layout(action_size)
        ends = np.cumsum([field.size for field in fields])
        self.where = {f.name: slice(end - f.size, end) for f, end in zip(fields, ends.tolist(), strict=True)}

    def reset(self, seed: int) -> None:
        """Nothing is commanded yet."""
        self.command: np.ndarray | None = None

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The first action, whatever is seen later."""
        if self.command is None:
            seen = {name: observation[place] for name, place in self.where.items()}
            vectoring = np.arctan2(seen["vectoring_sine"], seen["vectoring_cosine"]).reshape(N_ROTORS, 2)
            thrust = np.full(N_ROTORS, 2.0 * ROBOT.hover_thrust / ROBOT.max_thrust - 1.0)
            joints = seen["joint_position"] / ROBOT.joint_limit
            self.command = np.concatenate([thrust, vectoring[:, 0] / np.pi, vectoring[:, 1] / np.pi, joints])
        return self.command
