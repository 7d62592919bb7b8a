# Progress lines, errors, and child processes that end with the script. Source this file. It needs bash and coreutils.

set -euo pipefail
script=${0##*/}

say() { printf '[%3d s] %s\n' "$SECONDS" "$*" >&2; }

# For wrong input, or a machine that does not support the command: exit status 2, as for the programs.
fail() {
  printf '%s: %s\n' "$script" "$*" >&2
  exit 2
}

need_value() { [[ $# -ge 2 ]] || fail "$1 needs a value"; }

# ---- child processes ----

# start COMMAND...: starts COMMAND in the background, in its own process group, so that a signal ends its children too.
# Sets `child` to its process id.
start() {
  # A subshell does not inherit traps.
  [[ $BASHPID == "$$" ]] || { trap stop_children EXIT; trap 'exit 130' INT; trap 'exit 143' TERM HUP; }
  setsid -- "$@" </dev/null &
  child=$!
}

# run COMMAND...: starts COMMAND and waits for its end. A signal to the script ends both at once. If COMMAND ran in the
# foreground, bash would first wait for its end.
run() {
  start "$@"
  wait "$child"
}

# Ends all running processes of `start` and `run`: SIGINT, after 0.5 s SIGTERM, after 1.2 s SIGKILL.
stop_children() {
  local tick group
  local -a groups left
  trap '' INT TERM HUP
  mapfile -t groups < <(jobs -pr)
  for tick in {0..13}; do
    left=()
    for group in "${groups[@]}"; do
      kill -0 -- "-$group" 2>/dev/null && left+=("-$group")
    done
    [[ ${#left[@]} -gt 0 ]] || return 0
    case $tick in
      0) kill -INT -- "${left[@]}" 2>/dev/null || true ;;
      5) kill -TERM -- "${left[@]}" 2>/dev/null || true ;;
      12) kill -KILL -- "${left[@]}" 2>/dev/null || true ;;
    esac
    sleep 0.1
  done
}

at_exit() { stop_children; }
trap 'at_exit' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP
