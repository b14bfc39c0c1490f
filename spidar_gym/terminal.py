"""Command lines that speak plainly: an error is one line on stderr and exit status 2, Ctrl-C is 130."""

import contextlib
import io
import sys
from collections.abc import Callable

from spidar_gym.errors import SpidarError


def speak_plainly(prog: str, call: Callable[[], object]) -> None:
    """Call a command line and put whatever it refuses on one line.

    Args:
        prog: Name before the message.
        call: The parser with what it calls.
    """
    # The parser draws boxes; while it may speak, stderr is kept back, and a refusal is put on one line.
    kept = io.StringIO()

    def fail(message: str) -> int:
        print(f"{prog}: {' '.join(message.split())}", file=sys.__stderr__)
        return 2

    try:
        with contextlib.redirect_stderr(kept):
            call()
    except SpidarError as error:
        sys.exit(fail(str(error)))
    except KeyboardInterrupt:
        sys.exit(130)
    except SystemExit as stop:
        if stop.code not in (0, None) and kept.getvalue():
            words = kept.getvalue().translate(dict.fromkeys(map(ord, "╭╮╰╯│─"), " ")).split()
            kept.truncate(0)
            sys.exit(fail(" ".join(words)))
        raise
    finally:
        print(kept.getvalue(), end="", file=sys.__stderr__)
