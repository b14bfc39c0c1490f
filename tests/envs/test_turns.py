"""Pins threads, forks and closing: calls take turns, a forked child has threads, closed environments refuse calls."""

import inspect
import os
import pickle
import subprocess
import sys
import threading
import time

import gymnasium
import numpy as np
import pytest

from spidar_gym.envs.registry import COURSE, CRAWL, HOVER, PATH
from spidar_gym.envs.vector import NativeVectorEnv
from spidar_gym.errors import SpidarError
from spidar_gym.turn import Turn

IDS = (HOVER, PATH, CRAWL, COURSE)
CLOSED = "^this environment is closed; valid: a new one$"
CONFIGURED = {
    "close", "is_closed", "closed", "turn", "unwrapped", "has_wrapper_attr", "get_wrapper_attr", "set_wrapper_attr",
    "np_random", "np_random_seed", "spec", "horizon", "reset_arguments", "rules", "layout_of", "judge", "tell",
    "robots", "buffers", "close_extras", "is_drawn", "action_mode", "make_fleet", "randomization",
    "sampled", "variant", "is_over",
}  # fmt: skip
"""Attributes that a closed environment still has: its configuration, and Gymnasium's bookkeeping."""
ARGUMENTS = {
    "step": lambda env: (np.zeros(env.action_space.shape),),
    "advance": lambda env: (np.zeros(env.action_space.shape),),
    "restore": lambda env: (b"",),
    "restore_state": lambda env: (b"",),
    "disturb": lambda env: (None,),
    "reference_ahead": lambda env: (0.5,),
    "make_fleet": lambda env: (1,),
    "variant": lambda env: ({},),
    "end": lambda env: (3,),
    "ended": lambda env: (0,),
    "set_autoreset_mode": lambda env: ("SameStep",),
}


def single(name, **options):
    return gymnasium.make(name, disable_env_checker=True, **options).unwrapped


def calls(env):
    """Everything public that can be called or looked up on an environment, by name."""
    for name, member in inspect.getmembers_static(type(env)):
        if name.startswith("_") or name in CONFIGURED:
            continue
        if isinstance(member, property):
            yield name, lambda name=name: getattr(env, name)
        elif inspect.isfunction(member):
            arguments = ARGUMENTS.get(name, lambda env: ())(env)
            yield name, lambda name=name, arguments=arguments: getattr(env, name)(*arguments)


@pytest.mark.parametrize("began", [True, False])
@pytest.mark.parametrize("control", ["core", "python", "vector"])
@pytest.mark.parametrize("name", IDS)
def test_every_call_on_a_closed_environment_is_refused_with_the_same_line(name, control, began):
    make = (lambda: NativeVectorEnv(name, 2, render_mode="rgb_array")) if control == "vector" else (
        lambda: single(name, control=control, render_mode="rgb_array")
    )  # fmt: skip
    env = make()
    if began:
        env.reset(seed=0)
    for _ in range(2):
        env.close()
    found = dict(calls(env))
    assert {"step", "reset", "render"} <= found.keys()
    ways = {"options": lambda: env.reset(options={"disturbances": None}), "pickle": lambda: pickle.dumps(env)}
    ways["made anew"] = lambda: env.reset(options={"horizon_s": 3.0})
    for what, call in (found | ways).items():
        with pytest.raises(SpidarError, match=CLOSED):
            pytest.fail(f"{what} gave {call()!r}")


def alongside(work, others, seconds=0.6):
    """Call `work` in a loop on a thread while this thread calls `others`; the loop ends with its first error."""
    raised, stop = [], threading.Event()

    def loop():
        while not stop.is_set():
            try:
                work()
            except SpidarError as error:
                raised.append(str(error))
                return

    thread = threading.Thread(target=loop)
    thread.start()
    until = time.monotonic() + seconds
    k = 0
    while time.monotonic() < until:
        others[k % len(others)](k)
        k += 1
    return thread, raised, stop


@pytest.mark.parametrize("robots", [0, 3])
@pytest.mark.parametrize("name", IDS)
def test_threads_take_turns_in_all_calls(name, robots):
    env = NativeVectorEnv(name, robots, num_threads=2) if robots else single(name)
    env.reset(seed=0)
    actions = np.zeros(env.action_space.shape)
    save, restore = (env.save, env.restore) if robots else (env.save_state, env.restore_state)
    others = (
        lambda k: env.reset(seed=k), lambda k: env.reset(options={"horizon_s": 3.0 + k}), lambda k: restore(save()),
        lambda k: pickle.loads(pickle.dumps(env)).close(),
    )  # fmt: skip
    thread, raised, stop = alongside(lambda: env.step(actions), others)
    env.close()
    stop.set()
    thread.join(20.0)
    assert not thread.is_alive()
    assert raised in ([], ["this environment is closed; valid: a new one"])


FORK = """
import os, sys, threading
import numpy as np
from spidar_gym.envs.vector import NativeVectorEnv
env = NativeVectorEnv({name!r}, 4, num_threads=2, randomization=1.0)
env.reset(seed=0)
actions = np.zeros(env.action_space.shape)
def flown(steps):
    return b"".join(env.step(actions)[0].tobytes() for _ in range(steps))
if {stepping}:
    other = NativeVectorEnv({name!r}, 64, num_threads=2)
    other.reset(seed=0)
    threading.Thread(target=lambda: [other.step(np.zeros(other.action_space.shape)) for _ in range(60)]).start()
moment = env.save()
parent = flown(5)
env.restore(moment)
for _ in range(3):
    child = os.fork()
    if not child:
        same = flown(5) == parent
        if {stepping}:
            other.step(np.zeros(other.action_space.shape))
            other.reset(seed=1)
            other.close()
        env.reset(seed=1, options={{"horizon_s": 2.0}})
        env.close()
        os._exit(0 if same else 3)
    assert os.waitpid(child, 0)[1] == 0
print("done", flush=True)
"""


@pytest.mark.parametrize("stepping", [False, True], ids=["idle", "while another thread steps"])
@pytest.mark.parametrize("name", [HOVER, CRAWL])
def test_a_forked_child_continues_with_its_own_threads(name, stepping):
    program = FORK.format(name=name, stepping=stepping)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100, check=False)
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr


def test_a_fork_waits_for_a_running_call_and_leaves_no_lock_behind():
    turn, entered, leave = Turn(), threading.Event(), threading.Event()

    def hold():
        with turn.lock:
            entered.set()
            leave.wait()

    thread = threading.Thread(target=hold)
    thread.start()
    entered.wait()
    child = os.fork()
    if not child:
        with turn.lock:  # the thread that holds it does not exist in the child
            os._exit(7)
    leave.set()
    thread.join()
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    with turn.lock:  # a fork in the middle of a call keeps what the forking thread holds
        child = os.fork()
        if not child:
            assert turn.lock.acquire(blocking=False)
            os._exit(8)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 8


def test_a_forked_child_reports_that_its_parents_opengl_context_is_lost():
    program = (
        "import os, gymnasium, spidar_gym\n"
        "env = gymnasium.make('spidar_gym/Hover-v0', render_mode='rgb_array', width=32, height=24)\n"
        "env.reset(seed=0)\n"
        "env.render()\n"
        "child = os.fork()\n"
        "if not child:\n"
        "    try:\n"
        "        env.render()\n"
        "    except spidar_gym.errors.SpidarError as error:\n"
        "        env.close()\n"
        "        os._exit(5 if 'forked' in str(error) else 6)\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), env.render().shape)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout == "5 (24, 32, 3)\n", done.stderr
