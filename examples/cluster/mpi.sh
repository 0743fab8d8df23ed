#!/bin/sh
# Builds a field with MPI's launcher:
#   examples/cluster/mpi.sh OUT.slf SHARDS LEVELS INPUT [OPTIONS OF slf build]
# MPIRUN, by default `mpirun`, may have options, such as the hosts. slf itself does not use MPI: a
# rank only says which shard a process builds. Run it again after a failure: it goes on.
set -eu
if [ $# -lt 4 ] || [ "$3" -lt 1 ]; then
  sed -n '2,5s/^# \{0,1\}//p' "$0" >&2
  exit 1
fi
out=$1 shards=$2 levels=$3
shift 3
parts=$out.parts
mkdir -p "$parts"

slf build "$@" --levels "$levels" --only-levels "0-$((levels - 1))" -o "$parts/coarse.slf"
# Ranks share their machine: one thread each.
${MPIRUN:-mpirun} -n "$shards" slf --progress 60 build "$@" --levels "$levels" -j 1 \
  --coarser "$parts/coarse.slf" --shard auto -o "$parts/part-{K}-of-{N}.slf"
names=$(seq -f "$parts/part-%0${#shards}g-of-$shards.slf" 1 "$shards")
# shellcheck disable=SC2086
slf merge -f "$parts/coarse.slf" $names -o "$out"
