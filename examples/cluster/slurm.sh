#!/bin/sh
# Builds a field on a Slurm cluster:
#   examples/cluster/slurm.sh OUT.slf SHARDS LEVELS INPUT [OPTIONS OF slf build]
# Submits the coarse levels, an array of SHARDS tasks, and the merge, each after the one before,
# and prints the number of the merge. Jobs that are requeued resume. SBATCH_* in the environment,
# such as SBATCH_PARTITION and SBATCH_TIMELIMIT, apply to all three.
set -eu
if [ $# -lt 4 ] || [ "$3" -lt 1 ]; then
  sed -n '2,6s/^# \{0,1\}//p' "$0" >&2
  exit 1
fi
out=$1 shards=$2 levels=$3
shift 3
parts=$out.parts
mkdir -p "$parts"

quoted() { for word; do printf "'%s' " "$(printf %s "$word" | sed "s/'/'\\\\''/g")"; done; }
submit() {  # OPTIONS OF sbatch -- COMMAND
  options=
  while [ "$1" != -- ]; do options="$options $1"; shift; done
  shift
  # shellcheck disable=SC2086
  sbatch --parsable --requeue --open-mode=append --output="$parts/log-%A-%a.txt" $options \
    --wrap="$(quoted "$@")"
}

coarse=$(submit --job-name=slf-coarse -- slf --progress 60 build "$@" --levels "$levels" \
  --only-levels "0-$((levels - 1))" -o "$parts/coarse.slf")
array=$(submit --job-name=slf-shards --array="1-$shards" --dependency="afterok:$coarse" -- \
  slf --progress 60 build "$@" --levels "$levels" --coarser "$parts/coarse.slf" --shard auto \
  -o "$parts/part-{K}-of-{N}.slf")
names=$(seq -f "$parts/part-%0${#shards}g-of-$shards.slf" 1 "$shards")
# shellcheck disable=SC2086
submit --job-name=slf-merge --dependency="afterok:$array" -- \
  slf merge -f "$parts/coarse.slf" $names -o "$out"
