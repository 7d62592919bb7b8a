# Completion for `tactus` and its programs in bash: commands, options and files. The words come from --help.

_tactus() {
  local current=${COMP_WORDS[COMP_CWORD]} word help
  local -a call=("${COMP_WORDS[0]}")
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    [[ $word =~ ^[a-z][a-z0-9]*$ ]] || break
    call+=("$word")
  done
  help=$("${call[@]}" --help 2>/dev/null </dev/null) || return 0
  if [[ $current == -* ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$(grep -o -E '(^|[ ,])--[a-z][a-z-]*' <<<"$help" | tr -d ' ,' | sort -u)" -- "$current")
    return 0
  fi
  # Commands begin the lines that are indented by two spaces, in CLI11's help after a heading.
  local commands
  if [[ ${call[*]} == tactus ]]; then
    commands=$(sed -n 's/^  \([a-z][a-z0-9]*\) .*/\1/p' <<<"$help" | grep -v '^tactus$' | sort -u)
  else
    commands=$(sed -n '/^Subcommands:/,/^$/s/^  \([a-z]*\) .*/\1/p' <<<"$help")
    [[ ${call[*]} != 'tactus sim' ]] || commands=study
  fi
  mapfile -t COMPREPLY < <(compgen -W "$commands" -- "$current")
}

complete -o default -F _tactus tactus
for _tactus_program in "${BASH_SOURCE[0]%/*}"/tactus-*; do
  complete -o default -F _tactus "${_tactus_program##*/}"
done
unset _tactus_program
