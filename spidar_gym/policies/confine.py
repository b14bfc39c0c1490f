"""A policy in a process of its own, begun as a script: bounds first, then the code that nobody here has read.

Nothing but the standard library is imported before the bounds stand, so that no thread is outside of them.
"""

import contextlib
import ctypes
import json
import os
import resource
import signal
import sys

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
"""Numbers of its system calls."""
WRITES = 1 << 1, *(1 << bit for bit in range(4, 13))
"""Rights that change files: write; remove folders and files; make devices, folders, files, sockets, pipes, links."""
LATER = {2: 1 << 13, 3: 1 << 14}
"""Those of later versions: links and moves across folders, and cutting files off."""
SCOPED, SCOPES = 6, 0b11
"""Version from which signals and abstract sockets stay inside too."""
BENEATH, NEW_PRIVILEGES, DEATH = 1, 38, 1
"""A rule on a path; and of `prctl`: no new privileges, and a signal when the parent ends."""


def landlock() -> int:
    """Version of Landlock that the kernel has; 0 where there is none."""
    if sys.platform != "linux":
        return 0
    return max(0, ctypes.CDLL(None).syscall(CREATE_RULESET, None, ctypes.c_size_t(0), 1))


def forbid_writing(*folders: str) -> None:
    """Nothing of this process changes a file from now on but in these folders; nor does it reach into another process.

    Without Landlock it does nothing (`landlock` says so).
    """
    version = landlock()
    if not version:
        return
    libc = ctypes.CDLL(None, use_errno=True)
    rights = sum(WRITES) + sum(right for least, right in LATER.items() if version >= least)
    fields = [rights, 0, SCOPES][: 1 if version < 4 else 2 if version < SCOPED else 3]
    rules = (ctypes.c_uint64 * len(fields))(*fields)
    ruleset = libc.syscall(CREATE_RULESET, ctypes.byref(rules), ctypes.c_size_t(ctypes.sizeof(rules)), 0)
    for folder in folders:
        with contextlib.suppress(OSError):
            place = os.open(folder, os.O_PATH)
            allowed = rights if os.path.isdir(folder) else rights & (WRITES[0] | LATER[3])
            # Packed: 8 bytes of rights, 4 of the file.
            rule = allowed.to_bytes(8, sys.byteorder) + place.to_bytes(4, sys.byteorder)
            libc.syscall(ADD_RULE, ruleset, BENEATH, rule, 0)
            os.close(place)
    libc.prctl(NEW_PRIVILEGES, 1, 0, 0, 0)
    if libc.syscall(RESTRICT_SELF, ruleset, 0):
        raise OSError(ctypes.get_errno(), "Landlock does not hold")
    os.close(ruleset)


def confine(scratch: str, memory: int) -> None:
    """End with the parent; write to `scratch` alone; take so much memory [bytes] at most."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DEATH, signal.SIGKILL, 0, 0, 0)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    forbid_writing(scratch, "/dev/null", "/dev/shm")


def main() -> None:
    """Bounds, then a policy that answers."""
    spec, trust, paths, scratch, memory = json.loads(sys.argv[1])
    del sys.argv[1:]
    inward, outward = os.dup(0), os.dup(1)
    # What a policy prints or asks for is no message.
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    confine(scratch, memory)
    sys.path[:] = paths
    from spidar_gym.policies.serve import serve

    serve(spec, trust, inward, outward)


if __name__ == "__main__":
    main()
