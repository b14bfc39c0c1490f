"""The robot's end in ROS 1: topics through rospy in a child process, so that one process can run several robots."""

import contextlib
import ctypes
import importlib
import importlib.util
import os
import pickle
import queue
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO
from xmlrpc.client import ServerProxy

import numpy as np

from spidar_gym.errors import MissingDependencyError, SpidarError, require_name
from spidar_gym.onboard.messages import COMMANDS, FEEDBACK, MODEL_PARAMETER, NAMESPACE, ORDERS, Message
from spidar_gym.robot.description import model_hash
from spidar_gym.sitl.ros_types import FILL, KINDS, READ, RosMessage, message_types

PACKAGES = "/usr/lib/python3/dist-packages"
"""Folder in which Debian installs rospy."""
INSTALL = "apt-get install ros-core python3-sensor-msgs python3-nav-msgs python3-geometry-msgs (Debian 12)"
START, ANSWER = 20.0, 5.0
"""Time limits for the start and for an answer [s]."""
QUEUE = 32
"""Number of messages queued for a slow subscriber before the oldest is dropped."""


class RosLink:
    """The robot on ROS 1: publishes its sensors' measurements and receives commands.

    rospy allows one node per process and takes over its logging. The node therefore runs in a child, behind two pipes.
    """

    def __init__(self, namespace: str = NAMESPACE, *, master: str | None = None) -> None:
        """Start the node, and a new master on the loopback unless one is given.

        Args:
            namespace: Namespace of the robot's topics.
            master: URI of a running ROS master.

        Raises:
            MissingDependencyError: Without ROS 1.
            SpidarError: When the master does not answer.
        """
        self._folder = Path(tempfile.mkdtemp(prefix="spidar-ros-"))
        self._lock, self._heard = threading.Lock(), deque[Message]()
        self._answers: queue.Queue[tuple[str, str]] = queue.Queue()
        self._base = time.time_ns()
        self._wrong = ""
        self._node = self._spawn(master or "")
        assert self._node.stdin is not None
        assert self._node.stdout is not None
        self._stdin, self._stdout = self._node.stdin, self._node.stdout
        self._pipe: int = self._stdin.fileno()
        os.set_blocking(self._pipe, False)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self.uri = self._ask("start", namespace, master, self._base, str(self._folder), seconds=START)
            """URI of the master."""
        except BaseException:
            self.close()
            raise

    def appear(self, seconds: float, model: str | None = None) -> None:
        """Publish the hash of the robot's model; start its clock, which stamps messages.

        Args:
            seconds: Time of the robot's clock [s].
            model: Hash of the model; the nominal one by default.
        """
        # A real robot's sensors do not wait for a busy machine. The priority is optional: it may not be permitted.
        with contextlib.suppress(PermissionError):
            for process in (0, self._node.pid):
                os.setpriority(os.PRIO_PROCESS, process, -10)
        self._ask("parameter", MODEL_PARAMETER, model or model_hash())
        self._base = time.time_ns() - round(seconds * 1e9)
        self._ask("clock", self._base)

    def publish(self, message: Message) -> None:
        """Publish a message without blocking. Commands are allowed too, as the robot's flight stack publishes them."""
        require_name("topic", message.topic, KINDS)
        if self._wrong:
            raise SpidarError(f"ROS: {self._wrong}; valid: the values that `Message` lists for the topic")
        values = {name: np.asarray(value).tolist() for name, value in message.values.items()}
        data = pickle.dumps(("say", (message.topic, float(message.stamp), values)))
        try:
            with contextlib.suppress(BlockingIOError):  # the node is too slow: the message is lost
                os.write(self._pipe, data)  # below PIPE_BUF, so the write is atomic
        except OSError as error:
            raise SpidarError(f"the link's node has ended: {error}; valid: a link that is open") from None

    def heard(self) -> list[Message]:
        """Return the commands received since the last call, in order, stamped with their arrival."""
        return [self._heard.popleft() for _ in range(len(self._heard))]

    def kill_master(self) -> None:
        """Kill the master that this link has started, without notifying any node."""
        self._ask("kill")

    def environment(self) -> dict[str, str]:
        """Return the environment variables of a process that connects to this robot."""
        return _environment(self.uri, self._folder)

    def close(self) -> None:
        """End the node and its master; further calls do nothing."""
        if self._node.returncode is None:
            self._stdin.close()
            try:
                self._node.wait(ANSWER)
            except subprocess.TimeoutExpired:
                self._node.kill()
                self._node.wait()
            self._reader.join(ANSWER)
            self._stdout.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _spawn(self, master: str) -> subprocess.Popen[bytes]:
        """Start the child; its pipes are binary and unbuffered, so that a message is written whole or not at all."""
        with Path(self._folder, "node.log").open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-c", "from spidar_gym.sitl.link_ros import _serve; _serve()"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=log,
                bufsize=0,
                env=_environment(master, self._folder) | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
                start_new_session=True,  # the operator's Ctrl-C must not reach it
            )

    def _read(self) -> None:
        """Receive the node's messages, in a thread."""
        with os.fdopen(os.dup(self._stdout.fileno()), "rb") as stream:
            while True:
                try:
                    kind, data = pickle.load(stream)
                except (EOFError, OSError, pickle.UnpicklingError):
                    self._answers.put(("failed", "the node has ended"))
                    return
                if kind == "heard":
                    self._heard.append(Message(*data))
                elif kind == "wrong":
                    self._wrong = data
                else:
                    self._answers.put((kind, data))

    def _ask(self, *words: object, seconds: float = ANSWER) -> str:
        with self._lock:
            while not self._answers.empty():  # late answers to a request that timed out
                self._answers.get_nowait()
            try:
                os.write(self._pipe, pickle.dumps(words))
                kind, answer = self._answers.get(timeout=seconds)
            except (OSError, queue.Empty):
                kind, answer = "failed", "the node does not answer"
        if kind == "missing":
            raise MissingDependencyError(answer, INSTALL)
        if kind == "failed":
            raise SpidarError(f"ROS: {answer}; valid: a working ROS 1 (`rosmaster`, `rospy`), a master that answers")
        return answer


def _environment(uri: str, folder: Path) -> dict[str, str]:
    """Return this process's environment, with ROS on the loopback."""
    kept = {name: value for name, value in os.environ.items() if name not in ("ROS_HOSTNAME", "ROS_NAMESPACE")}
    return kept | {
        "ROS_MASTER_URI": uri,
        "ROS_IP": "127.0.0.1",
        "ROS_LOG_DIR": str(folder / "log"),
        "ROS_HOME": str(folder / "home"),
    }


def _serve() -> None:
    """Handle requests in the child until the pipe closes."""
    say = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # the output of rospy must not mix with the messages
    node = _Node(say)
    try:
        while True:
            kind, *words = pickle.load(sys.stdin.buffer)
            if kind == "say":
                node.publish(*words[0])
            else:
                node.answer(kind, words)
    except (EOFError, OSError):
        pass  # the other end was closed or has died
    finally:
        node.close()


class _Node:
    """Publishers and subscribers of rospy, in the child."""

    def __init__(self, say: BinaryIO) -> None:
        self._say, self._lock = say, threading.Lock()
        self._master: subprocess.Popen[bytes] | None = None
        self._publishers: dict[str, Any] = {}
        self._namespace, self._base = "", 0
        self._types: dict[str, Any] = {}
        self._rospy: Any = None

    def answer(self, kind: str, words: list[Any]) -> None:
        try:
            asked = {"start": self._start, "parameter": self._parameter, "kill": self._kill, "clock": self._clock}
            self._tell("done", asked[kind](*words))
        except ImportError as error:
            self._tell("missing", str(error.name or error))
        except FileNotFoundError as error:
            self._tell("missing", str(error.filename))
        except Exception as error:  # every error is reported to the other end
            self._tell("failed", _words(error))

    def publish(self, topic: str, stamp: float, values: dict[str, Any]) -> None:
        try:
            self._publish(topic, stamp, values)
        except Exception as error:  # as above
            self._tell("wrong", f"{topic}: {_words(error)}")

    def _publish(self, topic: str, stamp: float, values: dict[str, Any]) -> None:
        if topic not in self._publishers:
            self._advertise(topic)
        message = self._types[KINDS[topic]]()
        FILL[KINDS[topic]](message, values)
        time_ = self._rospy.Time(*divmod(self._base + round(stamp * 1e9), 10**9))
        if hasattr(message, "header"):
            message.header.stamp, message.header.frame_id = time_, "world"
        elif hasattr(message, "stamp"):
            message.stamp = time_
        self._publishers[topic].publish(message)

    def close(self) -> None:
        """End the process within two seconds, without waiting for a dead master."""
        if self._master is None and self._rospy is not None:
            threading.Timer(2.0, os._exit, (0,)).start()
            self._rospy.signal_shutdown("closed")
        if self._master is not None:
            self._kill()
        os._exit(0)

    def _tell(self, kind: str, data: object) -> None:
        with self._lock:
            pickle.dump((kind, data), self._say)
            self._say.flush()

    def _start(self, namespace: str, master: str | None, base: int, folder: str) -> str:
        self._namespace, self._base = namespace, base
        tempfile.tempdir = folder  # rospy's temporary files are deleted with the folder
        if importlib.util.find_spec("rospy") is None:
            sys.path.append(PACKAGES)  # last, so that it hides no package of this environment
        self._rospy = importlib.import_module("rospy")
        self._types = message_types()
        uri = master or self._start_master(folder)
        os.environ["ROS_MASTER_URI"] = uri
        _await_master(uri, START / 2)
        self._rospy.init_node(
            "spidar_robot", argv=[], anonymous=True, disable_rosout=True, disable_rostime=True, disable_signals=True
        )
        for topic in (*FEEDBACK, ORDERS):
            self._advertise(topic.name)
        for topic in COMMANDS:
            self._rospy.Subscriber(
                f"{namespace}/{topic.name}", self._types[topic.kind], self._listener(topic.name), tcp_nodelay=True
            )
        return uri

    def _start_master(self, folder: str) -> str:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        uri = f"http://127.0.0.1:{port}"
        with Path(folder, "master.log").open("wb") as log:
            self._master = subprocess.Popen(
                ["/usr/bin/rosmaster", "--core", "-p", str(port)],
                env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
                | {"ROS_MASTER_URI": uri},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                preexec_fn=_die_with_parent,
            )
        return uri

    def _advertise(self, topic: str) -> None:
        self._publishers[topic] = self._rospy.Publisher(
            f"{self._namespace}/{topic}", self._types[KINDS[topic]], queue_size=QUEUE, tcp_nodelay=True
        )

    def _listener(self, topic: str) -> Callable[[RosMessage], None]:
        read, me = READ[KINDS[topic]], self._rospy.get_name()

        def hear(message: RosMessage) -> None:
            arrival = 1e-9 * (time.time_ns() - self._base)
            if message._connection_header.get("callerid") != me:
                self._tell("heard", (topic, arrival, read(message)))

        return hear

    def _parameter(self, name: str, value: str) -> str:
        self._rospy.set_param(f"{self._namespace}/{name}", value)
        return ""

    def _clock(self, base: int) -> str:
        self._base = base
        return ""

    def _kill(self) -> str:
        if self._master is None:
            raise SpidarError("this link has not started the master")
        self._master.kill()
        self._master.wait()
        return ""


def _words(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


def _die_with_parent() -> None:
    """Make a new master end when its node is killed (PR_SET_PDEATHSIG of Linux)."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)


def _await_master(uri: str, seconds: float) -> None:
    end = time.monotonic() + seconds
    while True:
        try:
            with ServerProxy(uri) as master:
                master.getPid("/spidar_robot")
            return
        except OSError:
            if time.monotonic() > end:
                raise SpidarError(f"no master at {uri}") from None
            time.sleep(0.02)
