"""Pins the one-line error messages: the invalid value, the valid ones, and the closest match."""

import math
import pickle

import numpy as np
import pytest

from spidar_gym.errors import (
    SHOWN,
    InvalidValueError,
    SpidarError,
    UnknownArgumentError,
    UnknownNameError,
    require_arguments,
    require_flag,
    require_instance,
    require_keys,
    require_least,
    require_name,
    require_not_negative,
    require_within,
)
from spidar_gym.robot import FORMS
from spidar_gym.sim.disturbances import Disturbances

VALID = ("action_mode", "sensors", "randomization", "horizon_s")


class Rude:
    def __repr__(self):
        raise KeyError("no")


STRANGE = [
    None, "", "x\ny", b"x", -(10**400), -(10**5000), math.nan, math.inf, -1.0, 2j, [], ["x"], [[[]]], {}, {"x": 1},
    set(), object(), Rude(), int, np.zeros((20, 20)), np.array(["a"]), range(3), "x" * 10000, {"k": Rude()},
]  # fmt: skip
"""Values that are no valid name, number or flag."""


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("action_mod", "action_mode"),
        ("sensor", "sensors"),
        ("randomisation", "randomization"),
        ("horizon", "horizon_s"),
    ],
)
def test_an_unknown_name_lists_all_valid_ones_and_suggests_the_closest(wrong, meant):
    error = str(UnknownNameError("option", wrong, VALID))
    assert error == f"unknown option '{wrong}'; valid: {', '.join(VALID)}; did you mean {meant}?"


def test_an_unknown_argument_lists_all_valid_ones_in_pythons_words_with_the_reason():
    error = UnknownArgumentError("sensor", VALID, "it is not there")
    assert str(error) == (
        f"got an unexpected keyword argument 'sensor'; valid: {', '.join(VALID)}; did you mean sensors?; "
        "it is not there"
    )
    assert isinstance(error, UnknownNameError)
    assert isinstance(error, TypeError)
    # Gymnasium raises a new error of the same type with an extended message.
    again = f"{error} was raised from the environment creator for an/Id-v0 with kwargs ({{'sensor': 1}})"
    assert str(type(error)(again)) == str(error)
    require_arguments(["sensors"], VALID)
    with pytest.raises(UnknownArgumentError, match="unexpected keyword argument 'x'"):
        require_arguments(["sensors", "x"], VALID)


def test_a_name_without_a_close_match_has_no_suggestion():
    assert str(UnknownNameError("form", "zzz", FORMS)) == "unknown form 'zzz'; valid: form1, form2, form3"


@pytest.mark.parametrize("value", STRANGE, ids=lambda value: type(value).__name__)
def test_a_refused_value_is_shown_in_one_short_line(value):
    acts = [
        lambda: require_name("form", value, FORMS),
        lambda: require_within(0.0, 1.0, "m", length=value),
        lambda: require_not_negative(length=value),
        lambda: require_least(1, count=value),
        lambda: require_flag(wake=value),
        lambda: require_instance(Disturbances, storm=value),
        lambda: require_keys("options", "option", {"zzz": value} if isinstance(value, dict) else value, VALID),
    ]
    for act in acts:
        with pytest.raises(SpidarError) as refusal:
            act()
        message = str(refusal.value)
        assert "\n" not in message
        assert len(message) < 2 * SHOWN
        assert str(pickle.loads(pickle.dumps(refusal.value))) == message


def test_a_number_that_no_float_can_hold_is_not_within_any_range():
    with pytest.raises(InvalidValueError, match="a number within 0 … inf"):
        require_within(0.0, math.inf, "m", length=10**400)
    with pytest.raises(InvalidValueError, match="at least 0"):
        require_not_negative(length=10**400)


def test_valid_values_pass():
    require_name("form", np.str_("form1"), FORMS)
    require_within(0.0, 1.0, "m", a=0, b=1.0, c=np.float32(0.5), d=np.int64(1))
    require_not_negative(a=0, b=1e300, c=np.float64(2.0))
    require_least(0, a=0, b=np.int64(3))
    require_flag(a=True, b=np.bool_(False), c=0, d=1)
    assert require_keys("options", "option", {"sensors": 1}, VALID) == {"sensors": 1}


@pytest.mark.parametrize("value", [-1e-9, 1.0 + 1e-9])
def test_a_number_outside_its_range_is_refused_with_the_range(value):
    with pytest.raises(InvalidValueError, match=r"length = .* a number within 0 … 1 \[m\]"):
        require_within(0.0, 1.0, "m", length=value)
