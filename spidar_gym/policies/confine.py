"""Script of a separate process for a policy: it restricts itself, and then runs the policy's untrusted code.

Only the standard library is imported before the restrictions apply, so that they include every thread.
"""

import contextlib
import ctypes
import json
import os
import resource
import signal
import sys

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
"""Numbers of Landlock's system calls."""
WRITES = 1 << 1, *(1 << bit for bit in range(4, 13))
"""Rights that change files: write; remove folders and files; make devices, folders, files, sockets, pipes, links."""
LATER = {2: 1 << 13, 3: 1 << 14}
"""Rights of later versions, by version: links and moves across folders, and truncation of files."""
SCOPED, SCOPES = 6, 0b11
"""Version that can also restrict signals and abstract sockets, and the flags for both."""
BENEATH, NEW_PRIVILEGES, DEATH = 1, 38, 1
"""Type of a rule on a path; options of `prctl`: no new privileges, and a signal when the parent ends."""


def landlock() -> int:
    """Return the kernel's version of Landlock; 0 without Landlock."""
    if sys.platform != "linux":
        return 0
    return max(0, ctypes.CDLL(None).syscall(CREATE_RULESET, None, ctypes.c_size_t(0), 1))


def forbid_writing(*folders: str) -> None:
    """Restrict this process to writing in these folders, and keep it from accessing other processes.

    Without Landlock (see `landlock`) do nothing.
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
    """Restrict this process: it ends with its parent, writes only to `scratch`, and has limited memory [bytes]."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(DEATH, signal.SIGKILL, 0, 0, 0)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    forbid_writing(scratch, "/dev/null", "/dev/shm")


def main() -> None:
    """Restrict this process and serve a policy."""
    spec, trust, paths, scratch, memory = json.loads(sys.argv[1])
    del sys.argv[1:]
    inward, outward = os.dup(0), os.dup(1)
    # Keep the policy's standard input and output apart from the messages.
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    confine(scratch, memory)
    sys.path[:] = paths
    from spidar_gym.policies.serve import serve

    serve(spec, trust, inward, outward)


if __name__ == "__main__":
    main()
