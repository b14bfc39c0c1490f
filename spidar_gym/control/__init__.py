"""Controllers: gait, centroidal control and thrust allocation; `ThrustAllocator` is the allocation as a library."""

from spidar_gym.control.allocation.allocator import Allocation, AllocationStatus, Allocator
from spidar_gym.control.allocation.problem import Demand
from spidar_gym.control.thrust import ThrustAllocator

__all__ = ["Allocation", "AllocationStatus", "Allocator", "Demand", "ThrustAllocator"]
