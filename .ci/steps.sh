# Functions for the steps of a CI run, which are printed, timed and counted. Source this file.

passed=0
failed=0
broken=()

# step COMMAND...: runs COMMAND and counts success or failure. A signal ends the whole run.
step() {
  local began=$SECONDS status=0
  printf '==== %s\n' "$*"
  "$@" </dev/null || status=$?
  ((status < 128)) || exit "$status"
  if ((status == 0)); then
    passed=$((passed + 1))
  else
    failed=$((failed + 1))
    broken+=("$*")
  fi
  printf '==== %s: status %d after %d s\n' "$*" "$status" "$((SECONDS - began))"
}

# marked_run FILE: prints the lines of the code blocks of FILE that begin with ```sh run.
marked_run() { awk '/^```sh run$/ { inside = 1; next } /^```/ { inside = 0 } inside && NF' "$1"; }

# run_page FILE: runs these lines in one shell. The shell ends at the first command that fails, and ends its background
# processes.
run_page() {
  bash -euo pipefail -c "trap 'jobs -p | xargs -r kill 2>/dev/null || true' EXIT"$'\n'"$(marked_run "$1")"
}

finish() {
  local name
  for name in "${broken[@]}"; do printf 'failed: %s\n' "$name"; done
  printf '%d passed, %d failed\n' "$passed" "$failed"
  ((failed == 0))
}
