#!/usr/bin/env bash
# What zsh offers for command lines that are being typed, in a terminal of its own.
set -euo pipefail
command -v zsh >/dev/null || { echo "zsh is not installed"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/functions"
PATH=$(dirname "$(realpath "$1")"):$PATH
cp "$2/slf.zsh" "$work/functions/_slf"
cd "$work"
touch a.slf scan.nii
zsh -f -s "$work" <<'ZSH'
zmodload zsh/zpty
work=$1 failures=0
zpty shell zsh -f -i
zpty -w shell "PS1=; unsetopt beep; LISTMAX=1000; stty -echo; cd $work"
zpty -w shell "fpath=($work/functions \$fpath); autoload -U compinit; compinit -u -d $work/dump"
# Completion writes what it would insert where the test reads it.
zpty -w shell "compadd() { if [[ \${@[1,(i)(-|--)]} == *-(O|A|D)\ * ]] { builtin compadd \"\$@\"; return }
  local -a hits; builtin compadd -O hits \"\$@\"; print -rl -- \$hits >>$work/offered; builtin compadd \"\$@\" }"
zpty -w shell 'bindkey "^X" list-choices; echo READY'
zpty -r -m shell line '*READY*'

expect() {  # LINE WORD...: these are among what is offered
  rm -f $work/offered
  zpty -w -n shell $1$'\x18'
  local k; for k in {1..50}; do sleep 0.1; [[ -s $work/offered ]] && break; done
  sleep 0.2
  zpty -w -n shell $'\x15'
  local word
  for word in ${@[2,-1]}; do
    if ! grep -qxF -- $word $work/offered 2>/dev/null; then
      print -r -- "FAILED: '$1' does not offer $word, but: $(tr '\n' ' ' <$work/offered 2>/dev/null)"
      failures=1
    fi
  done
}
expect 'slf re' render repack reveal
expect 'slf render --mo' --mode
expect 'slf render --mode ' nearest uv st bitri depth
expect 'slf build --color-type ' u8 half
expect 'slf build --codec jp' jpeg:75 jpeg:90
expect 'slf render a' a.slf
expect 'slf render x.slf -o s' scan.nii
zpty -d shell
exit $failures
ZSH
