"""`adrc_steady`, `indi_steady`, `compensation_steady`, `mpc_steady`: rivals found in the calibrated world.

Each is the controller of `baselines/adrc.py`, `indi.py`, `compensation.py` or `mpc.py`, whose numbers were searched as
those of the preset `steady`: on robots of the calibrated world, with all margins held, and with the same budget.
"""

from dataclasses import replace

from baselines import adrc, compensation, indi, mpc
from spidar_gym.benchmark import HOVER, PresetPolicy
from spidar_gym.benchmark.track import CALIBRATED, FLIGHT, WORLD
from spidar_gym.tune.flight import NOMINAL_TRACKS, pids, scaled
from spidar_gym.tune.parameter import Parameter
from spidar_gym.tune.search import Search, steady_search

# The starts are the rivals' former results, slower and with slower observers, until their margins are nearly held.
# Without rows against interference vectoring servos and legs ring from lower gains on: `compensation` begins slowest.
_ADRC = adrc.SEARCH.arguments(adrc.FOUND)["controller"]
_INDI = indi.SEARCH.arguments(indi.FOUND)["controller"]
_COMPENSATION = compensation.SEARCH.arguments(compensation.FOUND)["controller"]
ADRC_SEARCH = steady_search("adrc_steady", scaled(_ADRC, 0.8), names=indi.FREE)
"""`spidar tune baselines.steady_rivals:ADRC_SEARCH`."""
INDI_SEARCH = steady_search(
    "indi_steady",
    scaled(replace(_INDI, compensation=replace(_INDI.compensation, observer_time=0.5, torque_observer_time=0.8)), 0.75),
    names=indi.FREE,
)
"""`spidar tune baselines.steady_rivals:INDI_SEARCH`."""
COMPENSATION_SEARCH = steady_search(
    "compensation_steady",
    scaled(
        replace(
            _COMPENSATION,
            centroidal=pids((20.0, 0.06, 5.5), (24.0, 3.0, 6.5), (24.0, 0.9, 6.0), (30.0, 5.0, 6.5)),
            compensation=replace(
                _COMPENSATION.compensation, observer_gain=0.2, observer_time=0.4, torque_observer_gain=0.2,
                torque_observer_time=0.4, torque_observer_lag=0.29,
            ),
        ),
        0.6,
    ),
    names=compensation.RETUNED_NAMES,
    **compensation.FREE,
)  # fmt: skip
"""`spidar tune baselines.steady_rivals:COMPENSATION_SEARCH`."""
_MPC = {
    name: value * (0.5 if name.endswith("bandwidth") and name != "servo_bandwidth" else 1.0)
    for name, value in mpc.FOUND.items()
} | {f"{key}_observer": min(1.9, 2.0 * mpc.FOUND[f"{key}_observer"]) for key in mpc.KEYS}
MPC_PARAMETERS = (
    *(Parameter(f"{key}_bandwidth", _MPC[f"{key}_bandwidth"], 2.0, mpc.FASTEST) for key in mpc.KEYS),
    *(replace(own, start=_MPC[own.name]) for own in mpc.PARAMETERS),
)
"""As those of `mpc`, with the bandwidths, which the margins of rigid legs determine there."""
MPC_SEARCH = Search(
    "mpc_steady", CALIBRATED[FLIGHT], "tuned_v1", MPC_PARAMETERS, mpc.arguments, by_pattern=True, legs=WORLD,
    also=NOMINAL_TRACKS,
)  # fmt: skip
"""`spidar tune baselines.steady_rivals:MPC_SEARCH`."""

ADRC_FOUND = {
    "xy_p": 23.83, "xy_d": 7.127, "z_p": 21.52, "z_d": 9.186, "roll_pitch_p": 20.52, "roll_pitch_d": 6.279,
    "yaw_p": 25.85, "yaw_d": 5.644, "momentum_gain": 1.215, "vectoring_lead": 0.04995, "observer_time": 0.3146,
    "observer_lag": 0.018, "torque_observer_time": 0.2932, "torque_observer_lag": 0.07287,
}  # fmt: skip
"""Result of its search: the last line of `baselines/searches/adrc_steady.json`."""
INDI_FOUND = {
    "xy_p": 15.62, "xy_d": 4.584, "z_p": 17.96, "z_d": 8.185, "roll_pitch_p": 26.29, "roll_pitch_d": 5.866,
    "yaw_p": 29.34, "yaw_d": 5.334, "momentum_gain": 1.297, "vectoring_lead": 0.05185, "observer_time": 0.354,
    "observer_lag": 0.07274, "torque_observer_time": 0.5278, "torque_observer_lag": 0.1654,
}  # fmt: skip
"""Result of its search: the last line of `baselines/searches/indi_steady.json`."""
COMPENSATION_FOUND = {
    "xy_p": 18.87, "xy_i": 0.01296, "xy_d": 4.201, "z_p": 22.64, "z_i": 1.698, "z_d": 6.795,
    "roll_pitch_p": 22.64, "roll_pitch_i": 0.5094, "roll_pitch_d": 6.273, "yaw_p": 18.82, "yaw_i": 0.9925,
    "yaw_d": 3.9, "momentum_gain": 1.173, "vectoring_lead": 0.05092, "observer_gain": 0.3461,
    "observer_time": 0.43, "observer_lag": 0.09076, "torque_observer_gain": 0.2538, "torque_observer_time": 0.4,
    "torque_observer_lag": 0.4286, "lead_gain": 0.06018, "lead_time": 0.05202,
}  # fmt: skip
"""Result of its search: the last line of `baselines/searches/compensation_steady.json`."""
MPC_FOUND = {
    "xy_bandwidth": 3.705, "z_bandwidth": 6.438, "roll_pitch_bandwidth": 4.73, "yaw_bandwidth": 6.058,
    "xy_damping": 0.001165, "z_damping": 0.002521, "roll_pitch_damping": 0.001142, "yaw_damping": 0.00118,
    "xy_observer": 0.6843, "z_observer": 1.9, "roll_pitch_observer": 0.5246, "yaw_observer": 0.6185,
    "belief": 0.04174, "lag": 0.02212, "delay": 0.2784, "servo_bandwidth": 22.2, "vectoring_lead": 0.04626,
}  # fmt: skip
"""Result of its search: the last line of `baselines/searches/mpc_steady.json`."""


def _training(search: str) -> dict[str, object]:
    """Return the origin of the parameters of a search of this module."""
    return {"command": f"spidar tune baselines.steady_rivals:{search} --scenarios 6 --generations 60", "seed": 0}


class AdrcSteady(PresetPolicy):
    """Disturbance rejection, as `adrc`, searched on calibrated robots; flights only."""

    name = "adrc_steady"
    training = _training("ADRC_SEARCH")
    presets = {HOVER: ADRC_SEARCH.arguments(ADRC_FOUND)}  # noqa: RUF012 - constant


class IndiSteady(PresetPolicy):
    """Incremental inversion, as `indi`, searched on calibrated robots; flights only."""

    name = "indi_steady"
    training = _training("INDI_SEARCH")
    presets = {HOVER: INDI_SEARCH.arguments(INDI_FOUND)}  # noqa: RUF012 - constant


class CompensationSteady(PresetPolicy):
    """Interference cancelled, as `compensation`, searched on calibrated robots; flights only."""

    name = "compensation_steady"
    training = _training("COMPENSATION_SEARCH")
    presets = {HOVER: COMPENSATION_SEARCH.arguments(COMPENSATION_FOUND)}  # noqa: RUF012 - constant


class MPCSteady(PresetPolicy):
    """Predictive control, as `mpc`, searched on calibrated robots; flights only."""

    name = "mpc_steady"
    training = _training("MPC_SEARCH")
    presets = {HOVER: mpc.arguments(MPC_FOUND)}  # noqa: RUF012 - constant
