"""Grasps: `grasp_rule` with a test lift; fixed grips, joints alone, the paper's rows alone; and a ceiling."""

from spidar_gym.benchmark import GRASP, PresetPolicy
from spidar_gym.control.grasp.phases import GraspConfig

STEADY = {"preset": "steady"}


class GraspRule(PresetPolicy):
    """Test lift, then a grip by the measured mass, harder where the feet slipped; grasps only."""

    name = "grasp_rule"
    presets = {GRASP: STEADY}  # noqa: RUF012 - constant


class GraspTold(PresetPolicy):
    """A ceiling: the rule with the true mass and friction, which no robot knows; grasps only."""

    name = "grasp_told"
    kind = "ceiling"
    presets = {GRASP: {**STEADY, "grip": "told"}}  # noqa: RUF012 - constant


class Grasp10(PresetPolicy):
    """A fixed grip of 10 N a foot, or what the object bears; grasps only."""

    name = "grasp_10"
    presets = {GRASP: {**STEADY, "grip": 10.0}}  # noqa: RUF012 - constant


class Grasp20(PresetPolicy):
    """A fixed grip of 20 N a foot, or what the object bears; grasps only."""

    name = "grasp_20"
    presets = {GRASP: {**STEADY, "grip": 20.0}}  # noqa: RUF012 - constant


class Grasp30(PresetPolicy):
    """A fixed grip of 30 N a foot, or what the object bears; grasps only."""

    name = "grasp_30"
    presets = {GRASP: {**STEADY, "grip": 30.0}}  # noqa: RUF012 - constant


class GraspJoints(PresetPolicy):
    """No grip in the allocation: setpoints 0.1 m inside the object press with the servos alone; grasps only."""

    name = "grasp_joints"
    presets = {GRASP: {**STEADY, "grasp": GraspConfig(squeeze=0.1)}}  # noqa: RUF012 - constant


class GraspPaperRows(PresetPolicy):
    """The rule with the paper's interference rows alone, in which the object is no target of jets; grasps only."""

    name = "grasp_paper_rows"
    presets = {GRASP: {**STEADY, "grasp": GraspConfig(avoids=False)}}  # noqa: RUF012 - constant
