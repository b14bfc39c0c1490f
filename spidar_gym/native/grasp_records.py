"""Scenes of grasping as records of the core."""

from typing import Any

import numpy as np

from spidar_gym.control.crawl.pose2 import Pose2
from spidar_gym.control.grasp.scene import GraspScene
from spidar_gym.control.locomotion.commands import OBJECTS
from spidar_gym.native.structs import fill


def write_scene(record: Any, scene: GraspScene) -> None:  # noqa: ANN401 - numpy's row
    """Write a scene into an `sp_grasp_scene`."""
    fill(record, scene)


def read_scene(record: Any) -> GraspScene:  # noqa: ANN401 - numpy's row
    """Return the scene in an `sp_grasp_scene`."""
    numbers: dict[str, Any] = {
        name: record[name].item() for name in ("mass", "friction", "most_force", "stand", "floor")
    }
    numbers |= {name: np.array(record[name]) for name in ("half_size", "com", "bias")}
    numbers |= {name: Pose2(*record[name].tolist()) for name in ("start", "goal")}
    return GraspScene(OBJECTS[int(record["shape"])], **numbers)
