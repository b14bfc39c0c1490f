"""Tries of hostile tests: a call is accepted, or refused with a `SpidarError` of one line."""

import warnings

from spidar_gym.errors import SpidarError


def tried(act) -> tuple[bool, object]:
    """Whether a call was accepted, and its result; a refusal is one line that states what would be valid."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", message=".*render_mode")  # a warning of gymnasium before our error
            return True, act()
    except SpidarError as error:
        message = str(error)
        assert "\n" not in message
        assert len(message) < 1500
        assert "valid" in message
        return False, None
