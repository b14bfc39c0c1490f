"""Pins the crawl study: it resumes."""

from dataclasses import replace

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
