"""Pins the crawl study: it resumes; crawls with soft servos."""

from dataclasses import replace

import numpy as np
import pytest

from spidar_gym.paper import crawl_study


def test_a_study_of_crawls_resumes(tmp_path, monkeypatch):
    crawled = []

    def run_case(case, seed):
        crawled.append((case.name, seed))
        return {"case": case.name, "seed": seed}

    monkeypatch.setattr(crawl_study, "run_case", run_case)
    cases = crawl_study.CASES[:2]
    crawl_study.run_cases(cases, [0], folder=tmp_path)
    rows = crawl_study.run_cases(cases, [0, 1], folder=tmp_path)
    assert crawled == [(case.name, seed) for seed in (0, 1) for case in cases]
    assert [(row["case"], row["seed"]) for row in rows] == [(case.name, seed) for case in cases for seed in (0, 1)]
    crawl_study.run_cases([replace(cases[0], preset="robust")], [0], folder=tmp_path)
    assert len(crawled) == 5


@pytest.mark.slow
def test_soft_servos_drag_feet_and_tilt_the_torso():
    """Servos of 40 Nm/rad instead of 175, six noisy robots each; the guide states these figures."""

    def crawls(preset, **actuators):
        case = crawl_study.Case("soft", preset, actuators=actuators)
        return [crawl_study.run_case(case, seed) for seed in range(6)]

    def tilts(rows):
        return [[round(f([row["roll_pitch_torso_rad"] for row in rows]), 3) for f in (min, max)]]

    stiff, soft, robust = crawls("published"), crawls("published", joint_kp=40.0), crawls("robust", joint_kp=40.0)
    assert all(row["success"] for row in (*stiff, *robust))
    assert [row["shortfalls"] for row in soft if not row["success"]] == ["airborne"] * 2
    assert tilts(stiff) + tilts(soft) == [[0.003, 0.009], [0.029, 0.034]]
    thrust = [np.median([row["thrust_mean"] for row in rows]) for rows in (stiff, soft)]
    np.testing.assert_allclose(thrust, [0.415, 0.462], rtol=0, atol=0.001)
