"""`adrc_steady`, `indi_steady`, `compensation_steady`, `mpc_steady`: rivals found in the calibrated world.

Each is the controller of `baselines/adrc.py`, `indi.py`, `compensation.py` or `mpc.py`, whose numbers were searched as
those of the preset `steady`: on robots of the calibrated world, with all margins held, and with the same budget.
"""

from dataclasses import replace

from baselines import adrc, compensation, indi, mpc
from spidar_gym.benchmark.track import CALIBRATED, FLIGHT, WORLD
from spidar_gym.tune.flight import NOMINAL_TRACKS, pids, scaled
from spidar_gym.tune.parameter import Parameter
from spidar_gym.tune.search import Search, steady_search

# The starts are the rivals' former results, slower and with slower observers, until their margins are nearly held.
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
    replace(
        _COMPENSATION,
        centroidal=pids((20.0, 0.06, 5.5), (24.0, 3.0, 6.5), (24.0, 0.9, 6.0), (30.0, 5.0, 6.5)),
        compensation=replace(
            _COMPENSATION.compensation, observer_gain=0.4, observer_time=0.2, torque_observer_gain=0.4,
            torque_observer_time=0.2, torque_observer_lag=0.29,
        ),
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
