"""Command lines that speak plainly: what ends them is one line, and the status 2, 130 of Ctrl-C, or 143 of SIGTERM."""

import contextlib
import errno
import gc
import io
import os
import re
import select
import shutil
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from tqdm import tqdm

from spidar_gym.errors import MissingDependencyError, SpidarError
from spidar_gym.files import FULL, json_text, write_text
from spidar_gym.processes import LostWorkerError

PATIENCE = 0.1, 10.0
"""Seconds between two looks at a progress bar: on a terminal, and in a file that keeps each of them."""
progress = partial(
    tqdm, file=sys.__stderr__, mininterval=PATIENCE[not (sys.__stderr__ is not None and sys.__stderr__.isatty())]
)
"""A progress bar, on the true stderr: while a command is parsed, the other one is kept back."""


class Terminated(KeyboardInterrupt):
    """SIGTERM: whoever takes care of Ctrl-C takes care of it too."""


@contextlib.contextmanager
def kept(words: Callable[[], str]) -> Iterator[None]:
    """Let an interruption, or the loss of a worker, say what is kept, and how to go on.

    Args:
        words: Says so, when it comes to it.
    """
    try:
        yield
    except (KeyboardInterrupt, LostWorkerError) as stop:
        stop.add_note(words())
        raise


def published(folder: Path, name: str, result: dict[str, Any], table: str, json: bool) -> str:
    """Write a result as NAME.json; what to print of it: the same JSON, or the table."""
    text = json_text(result)
    write_text(folder / f"{name}.json", text)
    return text if json else table


def drawn(what: str, draw: Callable[[], object]) -> bool:
    """Draw what can be drawn here; where a library is missing, say so and go on. Whether it was drawn."""
    try:
        draw()
    except MissingDependencyError as error:
        print(f"no {what}: {error}", file=sys.__stderr__)
        return False
    return True


def named_steps(bar: tqdm) -> Callable[[str], None]:
    """A function that counts a step of a bar and shows the step's name."""

    def on_step(name: str) -> None:
        bar.set_postfix_str(name)
        bar.update()

    return on_step


def goes_on(bar: tqdm, folder: Path) -> Callable[[], str]:
    """For `kept`: how much of a bar's work lies in a folder, from which the same command goes on."""
    return lambda: f"{bar.n} of {bar.total} {bar.unit}s kept in {folder}; the same command goes on"


def studied(
    folder: Path, name: str, unit: str, total: int, *, json: bool,
    play: Callable[[Path, Callable[[], object]], list[dict[str, Any]]], table: Callable[[list[dict[str, Any]]], str],
) -> list[dict[str, Any]]:  # fmt: skip
    """Play a study, whose pieces survive an interruption; write NAME.json, and print it or its table.

    Args:
        folder: For NAME.json, and for the pieces while it is unfinished.
        name: Of the file and of its only key.
        unit: What a piece is called.
        total: Pieces in all.
        json: Whether the JSON is printed.
        play: Called with the folder of the pieces and what counts them; gives the rows.
        table: Rows → what is printed of them.
    """
    unfinished = folder / "unfinished"
    with progress(total=total, unit=unit, desc=name) as bar, kept(goes_on(bar, unfinished)):
        rows = play(unfinished, bar.update)
    text = published(folder, name, {name: rows}, table(rows), json)
    shutil.rmtree(unfinished, ignore_errors=True)
    print(text)
    return rows


@contextlib.contextmanager
def _terminated() -> Iterator[None]:
    """SIGTERM raises `Terminated`, unless it has a meaning already."""

    def terminate(number: int, frame: FrameType | None) -> None:
        raise Terminated

    main = threading.current_thread() is threading.main_thread()
    ours = main and signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    if ours:
        signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


def run_cli(prog: str, call: Callable[[], object]) -> None:
    """Call a command line and put whatever it refuses on one line.

    Args:
        prog: Name before the message.
        call: The parser with what it calls.
    """
    # The parser draws boxes; while it may speak, stderr is kept back, and a refusal is put on one line.
    told = io.StringIO()

    def say(*words: str) -> None:
        print(f"{prog}: {' '.join('; '.join(words).split())}", file=sys.__stderr__)

    try:
        with contextlib.redirect_stderr(told), _terminated(), _output():
            call()
    except SpidarError as error:
        say(str(error), *getattr(error, "__notes__", ()))
        sys.exit(2)
    except KeyboardInterrupt as stop:
        ended = isinstance(stop, Terminated)
        say("terminated" if ended else "interrupted", *getattr(stop, "__notes__", ()))
        # Python would look through all that torch and the like have made before it ends: two seconds.
        gc.freeze()
        sys.exit(143 if ended else 130)
    except SystemExit as stop:
        if stop.code not in (0, None) and told.getvalue():
            words = refusal(told.getvalue())
            told.truncate(0)
            say(words)
            sys.exit(2)
        raise
    finally:
        print(told.getvalue(), end="", file=sys.__stderr__)


@contextlib.contextmanager
def _output() -> Iterator[None]:
    """Write what a command prints: characters that its encoding lacks become question marks.

    A reader that has gone, as `head` goes, ends it without a word, by the status that shells give; a full disk ends it
    in `SpidarError`.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        try:
            yield
        finally:
            if sys.__stdout__ is not None:  # None where the shell closed it
                sys.stdout.flush()
    except BrokenPipeError:
        broken = select.poll()
        broken.register(sys.stdout.fileno(), 0)
        if not broken.poll(0):  # it was another pipe
            raise
        _discard_output()
        sys.exit(141)
    except OSError as error:
        if error.errno not in (*FULL, errno.EBADF) or error.filename is not None:  # of a file
            raise
        _discard_output()
        raise SpidarError(
            f"cannot write the standard output: {error.strerror}; valid: a terminal, a pipe, a file on a disk with room"
        ) from error


def _discard_output() -> None:
    """Send to nowhere what is left of the standard output, or Python would complain of it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


KINDS = {"INT": "a whole number", "FLOAT": "a number", "PATH": "a path"}
"""What the parser calls a kind of value → what people call it."""


def refusal(box: str) -> str:
    """What the parser refuses, without its box and its types' names, in one line.

    Args:
        box: What it printed.
    """
    text = " ".join(box.translate(dict.fromkeys(map(ord, "╭╮╰╯│─"), " ")).split())
    wrong = re.search(
        r"Error parsing (\S+): (.*) Argument helptext: \1 (\S+) (.*?)(?: \(default: [^)]*\))? For full", text
    )
    if wrong:
        option, reason, kind, doc = wrong.groups()
        *_, value = re.findall(r"'.*?'", reason) or ["this"]
        expected = " or ".join(KINDS.get(word, word) for word in kind.split("|") if word != "{None}")
        return f"{option} = {value} is not valid; expected {expected}: {doc}"
    # The box's title says once more what its first words say; of a group of options no user has heard.
    return re.sub(r"^((Unrecognized options|Missing \w+) (?=[A-Z])|Value error Error parsing \S+: )", "", text)
