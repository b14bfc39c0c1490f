"""Shared parts of the command lines: progress bars, one-line errors and exit statuses.

The status is 2 for an error, 130 for Ctrl-C, 143 for SIGTERM and 141 for a closed pipe.
"""

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
"""Least time between two updates of a progress bar [s]: on a terminal, and in a file, which keeps every update."""
progress = partial(
    tqdm, file=sys.__stderr__, mininterval=PATIENCE[not (sys.__stderr__ is not None and sys.__stderr__.isatty())]
)
"""A progress bar on the original stderr, since `run_cli` redirects `sys.stderr` while a command runs."""


class Terminated(KeyboardInterrupt):
    """SIGTERM; a subclass of `KeyboardInterrupt`, so that handlers of Ctrl-C also handle SIGTERM."""


@contextlib.contextmanager
def kept(words: Callable[[], str]) -> Iterator[None]:
    """Add a note to an interruption or to the loss of a worker: which results are kept and how to resume.

    Args:
        words: Returns the note; called only in these cases.
    """
    try:
        yield
    except (KeyboardInterrupt, LostWorkerError) as stop:
        stop.add_note(words())
        raise


def published(folder: Path, name: str, result: dict[str, Any], table: str, json: bool) -> str:
    """Write a result as NAME.json, and return the text to print: the same JSON, or the table."""
    text = json_text(result)
    write_text(folder / f"{name}.json", text)
    return text if json else table


def drawn(what: str, draw: Callable[[], object]) -> bool:
    """Call `draw` and return whether it succeeded; if a library is missing, print a message with the name `what`."""
    try:
        draw()
    except MissingDependencyError as error:
        print(f"no {what}: {error}", file=sys.__stderr__)
        return False
    return True


def named_steps(bar: tqdm) -> Callable[[str], None]:
    """Return a function that advances a bar by one step and displays the step's name."""

    def on_step(name: str) -> None:
        bar.set_postfix_str(name)
        bar.update()

    return on_step


def goes_on(bar: tqdm, folder: Path) -> Callable[[], str]:
    """Return the note for `kept`: how many of a bar's steps are stored in a folder, from which a command resumes."""
    return lambda: f"{bar.n} of {bar.total} {bar.unit}s kept in {folder}; the same command resumes"


def studied(
    folder: Path, name: str, unit: str, total: int, *, json: bool,
    play: Callable[[Path, Callable[[], object]], list[dict[str, Any]]], table: Callable[[list[dict[str, Any]]], str],
) -> list[dict[str, Any]]:  # fmt: skip
    """Run a resumable study; write NAME.json, and print it or its table.

    Args:
        folder: Folder for NAME.json, and for finished pieces of the study until it is complete.
        name: Name of the file and its only key.
        unit: Unit of the progress bar: the name of a piece.
        total: Number of pieces.
        json: Whether to print the JSON instead of the table.
        play: Called with the folder of the pieces and a function that counts a finished piece; returns the rows.
        table: Rows → their table as text.
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
    """Make SIGTERM raise `Terminated`, unless another handler is installed."""

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
    """Call a command line, and print any error on one line.

    Args:
        prog: Name of the program, printed before the message.
        call: Parses the arguments and runs the command.
    """
    # The parser prints errors in boxes. Its stderr is captured, so that an error is reformatted to one line.
    captured = io.StringIO()

    def say(*words: str) -> None:
        print(f"{prog}: {' '.join('; '.join(words).split())}", file=sys.__stderr__)

    try:
        with contextlib.redirect_stderr(captured), _terminated(), _output():
            call()
    except SpidarError as error:
        say(str(error), *getattr(error, "__notes__", ()))
        sys.exit(2)
    except KeyboardInterrupt as stop:
        ended = isinstance(stop, Terminated)
        say("terminated" if ended else "interrupted", *getattr(stop, "__notes__", ()))
        # Skips garbage collection at exit, which takes two seconds after an import of torch.
        gc.freeze()
        sys.exit(143 if ended else 130)
    except SystemExit as stop:
        if stop.code not in (0, None) and captured.getvalue():
            words = refusal(captured.getvalue())
            captured.truncate(0)
            say(words)
            sys.exit(2)
        raise
    finally:
        print(captured.getvalue(), end="", file=sys.__stderr__)


@contextlib.contextmanager
def _output() -> Iterator[None]:
    """Handle errors of the standard output.

    Characters that the encoding lacks become question marks. A closed pipe, for example to `head`, exits silently with
    status 141, as in a shell. A full disk raises `SpidarError`.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")
    try:
        try:
            yield
        finally:
            if sys.__stdout__ is not None:  # None if the shell closed it
                sys.stdout.flush()
    except BrokenPipeError:
        broken = select.poll()
        broken.register(sys.stdout.fileno(), 0)
        if not broken.poll(0):  # another pipe broke
            raise
        _discard_output()
        sys.exit(141)
    except OSError as error:
        if error.errno not in (*FULL, errno.EBADF) or error.filename is not None:  # an error of a file
            raise
        _discard_output()
        raise SpidarError(
            f"cannot write the standard output: {error.strerror}; valid: a terminal, a pipe, a file on a disk with room"
        ) from error


def _discard_output() -> None:
    """Discard the remaining standard output, which would otherwise cause an error when Python exits."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


KINDS = {"INT": "a whole number", "FLOAT": "a number", "PATH": "a path"}
"""The parser's name of a type → its name in messages."""


def refusal(box: str) -> str:
    """Return the parser's error message on one line, without its box and its names of types.

    Args:
        box: Output of the parser.
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
    # Remove the box's title, which repeats the first words, and internal names of option groups.
    return re.sub(r"^((Unrecognized options|Missing \w+) (?=[A-Z])|Value error Error parsing \S+: )", "", text)
