#!/usr/bin/env bash
# The exact commands that produce every learned row of the leaderboard; needs a checkout with
# `pip install -e '.[train,viz]'`. An interrupted run resumes. Each run is one process, so several seeds can run in
# parallel.
# Usage: train/commands.sh [ROW ...], all rows if none is named.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
FLIGHTS="flight-forms flight-fast3 flight-fast5 flight-randomised"
ALL_FLIGHTS="flight-paper $FLIGHTS flight-wind flight-narrow"

row() { # row NAME SEEDS TRACKS SCRIPT PRESET [GROUP]: train every seed, keep the artifacts, evaluate on the test scenarios
  local name=$1 seeds=$2 tracks=$3 script=$4 preset=$5 group=${6:-} seed policies=()
  for seed in $seeds; do
    python -m "train.$script" "$preset" --seed "$seed" --no-row
    mkdir -p "baselines/learned/$name"
    cp "out/train/$name/seed$seed/policy.npz" "baselines/learned/$name/seed$seed.npz"
    policies+=("baselines/learned/$name/seed$seed.npz")
  done
  spidar eval --policy "${policies[@]}" --tracks $tracks --out "baselines/scores/$group"
}

supervised_paper() { row supervised_paper "0 1 2 3 4" "$FLIGHTS" supervised hover-paper; }
supervised_tuned() { row supervised_tuned "0 1 2 3 4" "$FLIGHTS" supervised hover-tuned; }
ppo_paper() { row ppo_paper "0 1 2 3 4" "$FLIGHTS" residual hover-paper-ppo; }
ppo_tuned() { row ppo_tuned "0 1 2 3 4" "$FLIGHTS" residual hover-tuned-ppo; }
learned_gait() { row learned_gait "0 1 2 3 4" ground-randomised gait crawl-pairs; }
gait() { row gait "0 1 2 3 4" "ground-paper ground-directions ground-friction ground-uneven ground-randomised" gait crawl; }
distilled() { row distilled "0 1 2 3 4" "$ALL_FLIGHTS" distill hover; }
distilled_ppo() { row distilled_ppo "0 1 2 3 4" "$ALL_FLIGHTS" residual hover-distilled-ppo; }
direct() { row direct "0 1 2 3 4" "$ALL_FLIGHTS" residual hover-direct; }
memory() { row memory "0 1 2 3 4" "$ALL_FLIGHTS" memory hover; }
learned_course() { row learned_course "0 1 2 3 4" "course-takeoff course-gates course-mixed" course rule course; }
ppo_direct() { row ppo_direct "0 1 2" flight-paper residual hover-direct-ppo; }

for name in ${*:-supervised_paper supervised_tuned ppo_paper ppo_tuned distilled distilled_ppo direct memory gait learned_gait learned_course ppo_direct}; do "$name"; done
python -m train.curves
spidar leaderboard build
