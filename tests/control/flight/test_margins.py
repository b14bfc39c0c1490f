"""Pins the margins: the gain and delay at which a simulated loop becomes unstable, including the observer."""

import math
from dataclasses import replace

import numpy as np
import pytest

from spidar_gym.control.flight.centroidal import CentroidalConfig
from spidar_gym.control.flight.controller import ControllerConfig
from spidar_gym.control.flight.margins import AXES, DELAY, LAG, margins
from spidar_gym.control.presets import PRESETS, controller_config
from spidar_gym.tune.flight import loops, shortfall

H = 0.0005


def gains(config: ControllerConfig, axis: int) -> tuple[float, float, float]:
    c = config.centroidal
    return (c.position_gains[0], c.position_gains[2], c.attitude_gains[0], c.attitude_gains[2])[axis]


def growth(config: ControllerConfig, axis: int, gain: float = 1.0, delay: float = 0.0) -> float:
    """Largest |x| of the last third of a simulation from x = 1 over that of the second third.

    The plant is x'' = lagged, delayed feedback."""
    kp, ki, kd = gains(config, axis)
    o = config.compensation
    x, v, a, integral, first, estimate, believed = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    share, time, lag = o.observer_gain, o.observer_time, o.observer_lag
    if axis >= 2:
        share, time, lag = o.torque_observer_gain or share, o.torque_observer_time or time, o.torque_observer_lag or lag
    line = [0.0] * max(1, round((DELAY + delay) / H))
    slow, kept = [0.0] * round(1.0 / (config.rate_hz * H)), math.exp(-1.0 / (config.rate_hz * o.lead_time))
    seconds, peaks = 60.0, []
    for _ in range(round(seconds / H)):
        integral += H * x
        # The observer: ŵ follows the acceleration beyond the modelled one of the rotors.
        feedback = -(kp * x + ki * integral + kd * v)
        # The low-pass of the lead is discrete with the control period; here it runs at every step of H.
        slow.append(feedback + kept * (slow.pop(0) - feedback))
        u = feedback + o.lead_gain * (feedback - slow[-1]) - share * estimate
        first += H / time * (a - believed - first)
        passed = first if o.observer_order == 2 else a - believed
        estimate += H / time * (passed - estimate)
        believed += H / lag * (u - believed)
        line.append(u)
        a += H / LAG * (gain * line.pop(0) - a)
        v += H * a
        x += H * v
        peaks.append(abs(x))
        if abs(x) > 1e6:
            return math.inf
    third = len(peaks) // 3
    return max(peaks[2 * third :]) / max(peaks[third : 2 * third])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("preset", "options"),
    [
        ("paper", {}),
        ("tuned", {}),
        ("tuned", {"observer_order": 2}),
        ("tuned", {"lead_gain": 0.3, "lead_time": 0.15, "torque_observer_time": 0.35}),
        ("tuned", {"torque_observer_gain": 0.5, "torque_observer_lag": 0.1}),
    ],
)
@pytest.mark.parametrize("axis", range(len(AXES)))
def test_a_loop_bears_its_margins_and_no_more(preset, axis, options):
    config = controller_config(preset)
    config = replace(config, compensation=replace(config.compensation, **options))
    m = margins(config, axis)
    assert growth(config, axis) < 1.0
    assert growth(config, axis, gain=0.94 * m.gain) < 1.0 < growth(config, axis, gain=1.06 * m.gain)
    assert growth(config, axis, delay=0.94 * m.delay) < 1.0 < growth(config, axis, delay=1.06 * m.delay)


def trembling(config: ControllerConfig, axis: int) -> float:
    """RMS of the commanded acceleration over that of a white error of the rate, sampled every tick for 200 s."""
    (kp, ki, kd), o, dt, fine = gains(config, axis), config.compensation, 1.0 / config.rate_hz, 10
    share, time, lag = o.observers[axis // 2]
    passes = [1.0 - math.exp(-dt / each) for each in (time, lag, o.lead_time)]
    rng, line = np.random.default_rng(0), [0.0] * round((DELAY - 0.5 * dt) / dt * fine)
    x = v = a = integral = slow = estimate = first = believed = u = before = 0.0
    noise, asked = rng.normal(size=8000), list[float]()
    for error in noise.tolist():
        believed += passes[1] * (u - believed)
        residual = (v + error - before) / dt - believed
        first += (passes[0] if o.observer_order == 2 else 1.0) * (residual - first)
        estimate += passes[0] * (first - estimate)
        before = v + error
        integral += dt * x
        feedback = -(kp * x + ki * integral + kd * before)
        slow += passes[2] * (feedback - slow)
        u = feedback + o.lead_gain * (feedback - slow) - share * estimate
        asked.append(u)
        for _ in range(fine):
            line.append(u)
            a += (1.0 - math.exp(-dt / fine / LAG)) * (line.pop(0) - a)
            v += dt / fine * a
            x += dt / fine * v
    return float(np.std(asked[400:]) / np.std(noise[400:]))


@pytest.mark.parametrize(
    ("preset", "options"),
    [
        ("paper", {}), ("tuned", {}), ("tuned", {"observer_order": 2}),
        ("tuned", {"lead_gain": 0.5, "lead_time": 0.04}),
        ("tuned", {"torque_observer_gain": 0.5, "torque_observer_time": 0.1, "torque_observer_lag": 0.1}),
    ],
)  # fmt: skip
def test_the_gain_of_rate_noise_is_that_of_the_margins(preset, options):
    config = controller_config(preset)
    config = replace(config, compensation=replace(config.compensation, **options))
    for axis in range(len(AXES)):
        assert trembling(config, axis) == pytest.approx(margins(config, axis).noise, rel=0.03)


def test_a_loop_that_is_unstable_has_no_margins():
    wild = replace(CentroidalConfig(), position_gains=((3.6, 0.03, 400.0),) * 3)
    m = margins(ControllerConfig(centroidal=wild), 0)
    assert (m.gain, m.delay, m.phase) == (0.0, 0.0, 0.0)
    assert math.isinf(m.sensitivity)
    assert math.isinf(m.noise)
    assert shortfall(loops(ControllerConfig(centroidal=wild))) > 1.0


def test_every_preset_keeps_the_margins_that_tuning_demands():
    for name in PRESETS:
        if PRESETS[name].motion == "observed":
            continue  # its margins know the legs: tests/native/test_margins.py
        assert shortfall(loops(controller_config(name))) == 0.0


@pytest.mark.parametrize("preset", ["tuned", "tuned_v1"])
def test_more_delay_costs_phase_and_a_stronger_observer_costs_gain_margin(preset):
    config = controller_config(preset)
    assert margins(config, 0, delay=0.06).phase < margins(config, 0, delay=0.04).phase
    shares = (0.0, 0.3, 0.6, 0.9)
    stronger = [replace(config, compensation=replace(config.compensation, observer_gain=g)) for g in shares]
    for axis in range(4):
        gains = [margins(one, axis).gain for one in stronger]
        assert gains == sorted(gains, reverse=True)
        assert gains[0] > 1.05 * gains[-1]
    assert np.isfinite(margins(config, 1).sensitivity)
