"""NumPy reference of native/engine/floor.c: contacts between the robot and the floor."""

# pyright: reportAttributeAccessIssue=false
# The compiled modules below come without stubs.

import mujoco
import numpy as np

from spidar_gym.robot import N_LEGS, N_ROTORS, PEG_SITES, ROBOT
from spidar_gym.sim.ground import GroundConfig, Touch


class GroundWatch:
    """Reads the contacts of one simulation, and enables or disables MuJoCo's collision detection."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Look up the geometries that may touch the floor."""
        self._model, self._data = model, data
        names = [f"foot{leg}" for leg in range(1, N_LEGS + 1)] + list(PEG_SITES)
        self._balls = [model.geom(name).id for name in names]
        radii = [ROBOT.foot_radius] * N_LEGS + [ROBOT.peg_radius] * len(PEG_SITES)
        self._radii = np.array(radii)
        bodies = {model.body(f"gimbal{i}_pitch_module").id for i in range(1, N_ROTORS + 1)}
        colliding = (model.geom_conaffinity > 0) & (model.geom_type == mujoco.mjtGeom.mjGEOM_CYLINDER)
        self._ducts = np.array([g for g in range(model.ngeom) if model.geom_bodyid[g] in bodies and colliding[g]])
        self._duct_size = model.geom_size[self._ducts, :2].copy()
        self._kind = np.full(model.ngeom, -1)
        self._kind[self._balls] = np.arange(len(names))
        self._kind[self._ducts] = len(names)
        self._x, self._R, self._options = data.geom_xpos, data.geom_xmat, model.opt
        self._reach = model.geom_rbound.copy()
        self._reach[model.geom_contype > 0] = -np.inf  # the floor itself
        self._enabled = True
        self._twist, self._com = data.cvel, data.subtree_com
        self._carriers = model.geom_bodyid[self._balls[:8]]
        self._root = int(model.body_rootid[self._carriers[0]])

    def clearance(self, ground: GroundConfig) -> float:
        """Lower bound of the height of all geometries above the highest tile [m]."""
        return float((self._x @ ground.R_wf[:, 2] - self._reach).min()) - ground.highest_tile

    def enable(self, enabled: bool) -> None:
        """Enable or disable collision detection; far above the floor the result is the same without it."""
        if enabled != self._enabled:
            self._options.disableflags ^= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
            self._enabled = enabled

    def look(self, ground: GroundConfig) -> Touch:
        """Contacts of feet, pegs and ducts with the floor in the present state."""
        data, n, R_wf = self._data, len(self._balls), ground.R_wf
        touching = np.zeros(n + 2, bool)
        if data.ncon:
            touching[self._kind[data.contact.geom].reshape(-1)] = True
        normal = R_wf[:, 2]
        slip = np.zeros(8)
        if touching[:8].any():
            twist = self._twist.take(self._carriers, axis=0)
            x, y, z = (self._x.take(self._balls[:8], axis=0) - self._com[self._root] - self._radii[:8, None] * normal).T
            wx, wy, wz, vx, vy, vz = twist.T
            v = np.stack((vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x))
            along = (v * v).sum(axis=0) - (normal @ v) ** 2
            slip = np.where(touching[:8], np.sqrt(np.maximum(along, 0.0)), 0.0)
        centres = self._x.take(self._ducts, axis=0)
        upright = np.abs(self._R.take(self._ducts, axis=0).reshape(-1, 3, 3)[:, :, 2] @ normal)
        radius, half = self._duct_size.T
        low = centres @ normal - radius * np.sqrt(np.maximum(0.0, 1.0 - upright * upright)) - half * upright
        if ground.uneven:
            low = low - ground.height(centres @ R_wf)
        return Touch(
            touching[:N_LEGS], touching[N_LEGS:n], bool(touching[n]), slip[:N_LEGS], slip[N_LEGS:], float(low.min())
        )

    def forces(self) -> np.ndarray:
        """Position and force of each contact with the floor, world: (k, 6) [m, N]."""
        data, wrench = self._data, np.zeros(6)
        rows = np.zeros((data.ncon, 6))
        for k in range(data.ncon):
            mujoco.mj_contactForce(self._model, data, k, wrench)
            force = data.contact.frame[k].reshape(3, 3).T @ wrench[:3]
            # MuJoCo returns the force on the second geom; the floor can only push.
            rows[k, :3], rows[k, 3:] = data.contact.pos[k], force if force[2] >= 0.0 else -force
        return rows
