#!/usr/bin/env bash
# What bash offers for command lines that are being typed.
set -euo pipefail
slf=$(realpath "$1") failures=0
PATH=$(dirname "$slf"):$PATH
source "$2/slf.bash"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
mkdir folder
touch a.slf "b c.slf" scan.nii look.json

# expect LINE [WORD...]: exactly these are offered at the end of LINE.
expect() {
  local line=$1 offered wanted
  shift
  # As readline does: spaces, colons and equal signs part words.
  mapfile -t COMP_WORDS < <(grep -oE '[:=]+|[^ :=]+' <<<"$line")
  if [[ $line == *[\ :=] ]]; then
    # An equal sign or a colon at the end is the word under the cursor.
    if [[ $line == *" " ]]; then COMP_WORDS+=(""); fi
  fi
  COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
  _slf || true  # without errexit, as in a shell
  offered=$(printf '%s\n' "${COMPREPLY[@]}" | sort)
  wanted=$(printf '%s\n' "$@" | sort)
  if [[ $offered != "$wanted" ]]; then
    echo "FAILED: '$line'" $'\noffered:' $offered $'\nwanted: ' $wanted
    failures=$((failures + 1))
  fi
}

# has LINE WORD: it is among those offered.
has() {
  mapfile -t COMP_WORDS < <(tr ' ' '\n' <<<"$1")
  COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
  _slf || true  # without errexit, as in a shell
  [[ " ${COMPREPLY[*]} " == *" $2 "* ]] || { echo "FAILED: '$1' does not offer $2"; failures=$((failures + 1)); }
}

expect "slf re" render repack reveal
expect "slf -q ver" verify
expect "slf render --mo" --mode
expect "slf render --mode " nearest uv st bitri depth
expect "slf render --mode=d" depth
expect "slf measure --mode bitri,d" bitri,depth
expect "slf -q play --loading a" ahead
expect "slf build --color-type " u8 half
expect "slf build --codec jp" jpeg:75 jpeg:90
expect "slf build --codec jpeg:7" 75
expect "slf build --step "
expect "slf render " a.slf "b c.slf" folder
expect "slf render -o p" 
expect "slf render -o s" scan.nii
expect "slf build scan.nii -o " a.slf "b c.slf" folder
expect "slf build sc" scan.nii
expect "slf build --transfer " a.slf "b c.slf" look.json scan.nii folder
expect "slf play --path " look.json folder
expect "slf play --frames " folder

# Every option that a command knows is offered, wherever it stands.
commands=$("$slf" --help | sed -n '/^Subcommands:/,/^$/s/^  \([a-z]*\) .*/\1/p')
[[ $commands == *render* ]] || { echo "FAILED: --help lists no commands"; exit 1; }
for command in $commands; do
  for option in $("$slf" "$command" --help | grep -oE '^  (-[a-z],)?--[a-z-]+' | grep -oE -- '--[a-z-]+'); do
    has "slf $command -" "$option"
  done
done
exit $((failures > 0))
