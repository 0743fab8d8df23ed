# bash completion for slf, which itself says what may follow.

_slf() {
  local word glue= before= k cur
  local -a words=()
  COMPREPLY=()
  # Bash splits words at : and =, which are parts of ours.
  for ((k = 1; k <= COMP_CWORD; ++k)); do
    word=${COMP_WORDS[k]}
    if [[ $word == [:=]* && ${#words[@]} -gt 0 ]]; then
      words[-1]+=$word glue=1
    elif [[ $glue ]]; then
      words[-1]+=$word glue=
    else
      words+=("$word")
    fi
  done
  cur=${words[-1]}
  if [[ $cur == --*=* ]]; then before=${cur%%=*}=; fi
  cur=${cur#"$before"}
  while IFS=$'\t' read -r word _; do
    case $word in
      :folders)
        compopt -o filenames 2>/dev/null
        mapfile -t COMPREPLY < <(compgen -d -- "$cur") ;;
      :files)
        compopt -o filenames 2>/dev/null
        mapfile -t COMPREPLY < <(compgen -f -- "$cur") ;;
      ":files "*)  # with this ending, and folders
        compopt -o filenames 2>/dev/null
        mapfile -t COMPREPLY < <(compgen -f -X "!*${word#:files }" -- "$cur"; compgen -d -- "$cur") ;;
      *) COMPREPLY+=("${word#"$before"}") ;;
    esac
  done < <("${COMP_WORDS[0]}" __complete "${words[@]}" 2>/dev/null)
  # The shell replaces only what follows the last colon.
  if [[ $cur == *:* ]]; then COMPREPLY=("${COMPREPLY[@]#"${cur%:*}:"}"); fi
}
complete -F _slf slf
