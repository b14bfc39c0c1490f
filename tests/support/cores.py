"""The compiled core's allocation, called as the Python allocator is."""

import ctypes

import numpy as np

from spidar_gym.control.allocation.allocator import AllocatorConfig
from spidar_gym.native.constants import PROGRAMS
from spidar_gym.native.library import Room, Struct, pointer, read_allocation
from spidar_gym.native.structs import fill

CAP = 300
"""Iteration cap of the robot's computer."""


def asked(demand) -> Struct:
    """A demand as the core's struct."""
    struct = Struct("demand")
    for name, view in struct.views.items():
        value = np.reshape(np.asarray(getattr(demand, name), float), -1)
        view.reshape(-1)[: len(value)] = value
    return struct


class Allocating:
    """The core's allocation for flights."""

    def __init__(self, library, cap=CAP, preset="paper"):
        self.library, self.room = library, Room(library)
        self.config, self.answer = Struct("allocator_config"), Struct("allocation")
        fill(self.config.record, AllocatorConfig(max_iter=cap))
        self.mode = ctypes.c_void_p(library.sp_find_mode(PROGRAMS.index(preset)))

    def __call__(self, demand, previous=None):
        held = np.zeros(24) if previous is None else previous.reshape(-1).copy()
        question = asked(demand)  # kept while the core reads it
        self.library.sp_allocate(
            self.mode, question.pointer, pointer(held), None, 0, self.config.pointer,
            self.room.pointer, self.answer.pointer,
        )  # fmt: skip
        return read_allocation(self.answer, 0.0)

    def project(self, demand, wish):
        question, wished, held = asked(demand), wish.reshape(-1).copy(), np.zeros(24)
        self.library.sp_project(
            question.pointer, pointer(wished), pointer(held), self.config.pointer, self.room.pointer,
            self.answer.pointer,
        )  # fmt: skip
        return read_allocation(self.answer, 0.0)
