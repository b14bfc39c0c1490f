"""Tables of the robot: the paper's specification beside our numbers, and every number with its source."""

from spidar_gym.robot.spec import ROBOT, RobotSpec, spec_rows
from spidar_gym.text import markdown_rows

SPECIFICATION = (
    ("total mass", "16 kg", lambda s: f"{s.total_mass:.2f} kg", "parts of 15.21 kg scaled to the paper's mass"),
    ("max size (dia.)", "2.7 m", lambda s: f"{s.diameter:.3f} m", ""),
    ("max flight time", "9 min", lambda s: "calibrated to it", "the power model is: `spidar paper flight` prints it"),
    ("max crawl time", "25 min", lambda s: "predicted", "by the same power model: `spidar paper crawl` prints it"),
    ("rotor KV", "1550", lambda s: "not modelled", "the thrust is commanded, not the motor speed"),
    ("propeller diameter", "5 inch", lambda s: f"{2 * s.propeller_radius / 0.0254:.2f} inch", ""),
    ("max thrust (λ̄)", "42 N", lambda s: f"{s.max_thrust:g} N", "per module, that is per pair of fans"),
    ("max vectoring torque", "1.5 Nm", lambda s: f"{s.max_vectoring_torque:g} Nm", ""),
    (
        "link diameter", "0.025 m", lambda s: f"{2 * s.rod_radius:g} m",
        "the lab's package has a collision radius of 0.025 m; the table's 2.5 cm is the rod's diameter",
    ),
    (
        "link length", "0.54 m", lambda s: f"{s.pitch_to_yaw:g} m rod, {s.pitch_to_foot + s.foot_radius:g} m outer",
        "0.54 m is no distance of the lab's kinematics: it lies between the rod and the outer link with its foot; the "
        "span of 2.70 m agrees with the lab's numbers",
    ),
    ("max torque (τ̄_q)", "7 Nm", lambda s: f"{s.max_joint_torque:g} Nm", ""),
    ("max joint speed", "0.2 rad/s", lambda s: f"{s.joint_speed:g} rad/s", ""),
)  # fmt: skip
"""The paper's specification table, cell by cell: name, the paper's value, ours, and the reason where they differ."""


def assets_readme(spec: RobotSpec = ROBOT) -> str:
    """Generate assets/README.md: the paper's specification table beside our numbers, and the source of each number."""
    bodies = (
        (name, f"{body.mass:.4f}", " ".join(f"{c:.5f}" for c in body.com), " ".join(f"{i:.3e}" for i in body.inertia))
        for name, body in spec.bodies.items()
    )
    blocks = [
        "# Assets",
        "Written by `spidar assets` from `spidar_gym/robot.py`; `spidar assets --check` fails when a file is stale.\n"
        "`mjcf/spidar.xml` is the one model that MuJoCo and Pinocchio load, `urdf/spidar.urdf` the same robot for ROS.",
        "## The paper's specification table, cell by cell",
        markdown_rows(
            "[Zhao2025, Tab. 1] | paper | here | remark",
            ((name, paper, ours(spec), remark) for name, paper, ours, remark in SPECIFICATION),
        ),
        "## Every number and its source",
        "[JSK]: facts read from the lab's public robot package as flown for the paper. [estimate]: ours.",
        markdown_rows("name | value | what it is", ((f"`{name}`", value, doc) for name, value, doc in spec_rows(spec))),
        "## Moving bodies, scaled to the total mass",
        markdown_rows("body | mass [kg] | centre of mass [m] | inertia xx yy zz xy xz yz [kg m²]", bodies),
    ]
    return "\n\n".join(blocks) + "\n"
