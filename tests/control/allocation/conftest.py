"""What several files of this folder are given."""

import pytest


@pytest.fixture
def no_shortcut(monkeypatch):
    """Every tick goes through OSQP: the closed form may refine its answer, never replace it."""
    # Imported late: a package that a conftest imports escapes the checks of shapes and types.
    from spidar_gym.control.allocation import allocator as module
    from spidar_gym.control.allocation.solver import closed_form

    def refine(program, duals=None, **options):
        return None if duals is None else closed_form(program, duals, **options)

    monkeypatch.setattr(module, "closed_form", refine)
