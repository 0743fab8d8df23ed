#!/usr/bin/env bash
# What fish offers for command lines that are being typed.
set -euo pipefail
slf=$1 failures=0
command -v fish >/dev/null || { echo "fish is not installed"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
touch a.slf scan.nii

# expect LINE [WORD...]: exactly these are offered at the end of LINE.
expect() {
  local offered wanted
  offered=$(HOME=$work fish --no-config -c "source '$script'; complete -C '$1'" | cut -f 1 | sort)
  wanted=$(printf '%s\n' "${@:2}" | sort)
  if [[ $offered != "$wanted" ]]; then
    echo "FAILED: '$1'" $'\noffered:' $offered $'\nwanted: ' $wanted
    failures=$((failures + 1))
  fi
}

PATH=$(dirname "$(realpath "$slf")"):$PATH
script=$2/slf.fish
expect "slf re" render repack reveal
expect "slf render --mo" --mode
expect "slf render --mode " nearest uv st bitri depth
expect "slf measure --mode bitri,d" bitri,depth
expect "slf build --color-type " u8 half
expect "slf build --codec jp" jpeg:75 jpeg:90
expect "slf render a" a.slf
expect "slf render x.slf -o s" scan.nii
exit $((failures > 0))
