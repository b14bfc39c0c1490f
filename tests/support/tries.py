"""What hostile tests try: an act is accepted, or refused in one line of ours."""

import warnings

from spidar_gym.errors import SpidarError


def tried(act) -> tuple[bool, object]:
    """Whether an act was accepted, and what came of it; a refusal is one line of ours that says what would be valid."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", message=".*render_mode")  # gymnasium's own remark, before our error
            return True, act()
    except SpidarError as error:
        message = str(error)
        assert "\n" not in message
        assert len(message) < 1500
        assert "valid" in message
        return False, None
