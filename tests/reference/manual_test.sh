#!/usr/bin/env bash
# Every command and every option of --help stands in its manual page, which is sound troff.
set -euo pipefail
slf=$1 pages=$2 failures=0
for tool in groff help2man; do
  command -v "$tool" >/dev/null || { echo "$tool is not installed"; exit 77; }
done

complain() { echo "FAILED: $*"; failures=$((failures + 1)); }

# What a reader sees of a page, on one line.
shown() { groff -man -Tascii -P-cbou -rLL=2000n "$1" | tr -s ' \n' ' '; }

options() { grep -oE -- '(^|[ ,])--[a-z][a-z-]*' | tr -d ' ,' | sort -u; }

"$slf" --version | grep -qF "$(sed -n 's/^\.TH .* "\(slf [^"]*\)" .*/\1/p' "$pages/slf.1")" ||
  complain "slf.1 is of another version than the program"

mapfile -t commands < <("$slf" --help | sed -n '/^Subcommands:/,/^$/s/^  \([a-z]*\) .*/\1/p')
((${#commands[@]} >= 10)) || complain "found only ${#commands[@]} commands"
for command in "${commands[@]}"; do
  page=$pages/slf-$command.1
  [[ -f $page ]] || { complain "no page for $command"; continue; }
  shown "$pages/slf.1" | grep -qF "slf-$command(1)" || complain "slf(1) does not list $command"
  text=$(shown "$page")
  for heading in NAME SYNOPSIS DESCRIPTION OPTIONS EXAMPLES "EXIT STATUS" ENVIRONMENT FILES "SEE ALSO"; do
    [[ $text == *"$heading"* ]] || complain "$page has no section $heading"
  done
  for option in $("$slf" "$command" --help | sed '/^A first field/,$d' | options); do
    [[ $text == *"$option"[\ ,.\)]* ]] || complain "$page does not name $option"
  done
done
# The variables that doc/commands.md says slf reads, not only its scripts and tests.
variables=$(sed -n '/^## Environment/,$p' "$(dirname "$0")/../../doc/commands.md" |
  grep -E '\| (`slf |the same|.*commands that)' | grep -oE '`[A-Z_]+`' | tr -d '`')
[[ $variables == *TMPDIR* ]] || complain "found no variables in doc/commands.md"
text=$(shown "$pages/slf.1")
for variable in $variables; do
  [[ $text == *"$variable"* ]] || complain "slf(1) does not name the variable $variable"
done
pages_there=("$pages"/slf-*.1)
((${#pages_there[@]} == ${#commands[@]})) || complain "${#pages_there[@]} pages, ${#commands[@]} commands"

for page in "$pages"/*.1; do
  warnings=$(groff -man -Tutf8 -ww "$page" 2>&1 >/dev/null)
  [[ -z $warnings ]] || complain "$warnings"
done
exit $((failures > 0))
