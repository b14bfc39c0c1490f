"""Figures and videos of experiments."""

from spidar_gym.viz.courses import gate_figure, way_figure, way_of
from spidar_gym.viz.figures import (
    Curve,
    ablation_figure,
    crawl_figure,
    energy_figure,
    flight_figure,
    frontier_figure,
    leaderboard_picture,
    learning_curves,
    speed_figure,
    step_figure,
)
from spidar_gym.viz.film import (
    Film,
    Take,
    course_traces,
    crawl_take,
    crawl_traces,
    film_take,
    flight_take,
    flight_traces,
    grasp_traces,
)
from spidar_gym.viz.stills import crawl_strip, forms_picture

__all__ = [
    "Curve",
    "Film",
    "Take",
    "ablation_figure",
    "course_traces",
    "crawl_figure",
    "crawl_strip",
    "crawl_take",
    "crawl_traces",
    "energy_figure",
    "film_take",
    "flight_figure",
    "flight_take",
    "flight_traces",
    "forms_picture",
    "frontier_figure",
    "gate_figure",
    "grasp_traces",
    "leaderboard_picture",
    "learning_curves",
    "speed_figure",
    "step_figure",
    "way_figure",
    "way_of",
]  # fmt: skip
