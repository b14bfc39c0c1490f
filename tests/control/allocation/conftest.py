"""Fixtures of the allocation tests."""

import pytest


@pytest.fixture
def no_shortcut(monkeypatch):
    """Solve every tick with OSQP: the closed form refines its solution and never replaces it."""
    # Imported late: a conftest's imports are not instrumented with checks of shapes and types.
    from spidar_gym.control.allocation import allocator as module
    from spidar_gym.control.allocation.solver import closed_form

    def refine(program, duals=None, **options):
        return None if duals is None else closed_form(program, duals, **options)

    monkeypatch.setattr(module, "closed_form", refine)
