#!/usr/bin/env bash
# The runs of docs/benchmark/suite.md, JOBS at a time (2). Interrupted, the same command resumes.
# Needs a checkout with `pip install -e '.[train,viz]'`.
# Usage: train/suite.sh [PATTERN], only runs whose line contains it, such as "Hover ppo".
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

runs() { # a line for each run, all tasks of a seed before the next seed
  local seed task mode reward
  for seed in 0 1 2 3 4; do
    for task in Hover Path Crawl; do echo "$task ppo --seed $seed"; done
    for task in HoverResidual Hover; do echo "$task sac --seed $seed"; done
    ((seed < 3)) || continue
    for mode in torso_forces direct; do
      for reward in sloped narrow; do
        echo "Hover ppo --seed $seed --mode $mode --reward $reward --steps 1000000"
        echo "Crawl ppo --seed $seed --mode $mode --reward $reward --steps 600000"
      done
    done
  done
}

runs | grep -F -- "${1:-}" | OMP_NUM_THREADS=1 xargs -P "${JOBS:-2}" -L 1 python -m train.standard
spidar suite --runs out/standard
spidar docs --tables
spidar docs --pictures --only suite
