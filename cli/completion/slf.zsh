#compdef slf
# zsh completion for slf, which itself says what may follow.

_slf() {
  local line
  local -a offered
  for line in "${(@f)$(${words[1]} __complete "${(@Q)words[2,CURRENT]}" 2>/dev/null)}"; do
    case $line in
      (:folders) compset -P '*='; _files -/; return ;;
      (:files*) compset -P '*='; _files -g "*${${line#:files}# }"; return ;;
      (?*) offered+=("${${line%%$'\t'*}//:/\\:}:${line#*$'\t'}") ;;
    esac
  done
  _describe value offered
}

_slf "$@"
